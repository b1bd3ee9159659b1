"""Server-sent events, line by line."""

from __future__ import annotations

from pydantic_core import from_json

from .models import EventBody


class EventReader:
    """Puts the lines of a stream together, and remembers the last event for a stream that is opened again."""

    def __init__(self, after: int | None) -> None:
        self.last_id: str | None = None if after is None else str(after)
        self._id: str | None = None
        self._data: list[str] = []

    def read(self, line: str) -> EventBody | None:
        """Takes a line; returns an event if the line ends one."""
        if line.startswith("data:"):
            self._data.append(line[5:].removeprefix(" "))
        elif line.startswith("id:"):
            self._id = line[3:].strip()
        elif not line and self._data:
            text = "\n".join(self._data)
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
