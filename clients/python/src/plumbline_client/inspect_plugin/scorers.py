"""Scorers: whether a build passes, and each criterion. Their means are the rates of the board."""

from __future__ import annotations

import math
from typing import Any

from inspect_ai.scorer import Score, Scorer, Target, grouped, mean, scorer, stderr
from inspect_ai.solver import TaskState
from inspect_ai.util import concurrency

from ..async_client import AsyncClient
from ..errors import Conflict, Faulty, Forbidden, PlumblineError, Unauthorized
from ..evaluate.attempts import dropped_words
from ..models import ReportBody, TurnReplay
from ..refused import without_refused
from .boards import run_of
from .state import Build, answers

CRITERIA = [
    "accuracy",
    "material",
    "shape",
    "size",
    "physical_plausibility",
    "dependency",
    "structural_stability",
    "efficiency",
]
AT_ONCE = 16
NAN = math.nan


def by(key: str) -> Any:
    """Returns the mean for each group of tasks."""
    return grouped(mean(), key, name_template=f"{key}/{{group_name}}", all=False)


@scorer(metrics=[mean(), stderr(), by("category"), by("family")])
def passes() -> Scorer:
    """Scores 1 if a build passes the whole task, else 0; unscored if the service could not grade it."""

    async def score(state: TaskState, target: Target) -> Score:
        try:
            graded = await graded_build(state)
        except (Unauthorized, Forbidden):
            # Without a key that may do this, no sample of the evaluation will be scored.
            raise
        except PlumblineError as error:
            return Score.unscored(reason="scoring_failed", explanation=str(error))
        if graded.get("hidden"):
            return Score.unscored(reason="hidden", explanation=graded["explanation"], metadata=graded["evidence"])
        return Score(value=float(graded["overall"]), explanation=graded["explanation"], metadata=graded["evidence"])

    return score


@scorer(metrics={"*": [mean(), stderr()]})
def criteria() -> Scorer:
    """Scores each criterion: 1 if it holds, else 0; a criterion that does not apply to a task is left out."""

    async def score(state: TaskState, target: Target) -> Score:
        try:
            graded = await graded_build(state)
        except (Unauthorized, Forbidden):
            # Without a key that may do this, no sample of the evaluation will be scored.
            raise
        except PlumblineError as error:
            return Score.unscored(reason="scoring_failed", explanation=str(error))
        if graded.get("hidden"):
            return Score.unscored(reason="hidden", explanation=graded["explanation"])
        holds = graded["holds"]
        return Score(value={name: float(holds[name]) if name in holds else NAN for name in CRITERIA})

    return score


async def graded_build(state: TaskState) -> dict[str, Any]:
    """Submits what a sample built, unless that is done, and returns its verdicts."""
    build = state.store_as(Build)
    if build.graded is None:
        async with concurrency("plumbline", AT_ONCE), AsyncClient() as client:
            if state.metadata.get("instance") is not None:
                build.graded = await answered(client, state, build)
            else:
                if build.submission is None:
                    build.submission = await submitted(client, state, build)
                build.graded = await verdicts(client, build.submission, build.refused)
    return build.graded


async def submitted(client: AsyncClient, state: TaskState, build: Build) -> str:
    """Submits what was built, and returns the submission's identifier."""
    if build.episode is not None:
        done = await client.episodes.submit(build.episode)
        return str(done.submission)
    turns = answers(build.texts, state.metadata["turns"])
    try:
        return await sent(client, state, build, turns)
    except Faulty as refused:
        turns, build.refused = without_refused(turns, refused)
        return await sent(client, state, build, turns)


async def sent(client: AsyncClient, state: TaskState, build: Build, turns: list[dict[str, Any]]) -> str:
    """Sends the turns, and returns the submission's identifier."""
    try:
        return await sent_to(client, state, build, turns, await run_of(client, state))
    except Conflict as taken:
        # The open run of this name has another answer to this task, so it is not the one to go on with.
        if build.run is None or taken.kind not in ("already-submitted", "run-closed"):
            raise
        return await sent_to(client, state, build, turns, await run_of(client, state, anew=True))


