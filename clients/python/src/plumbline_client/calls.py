"""What both clients share: how a request is written, an answer read, and when a request is sent again."""

from __future__ import annotations

import math
import os
import random
import time
import uuid
from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field
from email.utils import parsedate_to_datetime
from functools import cache
from json import dumps
from typing import Any, Literal, Protocol, TypeVar, cast
from urllib.parse import quote

import httpx
from pydantic import TypeAdapter, ValidationError
from pydantic_core import PydanticSerializationError, from_json, to_json, to_jsonable_python

from . import errors
from .models import Problem

T = TypeVar("T")

Track = Literal["specified", "brief"]
Profile = Literal["mindcraft", "published"]

ANY: type[Any] = object
"""Type of an answer without a schema."""

JSON_LINES = "application/x-ndjson"

TYPES_OF_MISSING = ("NAType", "NaTType")
"""Names of the types of the missing values of pandas."""


class Caller(Protocol):
    """What the resources of the blocking client call."""

    def _call(
        self,
        kind: type[T],
        method: str,
        path: str,
        *,
        params: Mapping[str, Any] | None = None,
        json: Any = None,
        content: bytes | None = None,
        once: str | None = None,
        is_repeatable: bool = False,
    ) -> T: ...


class AsyncCaller(Protocol):
    """What the resources of the asynchronous client call."""

    async def _call(
        self,
        kind: type[T],
        method: str,
        path: str,
        *,
        params: Mapping[str, Any] | None = None,
        json: Any = None,
        content: bytes | None = None,
        once: str | None = None,
        is_repeatable: bool = False,
    ) -> T: ...


def deadline_of_environment() -> float:
    """Returns the seconds within which a call may be sent again: `PLUMBLINE_DEADLINE_S`, or 120.

    Raises PlumblineError if the variable is not a number of seconds.
    """
    told = os.environ.get("PLUMBLINE_DEADLINE_S", "").strip() or "120"
    try:
        seconds = float(told)
    except ValueError:
        seconds = math.nan
    if not seconds >= 0:
        raise errors.PlumblineError(f"PLUMBLINE_DEADLINE_S is {told!r}: expected seconds, such as 30 or 0.5")
    return seconds


@dataclass(frozen=True)
class Retries:
    """When a request is sent again.

    The service's `Retry-After` is honoured. Otherwise the delay doubles from `first_s` up to `longest_s`, with full
    jitter. Nothing is sent again after `deadline_s` seconds, by default `PLUMBLINE_DEADLINE_S` or 120, or `most` retries.
    """

    most: int = 20
    deadline_s: float = field(default_factory=deadline_of_environment)
    first_s: float = 0.25
    longest_s: float = 20.0


@dataclass
class Attempts:
    """The attempts of one call."""

    retries: Retries
    is_repeatable: bool
    began: float = field(default_factory=time.monotonic)
    made: int = 0

    def delay(self, error: errors.PlumblineError, was_sent: bool) -> float:
        """Returns the seconds to wait before the next attempt.

        Raises the error if there is to be none: it cannot pass, it is not known whether the request was carried out and
        it may not be carried out twice, or the attempts or the time are used up.
        """
        asked = None
        jittered = self.pause()
        if isinstance(error, errors.ApiError):
            # With these the service says that it did nothing.
            is_own = error.problem.type.startswith("urn:plumbline:")
            is_refusal = (
                error.status == 429 or (error.status == 503 and is_own) or error.kind == "idempotency-in-flight"
            )
            # It may have passed while the work waited; otherwise the same work takes as long again.
            is_too_long = error.kind == "deadline" and self.made > 1
            if not error.is_retryable or is_too_long or not (is_refusal or self.is_repeatable):
                raise error
            asked = error.retry_after_s
        elif was_sent and not self.is_repeatable:
            raise error
        if self.made > self.retries.most:
            raise error
        delay = jittered if asked is None else asked + min(jittered, 1.0)
        if time.monotonic() - self.began + delay > self.retries.deadline_s:
            raise error
        return delay

    def pause(self) -> float:
        """Counts an attempt, and returns the seconds before the next one: longer each time."""
        self.made += 1
        # A float has no larger power of two.
        doubled = 2.0 ** min(self.made - 1, 60)
        return random.uniform(0.0, min(self.retries.longest_s, self.retries.first_s * doubled))


@cache
def adapter(kind: Hashable) -> TypeAdapter[Any]:
    """Returns what reads values of a type."""
    return TypeAdapter(cast(Any, kind))


