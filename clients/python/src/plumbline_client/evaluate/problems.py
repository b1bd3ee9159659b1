"""The problems that a run poses: tasks of a suite, or instances of a hidden epoch."""

from __future__ import annotations

import difflib
from collections.abc import Awaitable
from dataclasses import dataclass
from typing import Any

from ..async_client import AsyncClient
from ..errors import NotFound, PlumblineError
from .journal import Journal, JournalError
from .plan import Plan


@dataclass(frozen=True)
class Problem:
    """A task, or an instance whose task is hidden."""

    id: str
    prompts: tuple[str, ...]
    is_hidden: bool = False


@dataclass(frozen=True)
class Attempt:
    """One answer to one problem in one run."""

    run_index: int
    run: str
    """Identifier of the run, or of the entry of a hidden evaluation."""
    problem: Problem

    @property
    def name(self) -> str:
        """Name in the journal and in the folder of transcripts."""
        return f"{self.run_index + 1}/{self.problem.id}"


async def tasks_of(client: AsyncClient, plan: Plan, suite: str) -> list[Problem]:
    """Returns the tasks of the plan, in the order of the suite."""
    found = {task.number: task async for task in client.tasks.all(suite, track=plan.track)}
    names = {str(number): task.id for number, task in found.items()} | {task.id: task.id for task in found.values()}
    unknown = [name for name in plan.tasks if name not in names]
    if unknown:
        near = [match for name in unknown for match in difflib.get_close_matches(name, names, n=1)]
        hint = f"; did you mean {', '.join(near)}?" if near else f"; {client.url}/suites/{suite}/tasks lists them"
        raise PlumblineError(f"{suite} has no task {', '.join(sorted(unknown))}{hint}")
    wanted = {names[name] for name in plan.tasks or names}
    return [Problem(task.id, tuple(task.prompts)) for task in found.values() if task.id in wanted]


async def begin_runs(client: AsyncClient, plan: Plan, card: dict[str, Any], journal: Journal) -> list[str]:
    """Creates the runs of the plan that do not exist yet, and returns the identifiers of all."""
    for known in journal.all("", "run"):
        await at_this_service(client, journal, client.runs.get(known["run"]))
    for index in range(len(journal.all("", "run")), plan.repeat):
        key = f"evaluate-{journal.all('', 'plan')[0]['nonce']}-{index}"
        run = await client.runs.create(
            agent=plan.agent,
            suite=plan.suite,
            track=plan.track,
            metadata={"repeat": index + 1},
            card=card,
            idempotency_key=key,
        )
        journal.add("", "run", run=str(run.id), suite=run.suite)
    return [entry["run"] for entry in journal.all("", "run")]


async def at_this_service(client: AsyncClient, journal: Journal, looking: Awaitable[object]) -> None:
    """Refuses to resume at a service other than the one where the evaluation started."""
    try:
        await looking
    except NotFound as error:
        url = journal.all("", "plan")[0]["url"]
        raise JournalError(f"{journal.path} is of an evaluation at {url}, which {client.url} does not know") from error


async def enter(
    client: AsyncClient, plan: Plan, configuration: str, journal: Journal
) -> tuple[str, list[list[Problem]]]:
    """Registers an entry of a hidden evaluation and draws its instances, as far as that is not done. Returns the
    entry's identifier and the problems of each run."""
    assert plan.epoch is not None
    nonce = journal.all("", "plan")[0]["nonce"]
    if (known := journal.last("", "entry")) is None:
        entry = await client.entries.create(
            plan.epoch,
            agent=plan.agent,
            configuration_sha256=configuration,
            tier=plan.tier,
            runs=plan.repeat,
            idempotency_key=f"evaluate-{nonce}",
        )
        journal.add("", "entry", entry=entry.model_dump(mode="json"))
        known = journal.last("", "entry")
    assert known is not None
    await at_this_service(client, journal, client.entries.get(known["entry"]["id"]))
    entry_id: str = known["entry"]["id"]
    runs = []
    for number in range(1, plan.repeat + 1):
        # Drawing again with the same nonce gives the same instances.
        drawn = await client.entries.draw(entry_id, run=number, nonce=f"{nonce}-{number}")
        if number not in {known["run"] for known in journal.all("", "draw")}:
            # With its proof and its receipt, which `verify-draw` and `verify-epoch` take.
            journal.add("", "draw", run=number, drawn=drawn.model_dump(mode="json"))
        runs.append([Problem(str(one.id), tuple(one.prompts), is_hidden=True) for one in drawn.instances])
    return entry_id, runs
