"""A model behind an endpoint that speaks OpenAI's Chat Completions."""

from __future__ import annotations

import asyncio
import random
import re
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import httpx

from ..calls import retry_after
from ..errors import PlumblineError
from .plan import Sampling

Message = dict[str, Any]


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
        headers = {"authorization": f"Bearer {key}"} if key else {}
        limits = httpx.Limits(max_connections=None, max_keepalive_connections=100)
        timeout = httpx.Timeout(timeout_s, connect=min(timeout_s, 30.0))
        self._http = httpx.AsyncClient(headers=headers, timeout=timeout, limits=limits)
        self._url = base_url.rstrip("/").removesuffix("/chat/completions") + "/chat/completions"
        self._most_tokens = "max_tokens"

    async def close(self) -> None:
        """Closes the connections."""
        await self._http.aclose()

    async def answer(self, messages: Sequence[Message], run: int) -> Completion:
        """Returns the model's answer to a conversation. `run` is the index of the run, from 0, for the seed."""
        until, delay, tries = time.monotonic() + self._patience_s, self._first_delay_s, 0
        while True:
            began, tries = time.monotonic(), tries + 1
            asked: float | None = None
            try:
                response = await self._http.post(self._url, json=self._request(messages, run))
                if response.is_success:
                    return read(response, time.monotonic() - began)
                reason = f"{response.status_code} {excerpt(response.text)}"
                if self._learns(response):
                    continue
                if response.status_code in (401, 403, 404):
                    raise EndpointRefuses(f"{self._url} refuses: {reason}")
                if response.status_code not in (408, 409, 425, 429) and response.status_code < 500:
                    raise ModelError(f"{self._url} refuses this request: {reason}")
                asked = retry_after(response.headers.get("retry-after"))
            except (httpx.TransportError, NoAnswer) as error:
                reason = str(error) or type(error).__name__
            except httpx.InvalidURL as error:
                raise EndpointRefuses(f"{self._url} is no address: {error}") from error
            pause = random.uniform(0.5, 1.0) * delay if asked is None else asked + random.uniform(0.0, 1.0)
            delay = min(60.0, 2.0 * delay)
            if time.monotonic() + pause > until:
                raise ModelError(f"no answer from {self._url} after {tries} tries: {reason}")
            await asyncio.sleep(pause)

    def _request(self, messages: Sequence[Message], run: int) -> dict[str, Any]:
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
        return {name: value for name, value in request.items() if value is not None} | sampling.extra

    def _learns(self, response: httpx.Response) -> bool:
        """Newer models take their limit under another name, and say so."""
        is_told = response.status_code == 400 and "max_completion_tokens" in response.text
        if is_told and self._most_tokens == "max_tokens":
            self._most_tokens = "max_completion_tokens"
            return True
        return False


class NoAnswer(PlumblineError):
    """The endpoint answered with success and without an answer."""


def read(response: httpx.Response, seconds: float) -> Completion:
    """Reads an answer, with the variants of endpoints that call themselves compatible."""
    try:
        body = response.json()
        choice = body["choices"][0]
        message = choice.get("message") or {}
    except (ValueError, KeyError, IndexError, TypeError, AttributeError):
        raise NoAnswer(f"an answer without choices: {excerpt(response.text)}") from None
    content = message.get("content")
    if isinstance(content, list):
        content = "".join(part.get("text") or "" for part in content if isinstance(part, dict))
    refusal = message.get("refusal")
    return Completion(
        text=content if isinstance(content, str) else refusal if isinstance(refusal, str) else "",
        finish_reason=choice.get("finish_reason"),
        usage=usage_of(body.get("usage")),
        model=body.get("model"),
        seconds=round(seconds, 3),
        refusal=refusal if isinstance(refusal, str) else None,
        reasoning=message.get("reasoning_content") or message.get("reasoning"),
    )


def usage_of(told: Any) -> Usage:
    """Reads the tokens; what was not told stays unknown."""
    if not isinstance(told, dict):
        return Usage()
    of_input, of_output = told.get("prompt_tokens_details") or {}, told.get("completion_tokens_details") or {}
    return Usage(
        input=told.get("prompt_tokens"),
        output=told.get("completion_tokens"),
        cached_input=of_input.get("cached_tokens"),
        reasoning=of_output.get("reasoning_tokens"),
    )


def excerpt(text: str) -> str:
    """Returns the beginning of a text, on one line."""
    return re.sub(r"\s+", " ", text).strip()[:300]
