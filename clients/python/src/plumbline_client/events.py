"""Streamed answers line by line, and server-sent events."""

from __future__ import annotations

import time

from pydantic_core import from_json

from .calls import Attempts, Retries
from .errors import PlumblineError
from .models import EventBody


class Lines:
    """Puts the lines of a stream together.

    Only a line feed ends one. Python, and httpx with it, also splits text at characters that JSON may hold as they are,
    such as U+2028.
    """

    def __init__(self) -> None:
        self._begun: list[bytes] = []

    def take(self, chunk: bytes) -> list[bytes]:
        """Takes the next bytes; returns the lines that they end."""
        *ended, begun = chunk.split(b"\n")
        if ended:
            ended[0] = b"".join([*self._begun, ended[0]])
            self._begun = []
        self._begun.append(begun)
        return [line.removesuffix(b"\r") for line in ended]

    def rest(self) -> list[bytes]:
        """Returns the last line if no line feed ended it."""
        last = b"".join(self._begun)
        return [last] if last else []


class Reopening:
    """When a stream that broke off or ended is opened again: at once after an event, otherwise with patience."""

    def __init__(self, retries: Retries, reader: EventReader) -> None:
        self._opened = time.monotonic()
        self._has_heard = False
        self._retries = retries
        self._reader = reader
        self._attempts = Attempts(retries, is_repeatable=True)

    def opens(self) -> None:
        """Notes that the stream is opened now."""
        self._opened = time.monotonic()
        self._has_heard = False
        self._seen = self._reader.last_id

    def hears(self) -> None:
        """Notes that the service has sent a line, be it only to keep the stream open."""
        self._has_heard = True

    def has_brought(self) -> bool:
        """Whether the stream has brought an event since it was opened."""
        return self._reader.last_id != self._seen

    def delay(self, error: PlumblineError | None) -> float:
        """Returns the seconds to wait; raises the error if the service does not come back."""
        is_held = self._has_heard and time.monotonic() - self._opened > self._retries.longest_s
        if self.has_brought() or is_held:
            self._attempts = Attempts(self._retries, is_repeatable=True)
        if self.has_brought():
            return 0.0
        return self._attempts.pause() if error is None else self._attempts.delay(error, was_sent=True)


class EventReader:
    """Puts the lines of a stream together, and remembers the last event for a stream that is opened again."""

    def __init__(self, after: int | None) -> None:
        self.last_id: str | None = None if after is None else str(after)
        self._id: str | None = None
        self._data: list[bytes] = []

    def read(self, line: bytes) -> EventBody | None:
        """Takes a line; returns an event if the line ends one."""
        if line.startswith(b"data:"):
            self._data.append(line[5:].removeprefix(b" "))
        elif line.startswith(b"id:"):
            self._id = line[3:].decode().strip()
        elif not line and self._data:
            text = b"\n".join(self._data)
            self._data = []
            self.last_id = self._id or self.last_id
            return EventBody.model_validate(from_json(text))
        return None

    def headers(self) -> dict[str, str]:
        """Returns the headers that open the stream where it broke off."""
        # What the broken stream left half said is sent again.
        self._data = []
        sent = {"accept": "text/event-stream"}
        return sent if self.last_id is None else {**sent, "last-event-id": self.last_id}
