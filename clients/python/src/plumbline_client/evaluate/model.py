"""A model behind an endpoint that speaks OpenAI's Chat Completions."""

from __future__ import annotations

import asyncio
import random
import re
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Protocol

import httpx

from ..calls import retry_after
from ..errors import PlumblineError
from ..refused import clean
from .plan import Sampling

Message = dict[str, Any]

MOST_EMPTY = 3
"""Answers without a choice after which an endpoint is not asked again."""


class ModelError(PlumblineError):
    """The endpoint gave no answer, also after all retries."""


class EndpointRefuses(ModelError):
    """The endpoint refuses every request: the key, the address or the model's name is wrong."""


@dataclass(frozen=True)
class Usage:
    """Tokens of one answer. None where the endpoint did not say."""

    input: int | None = None
    output: int | None = None
    cached_input: int | None = None
    reasoning: int | None = None


@dataclass(frozen=True)
class Completion:
    """An answer of the model."""

    text: str
    """What the model wrote; empty if it wrote nothing."""
    finish_reason: str | None
    """Why it stopped: `stop`, `length`, `content_filter` and others."""
    usage: Usage
    model: str | None
    """Name of the model that answered, as the endpoint tells it."""
    seconds: float
    refusal: str | None = None
    reasoning: str | None = None

    def as_json(self) -> dict[str, Any]:
        """Returns it for the journal."""
        return asdict(self)

    @classmethod
    def of_json(cls, found: dict[str, Any]) -> Completion:
        """Reads it from the journal."""
        return cls(**{**found, "usage": Usage(**found["usage"])})


@dataclass(frozen=True)
class Failed:
    """A request that brought no answer."""

    reason: str
    is_billed: bool
    """Whether it may have been paid for."""
    error: ModelError | None = None
    """What to raise, if it is no use to ask again."""
    is_empty: bool = False
    """Whether the endpoint answered with success and without an answer."""
    is_misnamed: bool = False
    """Whether the limit of tokens has another name, under which to ask again at once."""
    after_s: float | None = None
    """Seconds to wait before the next try, if the endpoint says so."""


class Meter(Protocol):
    """Counts the requests for an answer."""

    def begin(self) -> None:
        """Called before a request is sent. May raise an error, which ends the tries."""

    def end(self, reason: str, is_billed: bool) -> None:
        """Called after a request that brought no answer; `is_billed` says whether it may have been paid for."""


class Model:
    """A model behind an endpoint. 429 and 5xx, timeouts and broken connections are retried until `patience_s` is over,
    not before the `Retry-After` of the endpoint."""

    def __init__(
        self,
        name: str,
        base_url: str,
        key: str | None,
        sampling: Sampling,
        *,
        timeout_s: float = 600.0,
        patience_s: float = 900.0,
        first_delay_s: float = 1.0,
    ) -> None:
        self.name, self._sampling = name, sampling
        self._patience_s, self._first_delay_s = patience_s, first_delay_s
        self._key = key = (key or "").strip()
        if not key.isascii() or not key.isprintable():
            raise EndpointRefuses("the endpoint's key has characters that no header takes; look at its variable")
        headers = {"authorization": f"Bearer {key}"} if key else {}
        limits = httpx.Limits(max_connections=None, max_keepalive_connections=100)
        timeout = httpx.Timeout(timeout_s, connect=min(timeout_s, 30.0))
        self._http = httpx.AsyncClient(headers=headers, timeout=timeout, limits=limits)
        try:
            base = httpx.URL(base_url)
        except (httpx.InvalidURL, TypeError) as error:
            raise EndpointRefuses(f"the endpoint's address is none: {error}") from error
        if base.scheme not in ("http", "https") or not base.host:
            raise EndpointRefuses("the endpoint's address begins with http:// or https://, and names a host")
        path = base.path.rstrip("/").removesuffix("/chat/completions")
        self._url = base.copy_with(path=f"{path}/chat/completions")
        # What is shown has neither passwords nor parameters.
        self.shown = str(self._url.copy_with(username="", password="", query=None)).rstrip("?")
        self._most_tokens = "max_tokens"

    async def close(self) -> None:
        """Closes the connections."""
        await self._http.aclose()

    async def answer(self, messages: Sequence[Message], run: int, meter: Meter) -> Completion:
        """Returns the model's answer to a conversation. `run` is the index of the run, from 0, for the seed.

        A refusal (a status from 400 to 499, 503 or 529) is not paid for; any other request without an answer may be.
        """
        until, delay, tries, empty = time.monotonic() + self._patience_s, self._first_delay_s, 0, 0
        while True:
            request, tries = self._request(messages, run), tries + 1
            meter.begin()
            done = await self._try(request)
            if isinstance(done, Completion):
                return done
            meter.end(done.reason, done.is_billed)
            if done.error is not None:
                raise done.error
            if done.is_misnamed:
                continue
            empty += done.is_empty
            if empty == MOST_EMPTY:
                raise ModelError(f"{self.shown}: {done.reason}, {empty} times")
            pause = (
                random.uniform(0.5, 1.0) * delay if done.after_s is None else done.after_s + random.uniform(0.0, 1.0)
            )
            delay = min(60.0, 2.0 * delay)
            if time.monotonic() + pause > until:
                raise ModelError(f"no answer from {self.shown} after {tries} tries: {done.reason}")
            await asyncio.sleep(pause)

    async def _try(self, request: httpx.Request) -> Completion | Failed:
        """Sends a request once."""
        began, named = time.monotonic(), self._most_tokens
        try:
            response = await self._http.send(request)
            if not response.is_success:
                return self._failed(response, named)
            return read(response, time.monotonic() - began)
        except NoAnswer as error:
            return Failed(self._without_key(str(error)), is_billed=True, is_empty=True)
        except EndpointRefuses as refused:
            return Failed(str(refused), is_billed=True, error=refused)
        except (httpx.LocalProtocolError, httpx.UnsupportedProtocol, httpx.TooManyRedirects) as error:
            reason = self._without_key(f"{self.shown}: {error}")
            return Failed(reason, is_billed=False, error=EndpointRefuses(reason))
        except httpx.RequestError as error:
            is_sent = not isinstance(error, (httpx.ConnectError, httpx.ConnectTimeout, httpx.PoolTimeout))
            return Failed(self._without_key(str(error) or type(error).__name__), is_billed=is_sent)

    def _failed(self, response: httpx.Response, named: str) -> Failed:
        """Reads an error answer. `named` is the name that the limit of tokens had in the request."""
        status, text = response.status_code, response.text
        reason = self._without_key(f"{status} {excerpt(text)}")
        failed = Failed(reason, is_billed=status >= 500 and status not in (503, 529))
        if named == "max_tokens" and status == 400 and "max_completion_tokens" in text:
            # Newer models take their limit under another name, and say so.
            self._most_tokens = "max_completion_tokens"
            return replace(failed, is_misnamed=True)
        if status in (401, 402, 403, 404) or "insufficient_quota" in text:
            return replace(failed, error=EndpointRefuses(f"{self.shown} refuses: {reason}"))
        if status not in (408, 409, 425, 429) and status < 500:
            return replace(failed, error=ModelError(f"{self.shown} refuses this request: {reason}"))
        return replace(failed, after_s=retry_after(response.headers.get("retry-after")))

    def _without_key(self, text: str) -> str:
        """Endpoints repeat in their errors what they were sent."""
        # A stand-in for a key, such as "x" or "EMPTY", is no secret and occurs in words.
        return text.replace(self._key, "…") if self._key and len(self._key) > 5 else text

    def _request(self, messages: Sequence[Message], run: int) -> httpx.Request:
        sampling = self._sampling
        request: dict[str, Any] = {
            "model": self.name,
            "messages": list(messages),
            "temperature": sampling.temperature,
            "top_p": sampling.top_p,
            self._most_tokens: sampling.max_tokens,
            "reasoning_effort": sampling.reasoning_effort,
            "seed": None if sampling.seed is None else sampling.seed + run,
        }
        members = {name: value for name, value in request.items() if value is not None} | sampling.extra
        return self._http.build_request("POST", self._url, json=members)


