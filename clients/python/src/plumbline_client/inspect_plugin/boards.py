"""Runs on a board: one for each epoch of an evaluation."""

from __future__ import annotations

import asyncio

from inspect_ai.solver import TaskState

from .. import __version__
from ..async_client import AsyncClient

# By the evaluation's nonce and the epoch. The key makes creating a run safe to repeat.
_runs: dict[tuple[str, int], str] = {}
_creating = asyncio.Lock()


async def run_of(client: AsyncClient, state: TaskState) -> str | None:
    """Returns the run of a sample's epoch, created by whichever sample is first; None if none was asked for."""
    agent = state.metadata.get("board")
    if agent is None:
        return None
    place = (state.metadata["nonce"], state.epoch)
    async with _creating:
        if place not in _runs:
            run = await client.runs.create(
                agent=agent,
                suite=state.metadata["suite"],
                track=state.metadata["track"],
                metadata={"model": str(state.model), "harness": "inspect_ai", "harness_version": __version__},
                idempotency_key=f"inspect-{place[0]}-{place[1]}",
            )
            _runs[place] = str(run.id)
    return _runs[place]
