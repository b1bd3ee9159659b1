"""Sends concurrent calls as batches: a trainer asks for one reward at a time, in hundreds of coroutines at once."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Mapping
from types import TracebackType
from typing import Any, Self

from . import batches, errors
from .async_client import AsyncClient
from .calls import written
from .models import BatchItem


class Coalescer:
    """Collects the calls of concurrent coroutines and sends them as one batch.

    A batch leaves when `most` calls wait, or `wait_s` seconds after the first of them, whichever is first; at most
    `in_flight` batches are under way, and calls that come meanwhile go with the next one.
    """

    def __init__(self, client: AsyncClient, *, most: int = 128, wait_s: float = 0.003, in_flight: int = 4) -> None:
        self.client = client
        self._most = most
        self._wait_s = wait_s
        self._slots = asyncio.Semaphore(in_flight)
        self._waiting: list[tuple[bytes, asyncio.Future[dict[str, Any]]]] = []
        self._is_full = asyncio.Event()
        self._tasks: set[asyncio.Task[None]] = set()
        self._collecting: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await asyncio.gather(*self._tasks, *filter(None, [self._collecting]), return_exceptions=True)

    async def grade(self, **request: Any) -> BatchItem:
        """Grades one log; takes what `client.rewards.grade` takes.

        Raises an error if the log has faults, or if there is no reward through a failure that did not pass.
        """
        return batches.item(await self.raw_grade(request))

    async def reward(self, **request: Any) -> float | None:
        """Returns the reward of one log, or None if the service failed. Raises an error if the request has faults."""
        try:
            reward: float | None = (await self.raw_grade(request))["reward"]
            return reward
        except (errors.NotReached, errors.ServiceFailed, errors.TooMany):
            return None

    async def raw_grade(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Grades one log; the result is a plain dictionary, which costs less."""
        result: asyncio.Future[dict[str, Any]] = asyncio.get_running_loop().create_future()
        # Written here, so that what cannot be written is its caller's error alone.
        self._waiting.append((written(request), result))
        if len(self._waiting) >= self._most:
            self._is_full.set()
        if self._collecting is None or self._collecting.done():
            self._collecting = asyncio.create_task(self._collect())
        raw = await result
        if raw.get("error") is not None:
            raise errors.of_problem(batches.item(raw).error)  # type: ignore[arg-type]
        return raw

    async def _collect(self) -> None:
        while self._waiting:
            if len(self._waiting) < self._most:
                self._is_full.clear()
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(self._is_full.wait(), self._wait_s)
            await self._slots.acquire()
            now, self._waiting = self._waiting[: self._most], self._waiting[self._most :]
            sending = asyncio.create_task(self._send(now))
            self._tasks.add(sending)
            sending.add_done_callback(self._tasks.discard)

    async def _send(self, now: list[tuple[bytes, asyncio.Future[dict[str, Any]]]]) -> None:
        try:
            async for raw in self.client.rewards.raw_batch([request for request, _ in now]):
                result = now[raw["index"]][1]
                if not result.done():
                    result.set_result(raw)
        except Exception as error:  # noqa: BLE001
            # Nobody but the callers can do anything about it.
            for _, result in now:
                if not result.done():
                    result.set_exception(error)
        finally:
            self._slots.release()
