"""A reward function for TRL's GRPO and RLOO trainers.

`GRPOTrainer(reward_funcs=plumbline_client.trainers.trl.plumbline, ...)`, with a data set that has the columns of
`GET /v1/tasks?format=trl`: `prompt`, `task` and, if wanted, `suite`, `profile` and `scheme`.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from .. import errors
from ..batches import Request
from ..models import Problem
from .labels import CRITERIA, components, is_missing, is_scheme, refuse_misspelt, request
from .loops import coalescer

THOUGHTS = ("reasoning", "thinking")
"""Types of parts that are no answer."""
OPENING = re.compile(
    r"(?:<(?:think|thinking|thought|reasoning|scratchpad|seed:think|longcat_think)>|\[THINK\]|◁think▷"
    r"|<\|START_THINKING\|>|<\|begin_of_thought\|>|<\|inner_prefix\|>|<\|channel\|>analysis<\|message\|>)\Z",
    re.IGNORECASE,
)
"""A tag at the end of a prompt, which the completion goes on from."""
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
    """Returns the reward of each completion; None, which the trainer leaves out, where the service failed to give one, and
    where a row has no task, as those of other data sets that were joined.

    Raises an error if the data set is wrong: if a row names a task that the suite does not have, if a column looks like
    one of these misspelt, or if a completion is neither a text nor messages.
    """
    if len(completions) != len(task):
        raise ValueError(f"there are {len(completions)} completions and {len(task)} tasks")
    # Data sets for other frameworks call it otherwise; a column of numbers is their own.
    others = [columns.get(name) for name in ("reward_scheme", "reward")]
    schemes = (column for column in others if isinstance(column, list) and any(map(is_scheme, column)))
    scheme = next(schemes, None) if is_empty(scheme) else scheme
    given = {"task": task, "scheme": scheme, "suite": suite, "profile": profile}
    shown = {name: first_scheme(column) for name, column in columns.items()}
    refuse_misspelt({**shown, **{name: None for name, column in given.items() if not is_empty(column)}})
    rows = [index for index in range(len(completions)) if isinstance(task[index], str) or not is_missing(task[index])]
    requests: list[Request] = []
    for index in rows:
        label = {"task": task[index], "reward": at(scheme, index), "suite": at(suite, index)}
        try:
            texts = with_opening(prompts[index] if index < len(prompts) else None, texts_of(completions[index]))
            requests.append(request({**label, "profile": at(profile, index)}, texts))
        except ValueError as error:
            raise ValueError(f"row {index}: {error}") from error
    results: list[dict[str, Any] | None] = [None] * len(completions)
    async for item in coalescer().client.rewards.raw_batch(requests):
        results[rows[item["index"]]] = item
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
        log_metric("plumbline/failed", sum(rewards[row] is None for row in rows) / max(len(rows), 1))
    return rewards


def is_empty(column: Sequence[Any] | None) -> bool:
    """Whether no row has a value: data sets that were joined have such columns."""
    return column is None or all(is_missing(value) for value in column)


def first_scheme(column: Any) -> Any:
    """Returns the first value of a column that is a scheme; None if there is none."""
    return next(filter(is_scheme, column), None) if isinstance(column, list) else None


def at(column: Sequence[str | None] | None, index: int) -> str | None:
    """Returns the value of a column that a data set may lack."""
    return None if column is None else column[index]


def texts_of(completion: Any) -> list[str]:
    """Returns the texts of a completion, which is a text, or messages of a conversation; None is an empty text.

    Raises ValueError if it is something else: a reward of 0 would hide that nothing was read.
    """
    if is_missing(completion):
        return [""]
    if isinstance(completion, str):
        return [completion]
    messages = [completion] if isinstance(completion, Mapping) else completion
    if not isinstance(messages, Sequence) or isinstance(messages, bytes):
        raise unread("a completion is a text or messages", completion)
    own = [message for message in messages if role_of(message) == "assistant"]
    return [text_of(message.get("content")) for message in own] or [""]


def with_opening(prompt: Any, texts: list[str]) -> list[str]:
    """Puts the tag with which a prompt opens a thought before the completion: thoughts that never end are no answer."""
    last = prompt[-1] if isinstance(prompt, Sequence) and not isinstance(prompt, str) and prompt else prompt
    content = last.get("content") if isinstance(last, Mapping) else last
    text = text_of(content).rstrip() if isinstance(content, (str, list)) else ""
    opening = OPENING.search(text)
    if opening is None or texts[0].lstrip().startswith(opening[0]):
        return texts
    return [opening[0] + texts[0], *texts[1:]]


def role_of(message: Any) -> str:
    """Returns who speaks."""
    if not isinstance(message, Mapping) or not isinstance(message.get("role"), str):
        raise unread("a message has a role and content", message)
    return str(message["role"]).lower()


def text_of(content: Any) -> str:
    """Returns the text of a message's content, which may come in parts."""
    if content is None or isinstance(content, str):
        return content or ""
    if not isinstance(content, Sequence) or not all(isinstance(part, (str, Mapping)) for part in content):
        raise unread("the content of a message is a text or parts", content)
    texts = ({"text": part} if isinstance(part, str) else part for part in content)
    return "".join(part.get("text") or "" for part in texts if part.get("type") not in THOUGHTS)


def unread(expected: str, found: object) -> ValueError:
    """Returns the error for what is neither."""
    return ValueError(f"{expected}, and this is {repr(found)[:200]}")
