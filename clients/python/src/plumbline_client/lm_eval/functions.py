"""Functions that the task files name: the data set, and the scores of an answer."""

from __future__ import annotations

import os
from typing import Any

from ..calls import Track
from ..client import Client
from ..trainers.labels import CRITERIA, components, request

METRICS = CRITERIA


def load(suite: str = "mineceraft", track: Track = "specified", **metadata: Any) -> dict[str, Any]:
    """Returns the tasks of one turn as a data set."""
    from datasets import Dataset  # type: ignore[import-untyped]

    with Client() as client:
        found = client.suites.get(suite)
        system = client.tasks.system_prompt(found.id, track)
        rows = [
            {"prompt": f"{system}\n{one.prompts[0]}", "task": one.id, "suite": found.id, "family": one.family}
            for one in client.tasks.all(found.id, track=track)
            if one.turns == 1
        ]
    return {"test": Dataset.from_list(rows)}


_clients: dict[int, Client] = {}


def process_results(doc: dict[str, Any], results: list[str]) -> dict[str, float]:
    """Returns the scores of one answer; a criterion that does not apply is left out of its mean.

    Raises an error if the service cannot grade it: a failure of ours is no score.
    """
    client = _clients.setdefault(os.getpid(), Client())
    asked = request({"task": doc["task"], "suite": doc["suite"], "profile": "mindcraft"}, [results[0]])
    graded = client.rewards.grade(**asked)
    found = components(graded.model_dump(mode="json"), METRICS)
    return {name: value for name, value in found.items() if value is not None}