class NoAnswer(PlumblineError):
    """The endpoint answered with success and without an answer."""


def read(response: httpx.Response, seconds: float) -> Completion:
    """Reads an answer, with the variants of endpoints that call themselves compatible.

    Raises `NoAnswer` if there is none, and `EndpointRefuses` if the endpoint answers only as a stream.
    """
    if "text/event-stream" in response.headers.get("content-type", ""):
        raise EndpointRefuses(f"{response.url.host} answers as a stream although none was asked for")
    try:
        body = response.json()
        choice = body["choices"][0]
        message = choice.get("message") or {}
        content, refusal = message.get("content"), message.get("refusal")
    except (ValueError, KeyError, IndexError, TypeError, AttributeError):
        raise NoAnswer(f"an answer without choices: {excerpt(response.text)}") from None
    if isinstance(content, list):
        parts = [part.get("text") for part in content if isinstance(part, dict)]
        content = "".join(part for part in parts if isinstance(part, str))
    text = content if isinstance(content, str) else refusal if isinstance(refusal, str) else ""
    reasoning = message.get("reasoning_content") or message.get("reasoning")
    return Completion(
        text=clean(text),
        finish_reason=told(choice.get("finish_reason")),
        usage=usage_of(body.get("usage"), text),
        model=told(body.get("model")),
        seconds=round(seconds, 3),
        refusal=told(refusal),
        reasoning=told(reasoning),
    )


def told(value: Any) -> str | None:
    """Returns a text, and None for anything else."""
    return clean(value) if isinstance(value, str) else None


def usage_of(usage: Any, text: str) -> Usage:
    """Reads the tokens; what was not told stays unknown. No tokens at all for a text were not told."""
    if not isinstance(usage, dict):
        return Usage()
    of_input, of_output = usage.get("prompt_tokens_details"), usage.get("completion_tokens_details")
    output = count(usage.get("completion_tokens"))
    return Usage(
        input=count(usage.get("prompt_tokens")) or None,
        output=None if text and output == 0 else output,
        cached_input=count(of_input.get("cached_tokens")) if isinstance(of_input, dict) else None,
        reasoning=count(of_output.get("reasoning_tokens")) if isinstance(of_output, dict) else None,
    )


def count(value: Any) -> int | None:
    """Returns a number of tokens, and None for anything else."""
    return value if isinstance(value, int) and not isinstance(value, bool) and value >= 0 else None


def excerpt(text: str) -> str:
    """Returns the beginning of a text, on one line."""
    return re.sub(r"\s+", " ", clean(text)).strip()[:300]
