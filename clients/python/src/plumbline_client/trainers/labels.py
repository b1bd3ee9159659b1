"""What a data set says of a sample: which task it is about, and how it is rewarded."""

from __future__ import annotations

import difflib
import json
from collections.abc import Mapping
from typing import Any

from ..refused import clean

MEMBERS = ("task", "suite", "profile", "reward")
SCHEMES = ("reward", "scheme", "reward_scheme")
"""Names under which data sets have the reward's scheme."""


def request(label: object, texts: list[str]) -> dict[str, Any]:
    """Returns the request to grade a model's texts for a label.

    A label is a task's id or number, or JSON (or a mapping) with `task` and, if wanted, `suite`, `profile` and `reward`;
    other members belong to the data set. Raises ValueError if it names no task, or if a member looks like one of these
    misspelt.
    """
    found: Any = label
    if isinstance(label, str):
        try:
            found = json.loads(label)
        except ValueError:
            found = label
    members: Mapping[str, Any] = found if isinstance(found, Mapping) else {"task": found}
    refuse_misspelt(members)
    # Data sets for other frameworks call the reward's scheme otherwise.
    scheme = members.get("reward") or members.get("scheme") or members.get("reward_scheme")
    members = {**members, "reward": scheme}
    named = {name: members[name] for name in MEMBERS if members.get(name) is not None}
    if not isinstance(named.get("task"), (str, int)) or named["task"] == "":
        raise ValueError(f"the label {label!r} names no task")
    return {**named, "answer": [clean(text) for text in texts]}


def refuse_misspelt(members: Mapping[str, Any]) -> None:
    """Raises ValueError if a member is likely meant as one that is not there."""
    is_rewarded = any(name in members for name in SCHEMES)
    missing = [name for name in (*MEMBERS, *SCHEMES) if name not in members and not (is_rewarded and name in SCHEMES)]
    for name in members:
        # A plural is another name.
        near = difflib.get_close_matches(str(name).lower(), missing, n=1, cutoff=0.8)
        if near and name not in (*MEMBERS, *SCHEMES) and name != f"{near[0]}s":
            raise ValueError(f"the label has {name!r}, which is unknown; did you mean {near[0]}?")


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
