"""One client and one coalescer for each event loop: a trainer calls from loops and processes of its own."""

from __future__ import annotations

import asyncio
import os
import threading
from collections.abc import Coroutine
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

from ..async_client import AsyncClient
from ..coalescer import Coalescer

T = TypeVar("T")

_coalescers: WeakKeyDictionary[asyncio.AbstractEventLoop, dict[str | None, Coalescer]] = WeakKeyDictionary()


def coalescer(url: str | None = None) -> Coalescer:
    """Returns the coalescer of the running loop for a service, by default that of `PLUMBLINE_SERVER`."""
    # Connections hold their loop, so a loop that has ended would stay with them.
    for loop in list(_coalescers):
        if loop.is_closed():
            _coalescers.pop(loop, None)
    of_loop = _coalescers.setdefault(asyncio.get_running_loop(), {})
    if url not in of_loop:
        of_loop[url] = Coalescer(AsyncClient(url))
    return of_loop[url]


class Background:
    """A loop in a thread, for callers that have none."""

    _lock = threading.Lock()
    _loop: asyncio.AbstractEventLoop | None = None
    _process = 0

    @classmethod
    def run(cls, work: Coroutine[Any, Any, T]) -> T:
        """Runs work on the loop and waits for its result."""
        with cls._lock:
            # A forked process has the loop of its parent, and not its thread.
            if cls._loop is None or cls._process != os.getpid():
                cls._process = os.getpid()
                cls._loop = asyncio.new_event_loop()
                threading.Thread(target=cls._loop.run_forever, name="plumbline", daemon=True).start()
        return asyncio.run_coroutine_threadsafe(work, cls._loop).result()
