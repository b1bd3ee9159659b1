"""Tokens and cost of an evaluation."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any

from ..errors import PlumblineError
from .journal import Journal
from .model import Completion, Usage
from .plan import Budget, Prices

MILLION = 1_000_000


class BudgetSpent(PlumblineError):
    """A limit of the budget is reached."""


@dataclass
class Spending:
    """What the requests to the model took, those of an earlier process included."""

    prices: Prices | None
    requests: int = 0
    input: int = 0
    output: int = 0
    cached_input: int | None = 0
    reasoning: int | None = 0
    untold: int = 0
    """Answers without token counts."""
    broken: int = 0
    """Requests without an answer that may have been paid for."""
    most_tokens: int = 0
    most_cost: float = 0.0
    """The most that one answer took. The budget counts as much for a request without an answer."""

    @property
    def unmetered(self) -> int:
        """Requests that may have been paid for but came without token counts."""
        return self.untold + self.broken

    def add(self, usage: Usage) -> None:
        """Counts an answer."""
        self.requests += 1
        self.untold += usage.input is None or usage.output is None
        took, paid = self.input + self.output, self._paid()
        self.input += usage.input or 0
        self.output += usage.output or 0
        self.cached_input = both(self.cached_input, usage.cached_input)
        self.reasoning = both(self.reasoning, usage.reasoning)
        self.most_tokens = max(self.most_tokens, self.input + self.output - took)
        self.most_cost = max(self.most_cost, self._paid() - paid)

    def add_failed(self, is_billed: bool) -> None:
        """Counts a request that brought no answer; `is_billed` says whether it may have been paid for."""
        self.requests += 1
        self.broken += is_billed

    def cost(self) -> float | None:
        """Returns the cost; None if it is unknown, because there are no prices or because token counts are missing."""
        return None if self.prices is None or self.unmetered else self._paid()

    def _paid(self) -> float:
        """Returns the cost of the tokens that are known."""
        if self.prices is None:
            return 0.0
        cached = (self.cached_input or 0) if self.prices.cached_input is not None else 0
        cost = (self.input - cached) * self.prices.input + self.output * self.prices.output
        return (cost + cached * (self.prices.cached_input or 0.0)) / MILLION

    def refuse_beyond(self, budget: Budget, under_way: int) -> None:
        """Raises `BudgetSpent` if a limit is reached, with the requests that are under way."""
        if budget.requests is not None and self.requests + under_way >= budget.requests:
            raise BudgetSpent(f"the budget of {budget.requests} requests is used up; raise --max-requests to continue")
        broken = f" (requests without an answer counted as the largest: {self.broken})" if self.broken else ""
        tokens = self.input + self.output + self.broken * self.most_tokens
        if budget.tokens is not None and tokens >= budget.tokens:
            raise BudgetSpent(
                f"{tokens} tokens were used{broken}; the budget is {budget.tokens}; raise --max-total-tokens to continue"
            )
        if self.untold and (budget.tokens is not None or budget.cost is not None):
            raise BudgetSpent(
                "some answers came without token counts, so the budget cannot be checked; "
                "remove --max-total-tokens and --max-cost to continue"
            )
        cost = self._paid() + self.broken * self.most_cost
        if budget.cost is not None and cost >= budget.cost:
            raise BudgetSpent(
                f"{cost:.4f} was spent{broken}; the budget is {budget.cost:.4f}; raise --max-cost to continue"
            )

    def as_json(self) -> dict[str, Any]:
        """Returns the tokens and the cost; what is unknown is null."""
        is_known = self.unmetered == 0
        cost = self.cost()
        return {
            "requests": self.requests,
            "input_tokens": self.input if is_known else None,
            "output_tokens": self.output if is_known else None,
            "cached_input_tokens": self.cached_input if is_known and self.requests else None,
            "reasoning_tokens": self.reasoning if is_known and self.requests else None,
            "requests_without_tokens": self.unmetered,
            "cost": None if cost is None else round(cost, 6),
            "currency": self.prices.currency if self.prices and cost is not None else None,
            "prices_as_of": self.prices.as_of if self.prices and cost is not None else None,
        }


def both(one: int | None, other: int | None) -> int | None:
    """Adds two numbers; None if one of them is unknown."""
    return None if one is None or other is None else one + other


def spent(prices: Prices | None, journal: Journal) -> Spending:
    """Counts the requests of a journal."""
    spending = Spending(prices)
    for entry in journal.of_kind("completion"):
        spending.add(Completion.of_json(entry["completion"]).usage)
    for kind in ("unmetered", "unbilled"):
        for _ in journal.of_kind(kind):
            spending.add_failed(kind == "unmetered")
    for _ in range(lost(journal)):
        spending.add_failed(is_billed=True)
    return spending


def lost(journal: Journal) -> int:
    """Returns how many requests were sent by a process that did not live to see what became of them."""
    asked = Counter(entry["attempt"] for entry in journal.of_kind("asked"))
    # Requests of earlier versions were not noted before they were sent.
    first = {attempt: journal.all(attempt, "asked")[0]["at"] for attempt in asked}
    ends = (entry for kind in ("completion", "unmetered", "unbilled") for entry in journal.of_kind(kind))
    ended = Counter(end["attempt"] for end in ends if end["at"] >= first.get(end["attempt"], float("inf")))
    return (asked - ended).total()
