"""What the solver leaves for the scorers, in the store of a sample, so that a log can be scored again."""

from __future__ import annotations

from typing import Any

from inspect_ai.util import StoreModel
from pydantic import Field

from ..refused import clean


class Build(StoreModel):
    """What a sample built."""

    texts: list[str] = Field(default_factory=list)
    """Texts of the model, one for each turn that it answered."""
    episode: str | None = None
    """Episode, if the sample was built turn by turn."""
    step: int = 0
    """Number of the episode's last step."""
    turn: int = 1
    """Number of the episode's turn."""
    run: str | None = None
    """Run that the submission belongs to."""
    submission: str | None = None
    """The submission, once it was made."""
    refused: list[str] = Field(default_factory=list)
    """Reasons why the code of turns was refused, which are therefore empty."""
    graded: dict[str, Any] | None = None
    """Verdicts of the report, once it was graded."""


def answers(texts: list[str], turns: int) -> list[dict[str, Any]]:
    """Returns the turns to submit. A turn that the model was not asked for, because a limit ended the sample, is empty."""
    missing: list[dict[str, Any]] = [{"events": []}] * (turns - len(texts))
    return [{"action_code": clean(text)} for text in texts] + missing
