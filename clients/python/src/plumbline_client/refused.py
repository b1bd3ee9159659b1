"""Code that the service refuses because it reaches a limit, such as a loop without end: the model's own doing."""

from __future__ import annotations

import re
from typing import Any

from .errors import Faulty

CODE = re.compile(r"/turns/(\d+)/action_code(/\d+)?")


def without_refused(turns: list[dict[str, Any]], error: Faulty) -> tuple[list[dict[str, Any]], list[str]]:
    """Returns the turns with those whose code was refused left empty, and the reasons.

    Raises the error again if anything else is wrong with the request.
    """
    emptied, reasons = list(turns), []
    for fault in error.faults:
        found = CODE.fullmatch(fault.pointer)
        if found is None or int(found[1]) >= len(turns):
            raise error
        emptied[int(found[1])] = {"events": []}
        reasons.append(f"the code of turn {int(found[1]) + 1} was refused, so the turn is empty: {fault.detail}")
    if not reasons:
        raise error
    return emptied, reasons


def clean(text: str) -> str:
    """Returns a text that can be written as UTF-8: halves of surrogate pairs become replacement characters."""
    return text.encode("utf-8", "replace").decode("utf-8") if any("\ud800" <= c <= "\udfff" for c in text) else text
