"""Tokens and cost of an evaluation."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from ..errors import PlumblineError
from .model import Completion, Usage
from .plan import Budget, Prices

MILLION = 1_000_000


class BudgetSpent(PlumblineError):
    """A limit of the budget is reached."""


@dataclass
class Spending:
    """What the answers of the model took, those of an earlier process included."""

    prices: Prices | None
    requests: int = 0
    input: int = 0
    output: int = 0
    cached_input: int = 0
    reasoning: int = 0
    unmetered: int = 0
    """Answers whose tokens the endpoint did not tell."""

    def add(self, usage: Usage) -> None:
        """Counts an answer."""
        self.requests += 1
        if usage.input is None or usage.output is None:
            self.unmetered += 1
        self.input += usage.input or 0
        self.output += usage.output or 0
        self.cached_input += usage.cached_input or 0
        self.reasoning += usage.reasoning or 0

    def cost(self) -> float | None:
        """Returns the cost; None if it is unknown, because there are no prices or because tokens were not told."""
        if self.prices is None or self.unmetered:
            return None
        cached = self.cached_input if self.prices.cached_input is not None else 0
        cost = (self.input - cached) * self.prices.input + self.output * self.prices.output
        return (cost + cached * (self.prices.cached_input or 0.0)) / MILLION

    def refuse_beyond(self, budget: Budget) -> None:
        """Raises `BudgetSpent` if a limit is reached."""
        if budget.requests is not None and self.requests >= budget.requests:
            raise BudgetSpent(f"{self.requests} requests were made; the budget has {budget.requests}")
        tokens = self.input + self.output
        if budget.tokens is not None and tokens >= budget.tokens:
            raise BudgetSpent(f"{tokens} tokens were used; the budget has {budget.tokens}")
        if self.unmetered and (budget.tokens is not None or budget.cost is not None):
            raise BudgetSpent("the endpoint does not tell the tokens of its answers, so the budget cannot be kept")
        cost = self.cost()
        if budget.cost is not None and cost is not None and cost >= budget.cost:
            raise BudgetSpent(f"{cost:.4f} was spent; the budget has {budget.cost:.4f}")

    def as_json(self) -> dict[str, Any]:
        """Returns the tokens and the cost; what is unknown is null."""
        is_known = self.unmetered == 0
        cost = self.cost()
        return {
            "requests": self.requests,
            "input_tokens": self.input if is_known else None,
            "output_tokens": self.output if is_known else None,
            "cached_input_tokens": self.cached_input if is_known else None,
            "reasoning_tokens": self.reasoning if is_known else None,
            "cost": None if cost is None else round(cost, 6),
            "currency": self.prices.currency if self.prices and cost is not None else None,
            "prices_as_of": self.prices.as_of if self.prices and cost is not None else None,
        }


def spent(prices: Prices | None, completions: Iterable[dict[str, Any]]) -> Spending:
    """Counts the answers of a journal."""
    spending = Spending(prices)
    for entry in completions:
        spending.add(Completion.of_json(entry["completion"]).usage)
    return spending
