"""Tasks: the whole suite, its small version, and a hidden evaluation."""

from __future__ import annotations

import difflib
import hashlib
import json
import secrets
from typing import Any, Literal, get_args

from inspect_ai import Task, task
from inspect_ai._util.error import PrerequisiteError
from inspect_ai.dataset import MemoryDataset, Sample
from inspect_ai.model import ChatMessage, ChatMessageSystem, ChatMessageUser
from inspect_ai.solver import Solver

from ..calls import Profile, Track
from ..client import Client
from ..errors import PlumblineError
from .scorers import criteria, passes
from .solvers import one_shot, turn_by_turn

Mode = Literal["one-shot", "episodes"]


@task
def mineceraft(
    suite: str = "mineceraft",
    track: Track = "specified",
    profile: Profile = "mindcraft",
    mode: Mode = "one-shot",
    board: str | None = None,
) -> Task:
    """Builds of a whole suite.

    Args:
      suite: Name, or name@version.
      track: Track of the prompts: specified or brief.
      profile: Rules under which code becomes a build: mindcraft or published.
      mode: one-shot (one answer a turn) or episodes (tools that act in a world).
      board: Name of the agent on the board; without it the builds are graded and appear on no board.
    """
    return suite_task(suite, track, profile, mode, board)


@task
def mineceraft_lite(
    track: Track = "specified", profile: Profile = "mindcraft", mode: Mode = "one-shot", board: str | None = None
) -> Task:
    """Builds of the small suite, with the arguments of `mineceraft`."""
    return suite_task("mineceraft-lite", track, profile, mode, board)


@task
def mineceraft_hidden(
    epoch: str,
    agent: str,
    tier: Literal["dev", "official"] = "dev",
    runs: int = 1,
    profile: Profile = "mindcraft",
    mode: Mode = "one-shot",
) -> Task:
    """Answers to instances that nobody has seen. Their scores stay with the service until they are released.

    Args:
      epoch: Name of the epoch.
      agent: Name of the agent on the epoch's board.
      tier: dev or official.
      runs: Number of runs, each with its own draw.
      profile: Rules under which code becomes a build: mindcraft or published.
      mode: one-shot or episodes.
    """
    check_mode(mode, profile)
    given = {"agent": agent, "mode": mode, "profile": profile}
    configuration = hashlib.sha256(json.dumps(given, sort_keys=True).encode()).hexdigest()
    try:
        with Client() as client:
            system = client.tasks.system_prompt(None, profile=profile)
            entry = client.entries.create(epoch, agent=agent, configuration_sha256=configuration, tier=tier, runs=runs)
            draws = [client.entries.draw(entry.id, run=run, nonce=secrets.token_hex(16)) for run in range(1, runs + 1)]
    except PlumblineError as error:
        raise PrerequisiteError(str(error)) from error
    drawn = [(run, instance) for run, draw in enumerate(draws, 1) for instance in draw.instances]
    shared = {
        "entry": str(entry.id),
        "instances": len(drawn),
        "profile": profile,
        "category": "hidden",
        "family": "hidden",
    }
    samples = [
        sample(str(instance.id), system, instance.prompts, {**shared, "run": run, "instance": str(instance.id)})
        for run, instance in drawn
    ]
    return Task(
        dataset=MemoryDataset(samples, name=epoch),
        solver=solver_of(mode),
        scorer=[passes(), criteria()],
        metadata={
            "epoch": epoch,
            "entry": str(entry.id),
            "tier": tier,
            # What the service signed, which `verify-draw` and `verify-epoch` compare with what it says later.
            "registered": entry.model_dump(mode="json"),
            "draws": [draw.model_dump(mode="json") for draw in draws],
        },
    )


def suite_task(suite: str, track: Track, profile: Profile, mode: Mode, board: str | None) -> Task:
    """Returns the task for a suite, as the service has it now."""
    check_mode(mode, profile)
    try:
        with Client() as client:
            found = client.suites.get(suite)
            system = client.tasks.system_prompt(found.id, track, profile)
            tasks = list(client.tasks.all(found.id, track=track))
    except PlumblineError as error:
        raise PrerequisiteError(str(error)) from error
    shared: dict[str, Any] = {"suite": found.id, "track": track, "profile": profile, "mode": mode}
    shared["nonce"] = secrets.token_hex(16)
    if board is not None:
        shared["board"] = board
    samples = [
        sample(
            one.id,
            system,
            one.prompts,
            {**shared, "task": one.id, "family": one.family, "category": one.category or "none"},
        )
        for one in tasks
    ]
    return Task(
        dataset=MemoryDataset(samples, name=found.id),
        solver=solver_of(mode),
        scorer=[passes(), criteria()],
        version=found.version,
        metadata={"suite": found.id, "track": track, "profile": profile, "mode": mode},
    )


def check_mode(mode: Mode, profile: Profile) -> None:
    """Refuses modes that do not exist, and episodes with other rules than mindcraft's."""
    if mode not in get_args(Mode):
        near = difflib.get_close_matches(str(mode), get_args(Mode), n=1)
        hint = f"did you mean {near[0]}?" if near else f"there are {', '.join(get_args(Mode))}"
        raise PrerequisiteError(f"no mode is called {mode!r}; {hint}")
    if mode == "episodes" and profile == "published":
        raise PrerequisiteError("episodes have the rules of mindcraft; leave profile=published out")


def sample(identifier: str, system: str, prompts: list[str], metadata: dict[str, Any]) -> Sample:
    """Returns a sample, whose first turn is in its input."""
    messages: list[ChatMessage] = [ChatMessageSystem(content=system), ChatMessageUser(content=prompts[0])]
    return Sample(id=identifier, input=messages, metadata={**metadata, "prompts": prompts, "turns": len(prompts)})


def solver_of(mode: Mode) -> Solver:
    """Returns the solver of a mode."""
    return turn_by_turn() if mode == "episodes" else one_shot()
