"""What is evaluated, and how."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

Mode = Literal["one-shot", "episodes"]


@dataclass(frozen=True)
class Sampling:
    """Parameters of the model. What is None is not sent, so that the endpoint's own default holds."""

    temperature: float | None = None
    top_p: float | None = None
    max_tokens: int | None = None
    reasoning_effort: str | None = None
    seed: int | None = None
    """Seed of the first run; each further run has the next one."""
    extra: dict[str, Any] = field(default_factory=dict)
    """Other members of the request, as the endpoint names them."""


@dataclass(frozen=True)
class Prices:
    """Prices for a million tokens. Without prices there is no cost; an unknown cost is never 0."""

    input: float
    output: float
    currency: str
    as_of: str
    """Date of the prices, as YYYY-MM-DD."""
    cached_input: float | None = None


@dataclass(frozen=True)
class Budget:
    """Where an evaluation stops by itself. What it has done so far is kept."""

    requests: int | None = None
    tokens: int | None = None
    cost: float | None = None


@dataclass(frozen=True)
class Plan:
    """What is evaluated, and how."""

    model: str
    agent: str
    suite: str = "mineceraft"
    epoch: str | None = None
    """Epoch of a hidden evaluation, in place of a suite."""
    tier: Literal["dev", "official"] = "dev"
    track: Literal["specified", "brief"] = "specified"
    profile: Literal["mindcraft", "published"] = "mindcraft"
    mode: Mode = "one-shot"
    steps: int = 4
    """Most steps of an episode in one turn."""
    pictures: bool = False
    """Whether a picture of the build comes with what a step did."""
    repeat: int = 1
    tasks: tuple[str, ...] = ()
    """Tasks to answer; all of the suite if there are none."""
    system: str | None = None
    """System prompt; by default the service's guide for agents."""
    sampling: Sampling = field(default_factory=Sampling)

    def as_json(self) -> dict[str, Any]:
        """Returns the plan for the journal."""
        found = asdict(self)
        found["tasks"] = list(self.tasks)
        return found

    def sha256(self) -> str:
        """Returns the hash of the plan, which names its folder."""
        return hashed(self.as_json())

    def manner(self) -> str:
        """Returns how the model is asked, to add to the name of the program; nothing if it answers each turn once."""
        pictures = " and pictures" if self.pictures else ""
        return f", episodes of {self.steps} answers a turn{pictures}" if self.mode == "episodes" else ""

    def configuration(self, system: str) -> str:
        """Returns the hash of everything that determines an answer: model, sampling, prompts and the way of asking.

        Repeats of one configuration share it, so it leaves out the seed, and which tasks are answered how often.
        """
        asked = self.as_json()
        for name in ("agent", "epoch", "repeat", "suite", "system", "tasks", "tier"):
            del asked[name]
        del asked["sampling"]["seed"]
        return hashed({**asked, "system": system})


def hashed(value: dict[str, Any]) -> str:
    """Returns the SHA-256 of a value as JSON."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, separators=(",", ":")).encode()).hexdigest()
