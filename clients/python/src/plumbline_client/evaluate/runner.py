"""Carries out a plan: asks the model, submits what it wrote, and finishes the runs."""

from __future__ import annotations

import asyncio
import hashlib
import secrets
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from .. import __version__, errors
from ..async_client import AsyncClient
from ..models import RunBody
from ..refused import without_refused
from . import attempts, problems
from .journal import Journal, JournalError
from .model import Completion, EndpointRefuses, Message, Model, ModelError
from .plan import Budget, Plan, Prices
from .problems import Attempt
from .spending import BudgetSpent, Spending, spent

MOST_FAILURES = 20
"""Problems in a row that the model does not answer, after which the evaluation stops."""


@dataclass
class Outcome:
    """What became of an evaluation."""

    runs: list[str]
    """Identifiers of the runs, or of the entry of a hidden evaluation."""
    spending: Spending
    url: str = ""
    """Address of the service."""
    problems: int = 0
    """Number of problems that were to be answered, over all runs."""
    failed: dict[str, str] = field(default_factory=dict)
    """Attempts without an answer, each with the reason."""
    stopped: str | None = None
    """Why the evaluation stopped before its end, if it did."""
    finished: list[RunBody] = field(default_factory=list)
    """The finished runs with their summaries."""
    left_open: list[str] = field(default_factory=list)
    """Runs that have answers to the tasks that were asked for, and take others."""
    answers: dict[str, int | None] = field(default_factory=dict)
    """Number of answers of the model, of those that were empty, cut off, refusals, or calls of tools, and of those whose
    code reached a limit, or failed or ended before it built anything (None if that is unknown)."""
    entry: dict[str, Any] | None = None
    """The finalized entry of a hidden evaluation."""

    @property
    def is_complete(self) -> bool:
        """Whether everything that was asked for is answered, and every whole run is finished."""
        return bool(self.finished or self.left_open) or self.entry is not None