def new_key() -> str:
    """Returns an `Idempotency-Key` for one logical call."""
    return str(uuid.uuid4())


def quoted(value: object, safe: str = "") -> str:
    """Returns a value as a segment of a path."""
    return quote(str(value), safe=safe)


def given(members: dict[str, Any]) -> dict[str, Any]:
    """Leaves out what was not given."""
    return {name: value for name, value in members.items() if value is not None}


def written(value: Any) -> bytes:
    """Writes a body: plain values, models, identifiers and times. Raises `Unwritable` if it cannot be JSON.

    Half of a surrogate pair, as in the text of a model that was cut amid a character, is written as an escape, which the
    service reads as U+FFFD.
    """
    try:
        try:
            return to_json(value, exclude_none=True, by_alias=True, fallback=plain)
        except (PydanticSerializationError, ValueError) as error:
            if "surrogates not allowed" not in str(error):
                raise
            return dumps(to_jsonable_python(value, exclude_none=True, by_alias=True, fallback=plain)).encode()
    except (PydanticSerializationError, TypeError, ValueError) as error:
        raise errors.Unwritable(f"the request cannot be written as JSON: {error}") from error


def plain(value: Any) -> Any:
    """Returns a value of NumPy, pandas, PyArrow or PyTorch as Python has it; their missing value is None."""
    if type(value).__name__ in TYPES_OF_MISSING:
        return None
    for name in ("as_py", "tolist", "to_pylist"):
        convert = getattr(value, name, None)
        if callable(convert):
            return convert()
    raise TypeError(f"{value!r} is of the type {type(value).__module__}.{type(value).__qualname__}")


def parameters(params: Mapping[str, Any] | None) -> dict[str, str]:
    """Writes the parameters of a query."""
    texts = {}
    for name, value in (params or {}).items():
        if value is not None:
            texts[name] = str(value).lower() if isinstance(value, bool) else str(value)
    return texts


def headers(json: Any, content: bytes | None, once: str | None) -> dict[str, str]:
    """Returns the headers of a request."""
    sent = {}
    if json is not None:
        sent["content-type"] = "application/json"
    elif content is not None:
        sent["content-type"] = "application/octet-stream"
    if once is not None:
        sent["idempotency-key"] = once
    return sent


def read(kind: type[T], response: httpx.Response) -> T:
    """Reads an answer, or raises the error that it is."""
    if response.is_error:
        raise problem_of(response)
    if response.is_redirect:
        where = response.headers.get("location", "another address")
        raise errors.UnreadableAnswer(f"{response.url} answered with a redirect to {where}; give that as the address")
    answer: Any
    if kind is bytes:
        answer = response.content
    elif kind is str and "json" not in response.headers.get("content-type", ""):
        answer = response.text
    else:
        try:
            parsed = from_json(response.content)
            answer = parsed if kind is ANY or kind is str else adapter(cast(Hashable, kind)).validate_python(parsed)
        except (ValueError, ValidationError) as error:
            message = f"{response.request.method} {response.url}: the answer is not as this client expects; is this a plumbline service? {error}"
            raise errors.UnreadableAnswer(message) from error
    return answer  # type: ignore[no-any-return]


def problem_of(response: httpx.Response) -> errors.PlumblineError:
    """Returns the error that a response is, also if something in between answered."""
    try:
        problem = Problem.model_validate(from_json(response.content))
    except (ValueError, ValidationError):
        text = response.text.strip()[:500]
        problem = Problem(
            type="about:blank",
            title=response.reason_phrase,
            status=max(response.status_code, 400),
            detail=text or response.reason_phrase or "no text",
            # A proxy or a service that starts.
            retryable=response.status_code in (429, 502, 503, 504),
        )
    return errors.of_problem(problem, retry_after(response.headers.get("retry-after")))


def retry_after(header: str | None) -> float | None:
    """Reads a `Retry-After`: seconds, or a date."""
    if header is None:
        return None
    try:
        return max(0.0, float(header))
    except ValueError:
        pass
    try:
        return max(0.0, parsedate_to_datetime(header).timestamp() - time.time())
    except ValueError:
        return None


def not_reached(error: httpx.TransportError, url: str) -> tuple[errors.NotReached, bool]:
    """Returns the error for a failed connection, and whether the service may have received the request."""
    never_sent = (httpx.ConnectError, httpx.ConnectTimeout, httpx.PoolTimeout, httpx.UnsupportedProtocol)
    reason = str(error) or type(error).__name__
    return errors.NotReached(f"no answer from {url}: {reason}"), not isinstance(error, never_sent)
