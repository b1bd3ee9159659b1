"""Carries out a plan: asks the model, submits what it wrote, and finishes the runs."""

from __future__ import annotations

import asyncio
import hashlib
import secrets
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .. import __version__, errors
from ..async_client import AsyncClient
from ..models import RunBody
from . import attempts, problems
from .journal import Journal, JournalError
from .model import Completion, EndpointRefuses, Message, Model, ModelError
from .plan import Budget, Plan, Prices
from .problems import Attempt
from .spending import BudgetSpent, Spending, spent


@dataclass
class Outcome:
    """What became of an evaluation."""

    runs: list[str]
    """Identifiers of the runs, or of the entry of a hidden evaluation."""
    spending: Spending
    failed: dict[str, str] = field(default_factory=dict)
    """Attempts without an answer, each with the reason."""
    stopped: str | None = None
    """Why the evaluation stopped before its end, if it did."""
    finished: list[RunBody] = field(default_factory=list)
    """The finished runs with their summaries."""
    entry: dict[str, Any] | None = None
    """The finalized entry of a hidden evaluation."""

    @property
    def is_complete(self) -> bool:
        """Whether every run is finished."""
        return bool(self.finished) or self.entry is not None


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
        self._spending = spent(prices, self._journal.of_kind("completion"))
        self._stopped: str | None = None
        self._done = 0

    async def carry_out(self) -> Outcome:
        """Does what is left of the plan."""
        try:
            self._compare_plan()
            system = await self._system()
            todo = await self._problems(system)
            outcome = Outcome(list(dict.fromkeys(attempt.run for attempt in todo)), self._spending)
            self._progress(0, len(todo))
            results = await asyncio.gather(*[self._answer(attempt, system, len(todo)) for attempt in todo])
            failures = zip(todo, results, strict=True)
            outcome.failed = {attempt.name: reason for attempt, reason in failures if reason is not None}
            outcome.stopped = self._stopped
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
        elif known["url"] != self._client.url:
            raise JournalError(f"{self._folder} holds an evaluation for {known['url']}; name another folder")

    async def _system(self) -> str:
        """Returns the system prompt, as it was when the evaluation began."""
        if (known := self._journal.last("", "system")) is not None:
            return str(known["text"])
        plan = self._plan
        text = plan.system
        if text is None:
            text = (await self._client.tasks.agent_guide(profile=plan.profile)).text
        if plan.epoch is None and plan.track == "brief":
            preamble = (await self._client.suites.get(plan.suite)).preamble
            text = f"{text}\n\n{preamble}" if preamble else text
        self._journal.add("", "system", text=text)
        return text

    async def _problems(self, system: str) -> list[Attempt]:
        if self._plan.epoch is not None:
            entry, drawn = await problems.enter(self._client, self._plan, self._journal)
            return [Attempt(index, entry, one) for index, run in enumerate(drawn) for one in run]
        runs = await problems.begin_runs(self._client, self._plan, self._card(system), self._journal)
        suite = self._journal.all("", "run")[0]["suite"]
        tasks = await problems.tasks_of(self._client, self._plan, suite)
        return [Attempt(index, run, task) for index, run in enumerate(runs) for task in tasks]

    def _card(self, system: str) -> dict[str, Any]:
        return {
            "model": self._plan.model,
            "harness": "plumbline-client evaluate",
            "harness_version": __version__,
            "configuration_sha256": self._plan.sha256(),
            "system_prompt_sha256": hashlib.sha256(system.encode()).hexdigest(),
        }

    async def _answer(self, attempt: Attempt, system: str, of: int) -> str | None:
        """Answers one problem. Returns the reason if there is no answer."""
        async with self._slots:
            try:
                if self._journal.last(attempt.name, "submitted") is None:
                    if self._stopped is not None:
                        return f"not begun: {self._stopped}"
                    await self._submit(attempt, system)
            except (BudgetSpent, EndpointRefuses, errors.Unauthorized, errors.Forbidden) as error:
                self._stopped = self._stopped or str(error)
                return str(error)
            except errors.PlumblineError as error:
                return str(error)
            finally:
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
        episode, messages = await attempts.by_episode(
            self._client, self._plan, self._journal, self._ask, attempt, system
        )
        done = await self._client.episodes.submit(episode, transcript_sha256=self._promise(attempt, messages))
        return done.model_dump(mode="json", exclude_none=True)

    async def _answer_at_once(self, attempt: Attempt, system: str) -> dict[str, Any]:
        texts, messages = await attempts.one_shot(self._ask, attempt, system)
        promise = self._promise(attempt, messages)
        turns, profile = [{"action_code": text} for text in texts], self._plan.profile
        if attempt.problem.is_hidden:
            taken = await self._client.instances.answer(
                attempt.problem.id, turns=turns, profile=profile, transcript_sha256=promise
            )
            return taken.model_dump(mode="json", exclude_none=True)
        accepted = await self._client.submissions.create(
            run=attempt.run, task=attempt.problem.id, profile=profile, turns=turns
        )
        return {"submission": str(accepted.id)}

    def _promise(self, attempt: Attempt, messages: list[Message]) -> str | None:
        """Keeps the transcript, and returns its hash if the answer promises one."""
        transcript = attempts.transcript_of(messages, self._journal.all(attempt.name, "completion"))
        attempts.keep_transcript(self._folder, attempt, transcript)
        return hashlib.sha256(transcript).hexdigest() if attempt.problem.is_hidden else None

    async def _ask(self, attempt: Attempt, messages: Sequence[Message], number: int) -> Completion:
        known = self._journal.all(attempt.name, "completion")
        if len(known) > number:
            return Completion.of_json(known[number]["completion"])
        self._spending.refuse_beyond(self._budget)
        completion = await self._model.answer(messages, attempt.run_index)
        self._spending.add(completion.usage)
        self._journal.add(attempt.name, "completion", completion=completion.as_json())
        return completion

    async def _finish(self, outcome: Outcome) -> None:
        if self._plan.epoch is not None:
            entry = await self._client.entries.finalize(outcome.runs[0])
            outcome.entry = entry.model_dump(mode="json")
            return
        for run in outcome.runs:
            try:
                await self._client.runs.finish(run, skip="unanswered")
            except errors.Conflict as ended:
                # A run finishes by itself once every task is graded.
                if ended.kind != "run-not-open":
                    raise
            outcome.finished.append(await self._client.runs.wait(run))


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


__all__ = ["Evaluation", "ModelError", "Outcome", "evaluate"]
