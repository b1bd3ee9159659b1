"""A reward function for verl: `reward.custom_reward_function.path=pkg://plumbline_client.trainers.verl`.

The data set is that of `GET /v1/tasks?format=verl`: the ground truth of a row is a label, JSON with `task`, `suite`,
`profile` and `reward`. The function is asynchronous, and concurrent calls go as batches. For the reward manager `remote`,
which takes no asynchronous function, name `compute_score_sync`.
"""

from __future__ import annotations

from typing import Any

from ..coalescer import Coalescer
from .labels import CRITERIA, components, request
from .loops import Background, coalescer


async def compute_score(
    data_source: str,
    solution_str: str,
    ground_truth: Any,
    extra_info: dict[str, Any] | None = None,
    *,
    url: str | None = None,
    **others: Any,
) -> dict[str, float]:
    """Returns `score` and `acc`, and each criterion as a number of its own (-1 where it does not apply).

    verl has no way to leave a sample out, so a failure of the service that does not pass is raised, never a score.
    """
    return await scored(coalescer(url), ground_truth, solution_str)


def compute_score_sync(
    data_source: str,
    solution_str: str,
    ground_truth: Any,
    extra_info: dict[str, Any] | None = None,
    *,
    url: str | None = None,
    **others: Any,
) -> dict[str, float]:
    """Does the same for callers that wait."""

    async def work() -> dict[str, float]:
        return await scored(coalescer(url), ground_truth, solution_str)

    return Background.run(work())


async def scored(grader: Coalescer, label: Any, text: str) -> dict[str, float]:
    """Grades one text. All results have the same members, as verl needs it."""
    result = (await grader.raw_grade(request(label, [text])))["result"]
    found = components(result, CRITERIA)
    criteria = {name: -1.0 if value is None else value for name, value in found.items()}
    return {"score": result["reward"], "acc": float(result["overall"]), **criteria}