class Evaluation:
    """A plan that is being carried out."""

    def __init__(
        self,
        plan: Plan,
        client: AsyncClient,
        model: Model,
        folder: Path,
        *,
        budget: Budget,
        prices: Prices | None,
        concurrency: int,
        skip_failed: bool,
        progress: Callable[[int, int], None],
    ) -> None:
        self._plan, self._client, self._model, self._folder = plan, client, model, folder
        self._budget, self._skip_failed, self._progress = budget, skip_failed, progress
        self._journal = Journal(folder)
        self._slots = asyncio.Semaphore(concurrency)
        self._spending = spent(prices, self._journal)
        self._stopped: str | None = None
        self._done = 0
        self._under_way = 0
        self._failures_in_a_row = 0

    async def carry_out(self) -> Outcome:
        """Does what is left of the plan."""
        try:
            self._compare_plan()
            system = await self._system()
            todo = await self._problems(system)
            runs = list(dict.fromkeys(attempt.run for attempt in todo))
            outcome = Outcome(runs, self._spending, url=self._client.url, problems=len(todo))
            self._progress(0, len(todo))
            async with asyncio.TaskGroup() as group:
                answers = [group.create_task(self._answer(attempt, system, len(todo))) for attempt in todo]
            results = [answer.result() for answer in answers]
            failures = zip(todo, results, strict=True)
            outcome.failed = {attempt.name: reason for attempt, reason in failures if reason is not None}
            outcome.stopped = self._stopped
            outcome.answers = attempts.counts(self._journal)
            if self._stopped is None and (self._skip_failed or not outcome.failed):
                await self._finish(outcome)
            return outcome
        finally:
            self._journal.close()

    def _compare_plan(self) -> None:
        known = self._journal.last("", "plan")
        if known is None:
            self._journal.add("", "plan", plan=self._plan.as_json(), nonce=secrets.token_hex(16), url=self._client.url)
        elif known["plan"] != self._plan.as_json():
            ours = self._plan.as_json()
            differ = sorted(name for name in ours if ours[name] != known["plan"].get(name))
            raise JournalError(
                f"{self._folder} holds another evaluation, which differs in {', '.join(differ)}; name another folder"
            )

    async def _system(self) -> str:
        """Returns the system prompt, as it was when the evaluation began."""
        if (known := self._journal.last("", "system")) is not None:
            return str(known["text"])
        plan, suite = self._plan, None if self._plan.epoch else self._plan.suite
        text = plan.system
        if text is None:
            text = await self._client.tasks.system_prompt(suite, plan.track, plan.profile)
        self._journal.add("", "system", text=text)
        return text

    async def _problems(self, system: str) -> list[Attempt]:
        if self._plan.epoch is not None:
            entry, drawn = await problems.enter(
                self._client, self._plan, self._plan.configuration(system), self._journal
            )
            return [Attempt(index, entry, one) for index, run in enumerate(drawn) for one in run]
        if self._plan.tasks:
            # A name that is wrong is told before a run begins.
            await problems.tasks_of(self._client, self._plan, self._plan.suite)
        runs = await problems.begin_runs(self._client, self._plan, self._card(system), self._journal)
        suite = self._journal.all("", "run")[0]["suite"]
        tasks = await problems.tasks_of(self._client, self._plan, suite)
        return [Attempt(index, run, task) for index, run in enumerate(runs) for task in tasks]

    def _card(self, system: str) -> dict[str, Any]:
        """Returns what is known of a run before it begins."""
        sampling = asdict(self._plan.sampling)
        sent = attempts.system_of(self._plan, system)
        return {
            "harness": {"name": f"plumbline-client evaluate{self._plan.manner()}", "version": __version__},
            "model": {"name": self._plan.model},
            "system_prompt": {"sha256": hashlib.sha256(sent.encode()).hexdigest()},
            "sampling": {name: value for name, value in sampling.items() if value is not None and name != "extra"},
            "configuration_sha256": self._plan.configuration(system),
        }

    async def _answer(self, attempt: Attempt, system: str, of: int) -> str | None:
        """Answers one problem. Returns the reason if there is no answer."""
        async with self._slots:
            try:
                if self._journal.last(attempt.name, "submitted") is None:
                    if self._stopped is not None:
                        return f"not begun: {self._stopped}"
                    await self._submit(attempt, system)
            except (BudgetSpent, EndpointRefuses, JournalError, errors.Unauthorized, errors.Forbidden) as error:
                self._stopped = self._stopped or str(error)
                return str(error)
            except errors.Conflict as error:
                if error.kind in ("run-closed", "epoch-not-open", "finalized"):
                    self._stopped = self._stopped or str(error)
                return str(error)
            except ModelError as error:
                self._failures_in_a_row += 1
                if self._failures_in_a_row >= MOST_FAILURES:
                    self._stopped = (
                        self._stopped or f"{self._failures_in_a_row} problems in a row have no answer: {error}"
                    )
                return str(error)
            except errors.PlumblineError as error:
                return str(error)
            except (OSError, ValueError, TypeError, KeyError) as error:
                # One odd answer must not cost the others theirs.
                return f"{type(error).__name__}: {error}"
        self._done += 1
        self._progress(self._done, of)
        return None

    async def _submit(self, attempt: Attempt, system: str) -> None:
        if self._plan.mode == "episodes":
            result = await self._answer_by_episode(attempt, system)
        else:
            result = await self._answer_at_once(attempt, system)
        self._journal.add(attempt.name, "submitted", result=result)

    async def _answer_by_episode(self, attempt: Attempt, system: str) -> dict[str, Any]:
        try:
            return await self._go_through_episode(attempt, system)
        except errors.Conflict as over:
            # It expired before the evaluation went on. The answers are known, so another one costs nothing.
            if over.kind != "episode-over":
                raise
            self._journal.add(attempt.name, "episode", episode=None)
            return await self._go_through_episode(attempt, system)

    async def _go_through_episode(self, attempt: Attempt, system: str) -> dict[str, Any]:
        episode, messages = await attempts.by_episode(
            self._client, self._plan, self._journal, self._ask, attempt, system
        )
        done = await self._client.episodes.submit(episode, transcript_sha256=self._promise(attempt, messages))
        return done.model_dump(mode="json", exclude_none=True)

    async def _answer_at_once(self, attempt: Attempt, system: str) -> dict[str, Any]:
        texts, messages = await attempts.one_shot(self._ask, attempt, system)
        promise = self._promise(attempt, messages)
        turns: list[dict[str, Any]] = [{"action_code": text} for text in texts]
        try:
            return await self._send(attempt, turns, promise)
        except errors.Faulty as refused:
            turns, reasons = without_refused(turns, refused)
            return {**await self._send(attempt, turns, promise), "refused": reasons}

    async def _send(self, attempt: Attempt, turns: list[dict[str, Any]], promise: str | None) -> dict[str, Any]:
        profile = self._plan.profile
        if attempt.problem.is_hidden:
            taken = await self._client.instances.answer(
                attempt.problem.id, turns=turns, profile=profile, transcript_sha256=promise
            )
            return taken.model_dump(mode="json", exclude_none=True)
        accepted = await self._client.submissions.create(
            run=attempt.run, task=attempt.problem.id, profile=profile, turns=turns
        )
        replays = accepted.action_code or []
        without = [replay for replay in replays if replay.events == 0]
        failed = sum(replay.error is not None for replay in without)
        return {"submission": str(accepted.id), "code_failed": failed, "code_idle": len(without) - failed}

    def _promise(self, attempt: Attempt, messages: list[Message]) -> str | None:
        """Keeps the transcript, and returns its hash if the answer promises one."""
        transcript = attempts.transcript_of(messages, self._journal.all(attempt.name, "completion"))
        attempts.keep_transcript(self._folder, attempt, transcript)
        return hashlib.sha256(transcript).hexdigest() if attempt.problem.is_hidden else None

    async def _ask(self, attempt: Attempt, messages: Sequence[Message], number: int) -> Completion:
        known = self._journal.all(attempt.name, "completion")
        if len(known) > number:
            return Completion.of_json(known[number]["completion"])
        if self._stopped is not None:
            raise BudgetSpent(self._stopped)
        self._spending.refuse_beyond(self._budget, self._under_way)

        self._under_way += 1
        try:
            completion = await self._model.answer(messages, attempt.run_index, Tries(self, attempt))
        finally:
            self._under_way -= 1
        self._journal.add(attempt.name, "completion", completion=completion.as_json())
        self._spending.add(completion.usage)
        self._failures_in_a_row = 0
        return completion

    def begin_try(self, attempt: Attempt) -> None:
        """Notes a request before it is sent. Raises `BudgetSpent` if there may be no other."""
        self._spending.refuse_beyond(self._budget, self._under_way - 1)
        self._journal.add(attempt.name, "asked")

    def end_try(self, attempt: Attempt, reason: str, is_billed: bool) -> None:
        """Counts a request that brought no answer."""
        self._journal.add(attempt.name, "unmetered" if is_billed else "unbilled", reason=reason)
        self._spending.add_failed(is_billed)

    async def _finish(self, outcome: Outcome) -> None:
        if self._plan.epoch is not None:
            entry = await self._client.entries.finalize(outcome.runs[0])
            await self._client.entries.put_card(entry.id, **self._declared(outcome))
            outcome.entry = entry.model_dump(mode="json")
            return
        for run in outcome.runs:
            if self._plan.tasks:
                outcome.left_open.append(run)
            else:
                try:
                    await self._client.runs.finish(run, skip="unanswered")
                except errors.Conflict as ended:
                    # A run finishes by itself once every task is graded.
                    if ended.kind != "run-not-open":
                        raise
            await self._client.runs.put_card(run, **self._declared(outcome))
        # Last, because a run whose grading failed waits for its operator.
        for run in outcome.runs if not self._plan.tasks else []:
            outcome.finished.append(await self._client.runs.wait(run))

    def _declared(self, outcome: Outcome) -> dict[str, Any]:
        """Returns the card with what the whole evaluation took, shared among its runs."""
        system = self._journal.all("", "system")[0]["text"]
        card, told = self._card(system), self._spending.as_json()
        if len(outcome.runs) == 1:
            named = {"input": "input_tokens", "output": "output_tokens", "cached_input": "cached_input_tokens"}
            named["reasoning"] = "reasoning_tokens"
            card["tokens"] = {name: told[of] for name, of in named.items() if told[of] is not None}
            if told["cost"]:
                cost = {"amount": told["cost"], "currency": told["currency"], "prices_as_of": told["prices_as_of"]}
                card["cost"] = cost
        return card


@dataclass(frozen=True)
class Tries:
    """Counts the requests for one answer."""

    evaluation: Evaluation
    attempt: Attempt

    def begin(self) -> None:
        """Called before a request is sent."""
        self.evaluation.begin_try(self.attempt)

    def end(self, reason: str, is_billed: bool) -> None:
        """Called after a request that brought no answer."""
        self.evaluation.end_try(self.attempt, reason, is_billed)


async def evaluate(
    plan: Plan,
    client: AsyncClient,
    model: Model,
    folder: Path,
    *,
    budget: Budget | None = None,
    prices: Prices | None = None,
    concurrency: int = 8,
    skip_failed: bool = False,
    progress: Callable[[int, int], None] = lambda done, of: None,
) -> Outcome:
    """Carries out a plan in a folder, or what is left of it if the folder has its journal.

    Runs are finished when every problem has an answer; with `skip_failed` also if some have none, which then count as
    failed. Raises `ModelError`, an error of the client, or `JournalError` if nothing can be begun.
    """
    evaluation = Evaluation(
        plan,
        client,
        model,
        folder,
        budget=budget or Budget(),
        prices=prices,
        concurrency=concurrency,
        skip_failed=skip_failed,
        progress=progress,
    )
    return await evaluation.carry_out()
