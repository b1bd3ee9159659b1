"""The journal of an evaluation: a line of JSON for each thing that happened, durable before the next one begins."""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

from ..errors import PlumblineError


class JournalError(PlumblineError):
    """The folder holds another evaluation, or another process works in it."""


def is_alone(file: IO[bytes]) -> bool:
    """Locks a file; returns whether no other process has it. Where files cannot be locked, nobody is kept out."""
    try:
        import fcntl
    except ImportError:
        return True
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        # Some file systems have no locks.
        return True
    return True


class Journal:
    """An append-only file of entries. Each has a `kind`, and belongs to an `attempt` (or to the evaluation as a whole).

    What a process that was killed left half written at the end of the file is cut off.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / "journal.jsonl"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._file = self.path.open("a+b")
        except OSError as error:
            raise JournalError(f"{self.path} cannot be written: {error.strerror}") from error
        if not is_alone(self._file):
            raise JournalError(f"another process is working in {folder}")
        self._entries: dict[tuple[str, str], list[dict[str, Any]]] = {}
        for entry in self._read():
            self._keep(entry)

    def _read(self) -> Iterator[dict[str, Any]]:
        self._file.seek(0)
        good = 0
        for line in self._file:
            if not line.endswith(b"\n"):
                break
            try:
                entry = json.loads(line)
            except ValueError:
                raise JournalError(f"{self.path} is damaged at byte {good}; move it away to begin anew") from None
            good += len(line)
            yield entry
        self._file.truncate(good)
        self._file.seek(good)

    def _keep(self, entry: dict[str, Any]) -> None:
        self._entries.setdefault((entry["attempt"], entry["kind"]), []).append(entry)

    def add(self, attempt: str, kind: str, **members: Any) -> None:
        """Adds an entry. It is on the disk when this returns."""
        entry = {"attempt": attempt, "kind": kind, "at": round(time.time(), 3), **members}
        try:
            self._file.write(json.dumps(entry).encode() + b"\n")
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            raise JournalError(f"{self.path} cannot be written: {error.strerror}") from error
        self._keep(entry)

    def all(self, attempt: str, kind: str) -> list[dict[str, Any]]:
        """Returns the entries of one kind, in order."""
        return self._entries.get((attempt, kind), [])

    def last(self, attempt: str, kind: str) -> dict[str, Any] | None:
        """Returns the last entry of one kind."""
        found = self.all(attempt, kind)
        return found[-1] if found else None

    def of_kind(self, kind: str) -> Iterator[dict[str, Any]]:
        """Yields all entries of one kind."""
        for (_, named), entries in self._entries.items():
            if named == kind:
                yield from entries

    def close(self) -> None:
        """Lets other processes work in the folder."""
        with contextlib.suppress(OSError):
            self._file.close()
