"""A reward function for TRL's GRPO and RLOO trainers.

`GRPOTrainer(reward_funcs=plumbline_client.trainers.trl.plumbline, ...)`, with a data set that has the columns of
`GET /v1/tasks?format=trl`: `prompt`, `task` and, if wanted, `suite`, `profile` and `scheme`.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from typing import Any

from .. import errors
from ..batches import Request
from ..models import Problem
from .labels import CRITERIA, components, is_scheme, refuse_misspelt, request
from .loops import coalescer

THOUGHTS = ("reasoning", "thinking")
"""Types of parts that are no answer."""
LOGGER = logging.getLogger(__name__)


async def plumbline(
    prompts: Sequence[Any],
    completions: Sequence[Any],
    task: Sequence[Any],
    suite: Sequence[str | None] | None = None,
    profile: Sequence[str | None] | None = None,
    scheme: Sequence[str | None] | None = None,
    log_extra: Callable[[str, list[Any]], None] | None = None,
    log_metric: Callable[[str, float], None] | None = None,
    **columns: Any,
) -> list[float | None]:
    """Returns the reward of each completion; None, which the trainer leaves out, where the service failed to give one.

    Raises an error if the data set is wrong: if a row names no task of the suite, or a column looks like one of these
    misspelt.
    """
    # Data sets for other frameworks call it otherwise; a column of numbers is their own.
    others = [columns.get(name) for name in ("reward_scheme", "reward")]
    schemes = (column for column in others if isinstance(column, list) and any(map(is_scheme, column)))
    scheme = next(schemes, None) if is_empty(scheme) else scheme
    given = {"task": task, "scheme": scheme, "suite": suite, "profile": profile}
    shown = {name: first_scheme(column) for name, column in columns.items()}
    refuse_misspelt({**shown, **{name: None for name, column in given.items() if not is_empty(column)}})
    requests: list[Request] = []
    for index, completion in enumerate(completions):
        label = {"task": task[index], "reward": at(scheme, index), "suite": at(suite, index)}
        requests.append(request({**label, "profile": at(profile, index)}, texts_of(completion)))
    results: list[dict[str, Any] | None] = [None] * len(requests)
    async for item in coalescer().client.rewards.raw_batch(requests):
        results[item["index"]] = item
    rewards: list[float | None] = []
    for raw in results:
        if raw is not None and raw["reward"] is None and not raw["error"].get("retryable"):
            raise errors.of_problem(Problem.model_validate(raw["error"]))
        rewards.append(None if raw is None else raw["reward"])
    failed = [raw for raw in results if raw is not None and raw["reward"] is None]
    if failed:
        LOGGER.warning("%d of %d samples have no reward: %s", len(failed), len(results), failed[0]["error"]["detail"])
    told = [components((raw or {}).get("result") or {}, CRITERIA) for raw in results]
    if log_extra is not None:
        for name in CRITERIA:
            log_extra(f"plumbline/{name}", [one[name] for one in told])
    if log_metric is not None:
        log_metric("plumbline/failed", sum(reward is None for reward in rewards) / max(len(rewards), 1))
    return rewards


def is_empty(column: Sequence[Any] | None) -> bool:
    """Whether no row has a value: data sets that were joined have such columns."""
    return column is None or all(value is None for value in column)


def first_scheme(column: Any) -> Any:
    """Returns the first value of a column that is a scheme; None if there is none."""
    return next(filter(is_scheme, column), None) if isinstance(column, list) else None


def at(column: Sequence[str | None] | None, index: int) -> str | None:
    """Returns the value of a column that a data set may lack."""
    return None if column is None else column[index]


def texts_of(completion: Any) -> list[str]:
    """Returns the texts of a completion, which is a text, or messages of a conversation; None is an empty text."""
    if completion is None:
        return [""]
    if isinstance(completion, str):
        return [completion]
    own = [message for message in completion if message.get("role") == "assistant"]
    texts = [text_of(message.get("content")) for message in own]
    return texts or [""]


def text_of(content: Any) -> str:
    """Returns the text of a message's content, which may come in parts."""
    if isinstance(content, list):
        parts = (part for part in content if isinstance(part, dict) and part.get("type") not in THOUGHTS)
        return "".join(part.get("text") or "" for part in parts)
    return content or ""
