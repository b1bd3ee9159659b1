"""The asynchronous client, and the coalescer that sends concurrent calls as batches."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable, Mapping
from types import TracebackType
from typing import Any, Self, TypeVar
from uuid import UUID

import httpx

from . import async_resources, calls, errors, models
from .batches import Batch, Request, item
from .calls import Attempts, Profile, Retries, Track
from .client import ENDED, LIMITS, SETTLED, address, has_run_ended, own_headers
from .events import EventReader, Lines, Reopening

T = TypeVar("T")


class AsyncRewards(async_resources.AsyncRewards):
    """`client.rewards`."""

    def __init__(self, client: AsyncClient) -> None:
        super().__init__(client)
        self._http = client

    async def batch(self, requests: Iterable[Request]) -> AsyncIterator[models.BatchItem]:
        """Grades many logs, and yields each result as it comes; `index` says whose it is.

        A log that the service refuses for the time being is sent again. A log that cannot be graded has an `error`,
        which is a fault of the log, or a failure that did not pass.
        """
        async for raw in self.raw_batch(requests):
            yield item(raw)

    async def raw_batch(self, requests: Iterable[Request]) -> AsyncIterator[dict[str, Any]]:
        """Does the same as `batch`, with results as plain dictionaries, which costs less."""
        batch = Batch(requests)
        while not batch.is_done:
            attempts = Attempts(self._http.retries, is_repeatable=True)
            try:
                async for raw in self._send(batch, attempts):
                    yield raw
            except errors.PlumblineError as error:
                if isinstance(error, errors.ApiError) and not error.is_retryable:
                    raise
                for raw in batch.give_up(error):
                    yield raw

    async def many(self, requests: Iterable[Request]) -> list[models.BatchItem]:
        """Grades many logs and returns their results in order."""
        return sorted([one async for one in self.batch(requests)], key=lambda one: one.index)

    async def _send(self, batch: Batch, attempts: Attempts) -> AsyncIterator[dict[str, Any]]:
        while True:
            taken, failure = 0, errors.PlumblineError("the service is busy")
            try:
                async for line in self._http._lines("POST", "/v1/grade:batch", batch.body()):
                    if (result := batch.take(line)) is not None:
                        taken += 1
                        yield result
            except errors.PlumblineError as error:
                failure = error
            if taken:
                return
            await asyncio.sleep(attempts.delay(failure, was_sent=True))


class AsyncSubmissions(async_resources.AsyncSubmissions):
    """`client.submissions`."""

    async def wait(self, id: str | UUID, timeout_s: float = 600.0) -> models.SubmissionBody:
        """Waits until a submission has ended, and returns it. Raises `TimedOut` if it takes longer."""
        return await waited(lambda: self.get(id), lambda found: found.state in SETTLED, timeout_s, f"submission {id}")


class AsyncRuns(async_resources.AsyncRuns):
    """`client.runs`."""

    async def wait(self, id: str | UUID, timeout_s: float = 3600.0) -> models.RunBody:
        """Waits until a run has ended, and returns it.

        Raises `TimedOut` if it takes longer, and `GradingFailed` if it waits for grades that the service failed to make.
        """
        return await waited(lambda: self.get(id), has_run_ended, timeout_s, f"run {id}")


class AsyncTasks(async_resources.AsyncTasks):
    """`client.tasks`."""

    async def system_prompt(self, suite: str | None, track: Track = "specified", profile: Profile = "mindcraft") -> str:
        """Returns a system prompt: the guide for agents, and what short prompts of a suite take for granted."""
        guide = (await self.agent_guide(profile=profile)).text
        if suite is None or track != "brief":
            return guide
        preamble = (await self._client._call(models.SuiteBody, "GET", f"/v1/suites/{calls.quoted(suite)}")).preamble
        return f"{guide}\n{preamble}" if preamble else guide

    async def all(self, suite: str, **filters: Any) -> AsyncIterator[models.TaskSummary]:
        """Yields all tasks of a suite, with the filters of `list`."""
        after: int | None = None
        while True:
            page = await self.list(suite=suite, after=after, limit=500, **filters)
            for task in page.tasks:
                yield task
            after = page.next_after
            if after is None:
                return


class AsyncEvents:
    """`client.events`."""

    def __init__(self, client: AsyncClient) -> None:
        self._client = client

    async def follow(
        self, *, run: str | UUID | None = None, submission: str | UUID | None = None, after: int | None = None
    ) -> AsyncIterator[models.EventBody]:
        """Yields an event for each submission and run that ends, and opens the stream again where it breaks off.

        With a run or a submission the events begin with its first, and end when it has ended.
        """
        reader = EventReader(after)
        params = {"run": run, "submission": submission, "after": after}
        reopening = Reopening(self._client.retries, reader)
        had_ended = False
        while True:
            reopening.opens()
            try:
                async for line in self._client._lines("GET", "/v1/events", None, reader.headers(), params):
                    reopening.hears()
                    if (event := reader.read(line)) is not None:
                        yield event
                        if submission is not None or (run is not None and event.submission is None):
                            return
                # The service also ends a stream when it stops. One that began after the end brings what there is.
                if had_ended and not reopening.has_brought():
                    return
                had_ended = await self._has_ended(run, submission)
                delay = 0.0 if had_ended else reopening.delay(None)
            except errors.PlumblineError as error:
                delay = reopening.delay(error)
            await asyncio.sleep(delay)

    async def _has_ended(self, run: str | UUID | None, submission: str | UUID | None) -> bool:
        if submission is not None:
            return (await self._client.submissions.get(submission)).state in SETTLED
        return run is not None and (await self._client.runs.get(run)).state in ENDED


class AsyncClient:
    """An asynchronous client of one service.

    `url` is the service's address, by default that in `PLUMBLINE_SERVER`; `key` is the key, by default that in `PLUMBLINE_KEY`.
    `timeout_s` is for one attempt of one request; `retries` says when a request is sent again.
    """

    def __init__(
        self,
        url: str | None = None,
        key: str | None = None,
        *,
        timeout_s: float = 65.0,
        retries: Retries | None = None,
        transport: httpx.AsyncBaseTransport | None = None,
    ) -> None:
        self.url = address(url)
        self.retries = retries or Retries()
        self._http = httpx.AsyncClient(
            base_url=self.url, headers=own_headers(key), timeout=timeout_s, limits=LIMITS, transport=transport
        )
        self.boards = async_resources.AsyncBoards(self)
        self.entries = async_resources.AsyncEntries(self)
        self.episodes = async_resources.AsyncEpisodes(self)
        self.epochs = async_resources.AsyncEpochs(self)
        self.events = AsyncEvents(self)
        self.instances = async_resources.AsyncInstances(self)
        self.nemo_gym = async_resources.AsyncNemoGym(self)
        self.receipts = async_resources.AsyncReceipts(self)
        self.rewards = AsyncRewards(self)
        self.runs = AsyncRuns(self)
        self.service = async_resources.AsyncService(self)
        self.submissions = AsyncSubmissions(self)
        self.suites = async_resources.AsyncSuites(self)
        self.tasks = AsyncTasks(self)
        self.team = async_resources.AsyncTeam(self)
        self.webhooks = async_resources.AsyncWebhooks(self)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    async def close(self) -> None:
        """Closes the connections."""
        await self._http.aclose()

    async def request(self, method: str, path: str, json: Any = None, *, is_repeatable: bool = False) -> Any:
        """Makes a request that has no method of its own, and returns the parsed answer."""
        return await self._call(calls.ANY, method, path, json=json, is_repeatable=is_repeatable)

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
    ) -> T:
        attempts = Attempts(self.retries, is_repeatable or once is not None or method == "GET")
        body = content if json is None else calls.written(json)
        request = self._http.build_request(
            method, path, params=calls.parameters(params), content=body, headers=calls.headers(json, content, once)
        )
        while True:
            was_sent = True
            try:
                return calls.read(kind, await self._http.send(request))
            except errors.ApiError as refused:
                failure: errors.PlumblineError = refused
            except httpx.TransportError as broken:
                failure, was_sent = calls.not_reached(broken, self.url)
            await asyncio.sleep(attempts.delay(failure, was_sent))

    async def _lines(
        self,
        method: str,
        path: str,
        body: bytes | None,
        headers: Mapping[str, str] | None = None,
        params: Mapping[str, Any] | None = None,
    ) -> AsyncIterator[bytes]:
        sent = {"content-type": calls.JSON_LINES} if body is not None else {}
        request = self._http.build_request(
            method, path, content=body, params=calls.parameters(params), headers={**sent, **(headers or {})}
        )
        try:
            response = await self._http.send(request, stream=True)
            try:
                if response.status_code != 200:
                    await response.aread()
                    calls.read(calls.ANY, response)
                lines = Lines()
                async for chunk in response.aiter_bytes():
                    for line in lines.take(chunk):
                        yield line
                for line in lines.rest():
                    yield line
            finally:
                await response.aclose()
        except httpx.TransportError as broken:
            raise calls.not_reached(broken, self.url)[0] from broken


async def waited(look: Callable[[], Awaitable[T]], is_there: Callable[[T], bool], timeout_s: float, what: str) -> T:
    """Looks until something is there."""
    until, pause = time.monotonic() + timeout_s, 0.05
    while True:
        found = await look()
        if is_there(found):
            return found
        if time.monotonic() + pause > until:
            raise errors.TimedOut(f"{what} has not ended after {timeout_s:g} s")
        await asyncio.sleep(pause)
        pause = min(2.0, pause * 1.5)
