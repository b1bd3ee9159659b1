"""The blocking client."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from types import TracebackType
from typing import Any, Self, TypeVar
from uuid import UUID

import httpx

from . import calls, errors, models, resources
from .batches import Batch, Request, item
from .calls import Attempts, Profile, Retries, Track
from .events import EventReader, Lines, Reopening

T = TypeVar("T")

DEFAULT_URL = "http://localhost:7586"
SETTLED = ("graded", "rejected", "grader_error", "cancelled")
ENDED = ("finished", "deleted")


class Rewards(resources.Rewards):
    """`client.rewards`."""

    def __init__(self, client: Client) -> None:
        super().__init__(client)
        self._http = client

    def batch(self, requests: Iterable[Request]) -> Iterator[models.BatchItem]:
        """Grades many logs, and yields each result as it comes; `index` says whose it is.

        A log that the service refuses for the time being is sent again. A log that cannot be graded has an `error`,
        which is a fault of the log, or a failure that did not pass.
        """
        return (item(raw) for raw in self.raw_batch(requests))

    def raw_batch(self, requests: Iterable[Request]) -> Iterator[dict[str, Any]]:
        """Does the same as `batch`, with results as plain dictionaries, which costs less."""
        batch = Batch(requests)
        while not batch.is_done:
            attempts = Attempts(self._http.retries, is_repeatable=True)
            try:
                yield from self._send(batch, attempts)
            except errors.PlumblineError as error:
                if isinstance(error, errors.ApiError) and not error.is_retryable:
                    raise
                yield from batch.give_up(error)

    def many(self, requests: Iterable[Request]) -> list[models.BatchItem]:
        """Grades many logs and returns their results in order."""
        return sorted(self.batch(requests), key=lambda one: one.index)

    def _send(self, batch: Batch, attempts: Attempts) -> Iterator[dict[str, Any]]:
        """Sends the logs that wait, again and again until some of them have results."""
        while True:
            taken, failure = 0, errors.PlumblineError("the service is busy")
            try:
                for line in self._http._lines("POST", "/v1/grade:batch", batch.body()):
                    if (result := batch.take(line)) is not None:
                        taken += 1
                        yield result
            except errors.PlumblineError as error:
                failure = error
            if taken:
                return
            time.sleep(attempts.delay(failure, was_sent=True))


class Submissions(resources.Submissions):
    """`client.submissions`."""

    def wait(self, id: str | UUID, timeout_s: float = 600.0) -> models.SubmissionBody:
        """Waits until a submission has ended, and returns it. Raises `TimedOut` if it takes longer."""
        return waited(lambda: self.get(id), lambda found: found.state in SETTLED, timeout_s, f"submission {id}")


class Runs(resources.Runs):
    """`client.runs`."""

    def wait(self, id: str | UUID, timeout_s: float = 3600.0) -> models.RunBody:
        """Waits until a run has ended, and returns it.

        Raises `TimedOut` if it takes longer, and `GradingFailed` if it waits for grades that the service failed to make.
        """
        return waited(lambda: self.get(id), has_run_ended, timeout_s, f"run {id}")


class Tasks(resources.Tasks):
    """`client.tasks`."""

    def system_prompt(self, suite: str | None, track: Track = "specified", profile: Profile = "mindcraft") -> str:
        """Returns a system prompt: the guide for agents, and what short prompts of a suite take for granted."""
        guide = (self.agent_guide(profile=profile)).text
        if suite is None or track != "brief":
            return guide
        preamble = (self._client._call(models.SuiteBody, "GET", f"/v1/suites/{calls.quoted(suite)}")).preamble
        return f"{guide}\n{preamble}" if preamble else guide

    def all(self, suite: str, **filters: Any) -> Iterator[models.TaskSummary]:
        """Yields all tasks of a suite, with the filters of `list`."""
        after: int | None = None
        while True:
            page = self.list(suite=suite, after=after, limit=500, **filters)
            yield from page.tasks
            after = page.next_after
            if after is None:
                return


class Events:
    """`client.events`."""

    def __init__(self, client: Client) -> None:
        self._client = client

    def follow(
        self, *, run: str | UUID | None = None, submission: str | UUID | None = None, after: int | None = None
    ) -> Iterator[models.EventBody]:
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
                for line in self._client._lines("GET", "/v1/events", None, reader.headers(), params):
                    reopening.hears()
                    if (event := reader.read(line)) is not None:
                        yield event
                        if submission is not None or (run is not None and event.submission is None):
                            return
                # The service also ends a stream when it stops. One that began after the end brings what there is.
                if had_ended and not reopening.has_brought():
                    return
                had_ended = self._has_ended(run, submission)
                delay = 0.0 if had_ended else reopening.delay(None)
            except errors.PlumblineError as error:
                delay = reopening.delay(error)
            time.sleep(delay)

    def _has_ended(self, run: str | UUID | None, submission: str | UUID | None) -> bool:
        if submission is not None:
            return self._client.submissions.get(submission).state in SETTLED
        return run is not None and self._client.runs.get(run).state in ENDED


class Client:
    """A blocking client of one service. It may be used by many threads at once.

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
        transport: httpx.BaseTransport | None = None,
    ) -> None:
        self.url = address(url)
        self.retries = retries or Retries()
        self._http = httpx.Client(
            base_url=self.url, headers=own_headers(key), timeout=timeout_s, limits=LIMITS, transport=transport
        )
        self.boards = resources.Boards(self)
        self.entries = resources.Entries(self)
        self.episodes = resources.Episodes(self)
        self.epochs = resources.Epochs(self)
        self.events = Events(self)
        self.instances = resources.Instances(self)
        self.nemo_gym = resources.NemoGym(self)
        self.receipts = resources.Receipts(self)
        self.rewards = Rewards(self)
        self.runs = Runs(self)
        self.service = resources.Service(self)
        self.submissions = Submissions(self)
        self.suites = resources.Suites(self)
        self.tasks = Tasks(self)
        self.team = resources.Team(self)
        self.webhooks = resources.Webhooks(self)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Closes the connections."""
        self._http.close()

    def request(self, method: str, path: str, json: Any = None, *, is_repeatable: bool = False) -> Any:
        """Makes a request that has no method of its own, and returns the parsed answer."""
        return self._call(calls.ANY, method, path, json=json, is_repeatable=is_repeatable)

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
    ) -> T:
        attempts = Attempts(self.retries, is_repeatable or once is not None or method == "GET")
        body = content if json is None else calls.written(json)
        request = self._http.build_request(
            method, path, params=calls.parameters(params), content=body, headers=calls.headers(json, content, once)
        )
        while True:
            was_sent = True
            try:
                return calls.read(kind, self._http.send(request))
            except errors.ApiError as refused:
                failure: errors.PlumblineError = refused
            except httpx.TransportError as broken:
                failure, was_sent = calls.not_reached(broken, self.url)
            time.sleep(attempts.delay(failure, was_sent))

    def _lines(
        self,
        method: str,
        path: str,
        body: bytes | None,
        headers: Mapping[str, str] | None = None,
        params: Mapping[str, Any] | None = None,
    ) -> Iterator[bytes]:
        """Yields the lines of a streamed answer."""
        sent = {"content-type": calls.JSON_LINES} if body is not None else {}
        # An idle stream of events says every 15 seconds that it is alive.
        request = self._http.build_request(
            method, path, content=body, params=calls.parameters(params), headers={**sent, **(headers or {})}
        )
        try:
            response = self._http.send(request, stream=True)
            try:
                if response.status_code != 200:
                    response.read()
                    calls.read(calls.ANY, response)
                lines = Lines()
                for chunk in response.iter_bytes():
                    yield from lines.take(chunk)
                yield from lines.rest()
            finally:
                response.close()
        except httpx.TransportError as broken:
            raise calls.not_reached(broken, self.url)[0] from broken


LIMITS = httpx.Limits(max_connections=100, max_keepalive_connections=20)


def address(url: str | None) -> str:
    """Returns the address of the service, without a slash at its end, nor the `/v1` with which its paths begin."""
    # Earlier versions of this package called it `PLUMBLINE`.
    told = os.environ.get("PLUMBLINE_SERVER") or os.environ.get("PLUMBLINE")
    given = (url or told or DEFAULT_URL).strip()
    given = given if "://" in given else f"http://{given}"
    try:
        read = httpx.URL(given)
    except httpx.InvalidURL as error:
        raise errors.PlumblineError(f"{given!r} is no address of a service: {error}") from error
    if read.scheme not in ("http", "https") or not read.host:
        raise errors.PlumblineError(f"{given!r} is no address of a service: expected http://HOST:PORT or https://HOST")
    return given.rstrip("/").removesuffix("/v1")


def own_headers(key: str | None) -> dict[str, str]:
    """Returns the headers of every request."""
    key = (key or os.environ.get("PLUMBLINE_KEY") or "").strip()
    if not key.isascii() or not key.isprintable():
        raise errors.PlumblineError("the key has characters that no key has; look at PLUMBLINE_KEY")
    sent = {"user-agent": "plumbline-client/0.1.0 (python)", "accept": "application/json, */*"}
    return {**sent, "authorization": f"Bearer {key}"} if key else sent


def has_run_ended(run: models.RunBody) -> bool:
    """Whether a run has ended. Raises an error if it would never end by itself."""
    if run.state not in ENDED and run.state != "open" and run.pending == 0 and run.grader_errors > 0:
        failed = "1 submission" if run.grader_errors == 1 else f"{run.grader_errors} submissions"
        raise errors.GradingFailed(
            f"the service failed to grade {failed} of run {run.id}, which says nothing about them: the run waits until its "
            "operator has them graded (plumbline failures), or its tasks are answered again"
        )
    return run.state in ENDED


def waited(look: Callable[[], T], is_there: Callable[[T], bool], timeout_s: float, what: str) -> T:
    """Looks until something is there."""
    until, pause = time.monotonic() + timeout_s, 0.05
    while True:
        found = look()
        if is_there(found):
            return found
        if time.monotonic() + pause > until:
            raise errors.TimedOut(f"{what} has not ended after {timeout_s:g} s")
        time.sleep(pause)
        pause = min(2.0, pause * 1.5)
