"""Runs on a board: one for each epoch of an evaluation."""

from __future__ import annotations

import asyncio
from importlib.metadata import version
from typing import Any
from weakref import WeakKeyDictionary

from inspect_ai.solver import TaskState

from ..async_client import AsyncClient

# By the evaluation's nonce and the epoch. The key makes creating a run safe to repeat.
_runs: dict[tuple[str, int], str] = {}
_begun: set[tuple[str, int]] = set()
# Evaluations whose key is live.
_known: set[str] = set()
# A lock belongs to one loop, and each evaluation of a process has a loop of its own.
_creating: WeakKeyDictionary[asyncio.AbstractEventLoop, asyncio.Lock] = WeakKeyDictionary()


async def must_have_key(client: AsyncClient, state: TaskState) -> None:
    """Raises `Unauthorized` before a model is asked, if the key is none of the service's.

    What it may do shows when the first sample is submitted. A hidden evaluation has registered its entry with the key already.
    """
    nonce = state.metadata.get("nonce")
    if nonce is not None and nonce not in _known:
        await client.service.quota()
        _known.add(nonce)


async def run_of(client: AsyncClient, state: TaskState, *, anew: bool = False) -> str | None:
    """Returns the run of a sample's epoch; None if none was asked for.

    An evaluation that is tried again goes on with the open run of the same name, model and epoch. `anew` begins another
    one, unless that was done already.
    """
    agent = state.metadata.get("board")
    if agent is None:
        return None
    place = (state.metadata["nonce"], state.epoch)
    async with _creating.setdefault(asyncio.get_running_loop(), asyncio.Lock()):
        if place not in _runs and not anew:
            _runs[place] = await open_run(client, state, agent) or await begun(client, state, agent, place)
        elif place not in _begun and anew:
            _runs[place] = await begun(client, state, agent, place)
    return _runs[place]


async def open_run(client: AsyncClient, state: TaskState, agent: str) -> str | None:
    """Finds the run to go on with."""
    suite = state.metadata["suite"]
    found = await client.runs.list(state="open", suite=suite, agent=agent, limit=1000)
    for run in found.runs:
        is_ours = run.agent == agent and run.track == state.metadata["track"]
        if is_ours and run.metadata == metadata_of(state):
            return str(run.id)
    return None


async def begun(client: AsyncClient, state: TaskState, agent: str, place: tuple[str, int]) -> str:
    """Creates a run."""
    manner = ", episodes" if state.metadata.get("mode") == "episodes" else ""
    run = await client.runs.create(
        agent=agent,
        suite=state.metadata["suite"],
        track=state.metadata["track"],
        metadata=metadata_of(state),
        card={
            "harness": {"name": f"inspect_ai{manner}", "version": version("inspect_ai")},
            "model": {"name": str(state.model)},
        },
        idempotency_key=f"inspect-{place[0]}-{place[1]}",
    )
    _begun.add(place)
    return str(run.id)


def metadata_of(state: TaskState) -> dict[str, Any]:
    """Returns what tells the run of an epoch."""
    known = {"harness": "inspect_ai", "model": str(state.model), "epoch": state.epoch}
    return {**known, "mode": "episodes"} if state.metadata.get("mode") == "episodes" else known