async def sent_to(
    client: AsyncClient, state: TaskState, build: Build, turns: list[dict[str, Any]], run: str | None
) -> str:
    """Sends the turns to a run, or to none."""
    build.run = run
    accepted = await client.submissions.create(
        task=state.metadata["task"],
        run=run,
        suite=None if run else state.metadata["suite"],
        profile=state.metadata["profile"],
        turns=turns,
    )
    return str(accepted.id)


async def verdicts(client: AsyncClient, submission: str, refused: list[str]) -> dict[str, Any]:
    """Waits for the report of a submission, and returns its verdicts."""
    settled = await client.submissions.wait(submission)
    if settled.state != "graded":
        raise PlumblineError(f"submission {submission} ended as {settled.state}: {settled.error or 'no reason given'}")
    report = await client.submissions.report(submission)
    holds = {str(one.criterion): one.holds for one in report.criteria}
    if report.accuracy is not None:
        holds["accuracy"] = report.accuracy
    page = f"{client.url}/submissions/{submission}"
    return {
        "overall": report.overall,
        "holds": holds,
        "explanation": explained(report, page, [*refused, *told_of_code(settled.action_code or [])]),
        "evidence": {"submission": submission, "report": f"{client.url}/v1/submissions/{submission}/report"},
    }


def told_of_code(replays: list[TurnReplay]) -> list[str]:
    """Says what went wrong with the code of each turn: the error that ended it, calls that did nothing, and notes."""
    told = []
    for replay in replays:
        place = f"turn {replay.turn}"
        if replay.error is not None:
            line = f" in line {replay.error.line}" if replay.error.line else ""
            told.append(f"{place}: the code ended{line} with {replay.error.message}")
        told += [f"{place}: {dropped_words(dropped.count, dropped.reason)}" for dropped in replay.dropped or []]
        told += [f"{place}: {note}" for note in replay.notes or []]
    return told


def explained(report: ReportBody, page: str, refused: list[str]) -> str:
    """Says in Markdown which checks did not score 1, with links to the build and its evidence."""
    lines = [f"[The build and its evidence]({page})", "", *[f"- {reason}" for reason in refused]]
    failed = [(turn.turn, check) for turn in report.turns for check in turn.checks if check.score < 1.0]
    if not failed:
        lines.append("Every check scores 1.")
    for turn, check in failed[:30]:
        lines.append(f"- turn {turn}, {check.criterion}: `{check.fn}` scores {check.score:.3g}")
    if len(failed) > 30:
        lines.append(f"- and {len(failed) - 30} more")
    return "\n".join(lines)


async def answered(client: AsyncClient, state: TaskState, build: Build) -> dict[str, Any]:
    """Answers a hidden instance; the entry is finalized with the last of its answers."""
    if build.episode is not None:
        taken = (await client.episodes.submit(build.episode)).model_dump(mode="json")
    else:
        turns = answers(build.texts, state.metadata["turns"])
        instance, profile = state.metadata["instance"], state.metadata["profile"]
        try:
            accepted = await client.instances.answer(instance, turns=turns, profile=profile)
        except Faulty as refused:
            turns, build.refused = without_refused(turns, refused)
            accepted = await client.instances.answer(instance, turns=turns, profile=profile)
        taken = accepted.model_dump(mode="json")
    entry = await client.entries.get(state.metadata["entry"])
    if entry.answered == state.metadata["instances"] and entry.state == "registered":
        await client.entries.finalize(state.metadata["entry"])
    page = f"{client.url}/v1/entries/{state.metadata['entry']}"
    return {
        "hidden": True,
        "explanation": f"Answered. The [entry]({page}) has the result when it is released.",
        # The receipt of the answer, which `verify-epoch` compares with what the service reveals.
        "evidence": {"answered": taken},
    }
