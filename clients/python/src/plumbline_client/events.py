"""Streamed answers line by line, and server-sent events."""

from __future__ import annotations

from pydantic_core import from_json

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
