"""A batch of logs to grade: what was sent, what came back, and what has to be sent again."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from pydantic import BaseModel
from pydantic_core import from_json

from . import errors
from .calls import written
from .models import BatchItem, Problem

Request = Mapping[str, Any] | BaseModel | bytes
"""A request to grade, as `rewards.grade` takes it: a mapping, `models.NewGrade`, or one of them written as JSON."""

MOST_LOGS = 1_000
"""Logs that are sent in one body; the service takes more, but a body that breaks off is sent again."""
MOST_BYTES = 16 << 20
"""Bytes of one body, unless a single log has more."""


class Batch:
    """Logs that wait for their results."""

    def __init__(self, requests: Iterable[Request]) -> None:
        # What is written already is sent as it is.
        self._waiting = {
            index: request if isinstance(request, bytes) else written(request) for index, request in enumerate(requests)
        }
        self._sent: list[int] = []
        # What the service said about those that wait.
        self._failures: dict[int, dict[str, Any]] = {}

    @property
    def is_done(self) -> bool:
        """Whether all results are there."""
        return not self._waiting

    def body(self) -> bytes:
        """Returns the next body: as many of the waiting logs as fit."""
        self._sent = []
        size = 0
        for index, line in self._waiting.items():
            if self._sent and (size + len(line) > MOST_BYTES or len(self._sent) == MOST_LOGS):
                break
            self._sent.append(index)
            size += len(line) + 1
        return b"\n".join(self._waiting[index] for index in self._sent)

    def take(self, line: bytes) -> dict[str, Any] | None:
        """Takes a line of the answer. Returns the item with the index of its log in the batch, or None if the service
        failed for the time being, so that the log is sent again."""
        try:
            item: dict[str, Any] = from_json(line)
        except ValueError as cause:
            raise errors.UnreadableAnswer(f"a result cannot be read: {cause}") from cause
        index = self._sent[item["index"]]
        error = item.get("error")
        if error is not None and error.get("retryable") and error.get("type", "").rsplit(":", 1)[-1] != "deadline":
            self._failures[index] = error
            return None
        self._waiting.pop(index)
        item["index"] = index
        return item

    def give_up(self, error: errors.PlumblineError) -> list[dict[str, Any]]:
        """Returns an item without a reward for each log that still waits."""
        problem = error.problem if isinstance(error, errors.ApiError) else unreached(error)
        told = problem.model_dump(mode="json", exclude_none=True)
        whys = ((i, self._failures.get(i, told)) for i in self._waiting)
        left = [{"index": i, "status": why["status"], "reward": None, "error": why} for i, why in whys]
        self._waiting.clear()
        return left


def unreached(error: errors.PlumblineError) -> Problem:
    """Returns the problem that stands for a service that did not answer."""
    return Problem(type=errors.NOT_REACHED, title="Not reached", status=503, detail=str(error), retryable=True)


def item(raw: Mapping[str, Any]) -> BatchItem:
    """Returns a result as a model."""
    return BatchItem.model_validate(raw)
