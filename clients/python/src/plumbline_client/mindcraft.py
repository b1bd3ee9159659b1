"""Reads what the published pipeline leaves of a run of mindcraft: action files, and the records that map them to turns.

A bot's action files are numbered through all tasks (`action-code/0.js`, `1.js`, …). The raw records, a line of JSON for
each turn, name the last file of their turn; the files after that of the turn before are the turn's own. A folder may also
be sorted already: `TASK/TURN/N.js`, with a task's number or its id (`walls/5x1x5-raise`, also as `walls__5x1x5-raise`).
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from .errors import PlumblineError

NUMBERED = re.compile(r"(\d+)\.js")
Files = Literal["all", "last"]


class UnreadableRecords(PlumblineError):
    """The folder is not what the pipeline leaves, or the records contradict each other."""


@dataclass
class TaskRecord:
    """The turns of one task."""

    name: str
    """Number or id of the task, as the records name it."""
    turns: list[list[str]] = field(default_factory=list)
    """Texts of the action files of each turn, in order."""
    prompts: list[str] = field(default_factory=list)
    """Instructions of the turns, as far as the records have them."""
    of: Any = None
    """Number of turns, as the records have it."""


def read_records(folder: Path, files: Files) -> list[TaskRecord]:
    """Reads a folder. `files` says whether all files of a turn count, or the last alone, as the published pipeline has it.

    Raises `UnreadableRecords` with the place if something is missing or contradicts itself.
    """
    if not folder.is_dir():
        raise UnreadableRecords(f"{folder} is no folder")
    raw = sorted(path for path in folder.rglob("*.json*") if is_raw(path))
    if len(raw) > 1:
        raise UnreadableRecords(f"{folder} has {len(raw)} files of raw records; move all but one away: {names(raw)}")
    if raw:
        return from_raw(raw[0], folder, files)
    sorted_ones = from_folders(folder, files)
    if not sorted_ones:
        raise UnreadableRecords(
            f"{folder} has neither raw records (eval_…_raw.json) nor folders TASK/TURN with action files (0.js, 1.js, …)"
        )
    return sorted_ones


def is_raw(path: Path) -> bool:
    """Whether a file has the name of raw records, of the newer pipeline or the older."""
    return bool(re.fullmatch(r"eval_.+_raw\.jsonl?|eval_raw_.+\.jsonl?", path.name))


def names(paths: list[Path]) -> str:
    """Lists names."""
    return ", ".join(path.name for path in paths)


def from_raw(raw: Path, folder: Path, files: Files) -> list[TaskRecord]:
    """Reads the tasks of raw records."""
    code = action_files(folder)
    tasks: dict[int, TaskRecord] = {}
    before, coords = -1, None
    for number, line in enumerate(text_of(raw).removeprefix("\ufeff").split("\n"), start=1):
        if not line.strip():
            continue
        place = f"{raw.name}, line {number}"
        record = record_of(line, place)
        task = tasks.setdefault(record["run_idx"], TaskRecord(str(record["run_idx"])))
        if record["turn_idx"] != len(task.turns) + 1:
            raise UnreadableRecords(
                f"{place}: turn {record['turn_idx']} of task {task.name} follows turn {len(task.turns)}; "
                "the pipeline left a turn out, so that later records may belong to other turns"
            )
        last = index_of(record.get("action_file"), place)
        if last is not None and last < before:
            raise UnreadableRecords(
                f"{place}: action file {last}.js after {before}.js: the bot was started anew and wrote over its files, "
                "so that nobody knows what the earlier turns had"
            )
        # A turn that names the file of the turn before wrote none of its own.
        own = [] if last is None else [index for index in sorted(code) if before < index <= last]
        if last is not None:
            if last not in code:
                raise UnreadableRecords(f"{place}: there is no action file {last}.js in {folder}")
            before = last
        if last is None and record.get("coords") not in (None, [], coords):
            raise UnreadableRecords(f"{place}: blocks were built, and no action file is named that built them")
        coords = record.get("coords") or coords
        task.turns.append(texts(code, own, files))
        task.prompts.append(str(record.get("prompt") or ""))
        task.of = record.get("n_turns")
    for task in tasks.values():
        if isinstance(task.of, int) and len(task.turns) != task.of:
            raise UnreadableRecords(f"{raw.name}: task {task.name} has {len(task.turns)} of {task.of} turns")
    return list(tasks.values())


def text_of(path: Path) -> str:
    """Reads a file of UTF-8."""
    content = path.read_bytes()
    try:
        return content.decode("utf-8").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise UnreadableRecords(
            f"{path}, line {line}: not UTF-8 ({error.reason}); convert the file, or move it away if nothing needs it"
        ) from None


def record_of(line: str, place: str) -> dict[str, Any]:
    """Reads one record."""
    remedy = (
        "expected an object on each line; `jq -c '.[]'` makes lines of an array, `jq -c .` of objects that fill several"
    )
    try:
        record = json.loads(line)
    except ValueError as error:
        raise UnreadableRecords(f"{place}: not JSON: {error}; {remedy}") from None
    if not isinstance(record, dict):
        raise UnreadableRecords(f"{place}: {remedy}")
    for member in ("run_idx", "turn_idx"):
        if not isinstance(record.get(member), int):
            raise UnreadableRecords(f"{place}: {member} is missing, or no number")
    return record


def index_of(path: Any, place: str) -> int | None:
    """Returns the number of an action file, whose path is that of the machine it was written on."""
    if path is None:
        return None
    found = NUMBERED.fullmatch(re.split(r"[/\\]", str(path))[-1])
    if found is None:
        raise UnreadableRecords(f"{place}: action_file {path!r} is not named like 14.js")
    return int(found[1])


def action_files(folder: Path) -> dict[int, Path]:
    """Returns the action files below a folder, by number."""
    folders = sorted({path.parent for path in folder.rglob("*.js") if NUMBERED.fullmatch(path.name)})
    if len(folders) != 1:
        found = ", ".join(str(one.relative_to(folder)) for one in folders) or "none"
        raise UnreadableRecords(f"{folder} needs one folder of action files; found {found}")
    return numbered(folders[0])


def numbered(folder: Path) -> dict[int, Path]:
    """Returns the numbered files of a folder."""
    found = ((NUMBERED.fullmatch(path.name), path) for path in folder.iterdir())
    return {int(name[1]): path for name, path in found if name is not None}


def texts(code: dict[int, Path], indices: list[int], files: Files) -> list[str]:
    """Reads files in order."""
    wanted = indices[-1:] if files == "last" else indices
    return [text_of(code[index]) for index in wanted]


def from_folders(folder: Path, files: Files) -> list[TaskRecord]:
    """Reads folders that are sorted by task and turn."""
    tasks = []
    for task in sorted({path.parent.parent for path in folder.rglob("*.js") if path.parent.name.isdecimal()}):
        record = TaskRecord(task.relative_to(folder).as_posix().replace("__", "/"))
        turns = sorted((turn for turn in task.iterdir() if turn.name.isdecimal()), key=lambda turn: int(turn.name))
        for expected, turn in enumerate(turns, start=1):
            if int(turn.name) != expected:
                raise UnreadableRecords(f"{task}: turn {turn.name} follows turn {expected - 1}")
            code = numbered(turn)
            record.turns.append(texts(code, sorted(code), files))
        tasks.append(record)
    return tasks
