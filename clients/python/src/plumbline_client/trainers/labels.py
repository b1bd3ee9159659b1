"""What a data set says of a sample: which task it is about, and how it is rewarded."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from ..calls import TYPES_OF_MISSING, plain
from ..refused import clean

MEMBERS = ("task", "suite", "profile", "reward")
WORDS = {"schema", "site"}
"""Names of a data set's own that are near to others."""
SCHEMES = ("reward", "scheme", "reward_scheme")
"""Names under which data sets have the reward's scheme."""


def request(label: object, texts: Sequence[str | None]) -> dict[str, Any]:
    """Returns the request to grade a model's texts for a label.

    A label is a task's id or number, or JSON (or a mapping) with `task` and, if wanted, `suite`, `profile` and `reward`;
    other members belong to the data set. A task may be written out, as a mapping or JSON with `turns`. A text that is
    None, as of a model that only called tools, is empty. Raises ValueError if the label names no task, if a member looks
    like one of these misspelt, or if an answer is something other than a text.
    """
    found = read(label)
    members: Mapping[str, Any] = found if isinstance(found, Mapping) and not is_task(found) else {"task": found}
    refuse_misspelt(members)
    # Data sets for other frameworks call the reward's scheme otherwise.
    schemes = {name: without_nones(members[name]) for name in SCHEMES if not is_missing(members.get(name))}
    first = next(iter(schemes), "reward")
    for name, scheme in schemes.items():
        if scheme != schemes[first]:
            raise ValueError(f"the label {label!r} has two schemes, {first} and {name}; give one")
    members = {**members, "reward": schemes.get(first), "task": task_of(members.get("task"))}
    named = {name: members[name] for name in MEMBERS if not is_missing(members.get(name))}
    if "task" not in named:
        raise ValueError(f"the label {label!r} names no task: expected an id, a number, or a task with turns")
    wrong = next((text for text in texts if not isinstance(text, str | None)), None)
    if wrong is not None:
        raise ValueError(f"an answer is a text, and this is {repr(wrong)[:200]}")
    return {**named, "answer": ["" if text is None else clean(text) for text in texts]}


def read(value: object) -> Any:
    """Returns a value as Python has it, and what a text holds where it is JSON."""
    if isinstance(value, str):
        try:
            return json.loads(value)
        except ValueError:
            return value
    if value is None or isinstance(value, (bool, int, float, Mapping)):
        return value
    try:
        return plain(value)
    except TypeError:
        return value


def is_task(members: Mapping[str, Any]) -> bool:
    """Whether these are the members of a task that is written out, and not of a label."""
    return is_missing(members.get("task")) and isinstance(members.get("turns"), Sequence)


def task_of(value: object) -> Any:
    """Returns a task as requests name it, or None. Tables of data make floats or texts of numbers."""
    found = read(value)
    if isinstance(found, Mapping):
        return without_nones(found) if is_task(found) else None
    if isinstance(found, float) and found.is_integer():
        return int(found)
    if isinstance(found, str) and re.fullmatch(r"[0-9]+", found.strip()):
        return int(found)
    return found if isinstance(found, (int, str)) and not isinstance(found, bool) else None


def is_missing(value: object) -> bool:
    """Whether a table of data has no value here: None, NaN, the missing value of pandas or Arrow, or an empty text."""
    if hasattr(value, "as_py"):
        value = plain(value)
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return True
    return (isinstance(value, str) and not value.strip()) or type(value).__name__ in TYPES_OF_MISSING


def without_nones(value: Any) -> Any:
    """Leaves out members that are None, which Arrow adds to mappings that lack what others have."""
    if isinstance(value, Mapping):
        return {name: without_nones(member) for name, member in value.items() if member is not None}
    return [without_nones(element) for element in value] if isinstance(value, list) else value


def is_scheme(value: object) -> bool:
    """Whether a value says how a sample is rewarded, and is no reward."""
    if isinstance(value, Mapping):
        return "weights" in value or (bool(value) and set(value) <= set(CRITERIA))
    return isinstance(value, str) and value in ("strict", "shaped", "mean")


def refuse_misspelt(members: Mapping[str, Any]) -> None:
    """Raises ValueError if a name is a slip away from one that is not there, or if it is `weights` or begins with
    `reward` and holds a scheme where none is given. Another plural is another name.
    """
    known = {*MEMBERS, *SCHEMES}
    given = set(members)
    for name in given - known:
        is_other = str(name).startswith("reward") or name == "weights"
        if not given & set(SCHEMES) and is_other and is_scheme(members[name]):
            raise ValueError(f"{name!r} is unknown; did you mean reward?")
    missing = known - given - (set(SCHEMES) if given & set(SCHEMES) else set())
    for name in given - known - WORDS:
        for meant in missing:
            if is_slip(str(name).lower(), meant) and name != f"{meant}s":
                raise ValueError(f"{name!r} is unknown; did you mean {meant}?")


def is_slip(name: str, meant: str) -> bool:
    """Whether a name has at most one letter more, less or other, or two letters swapped."""
    pairs = zip(name, meant, strict=False)
    same = next((i for i, (a, b) in enumerate(pairs) if a != b), min(len(name), len(meant)))
    one, other = name[same:], meant[same:]
    is_swapped = one[:2] == other[1::-1] and one[2:] == other[2:]
    return is_swapped or one[1:] == other or one == other[1:] or one[1:] == other[1:]


def components(graded: Mapping[str, Any], names: tuple[str, ...]) -> dict[str, float | None]:
    """Returns the components of a reward, with None where a criterion does not apply."""
    told = graded.get("components") or {}
    return {name: told.get(name) for name in names}


CRITERIA = (
    "overall",
    "material",
    "shape",
    "size",
    "physical_plausibility",
    "dependency",
    "structural_stability",
    "efficiency",
)
