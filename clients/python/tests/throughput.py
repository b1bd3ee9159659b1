"""Measures concurrent rewards through the coalescer: python tests/throughput.py URL [CONCURRENT]

Each reward is for another log, so that none comes from the cache. Prints the median rate of five rounds.
"""

from __future__ import annotations

import asyncio
import statistics
import sys
import time
from typing import Any

from plumbline_client import AsyncClient, Coalescer


def log(number: int) -> list[dict[str, Any]]:
    """Returns a wall with one block somewhere else."""
    rows = [[x, y, 0, 0] for x in range(5) for y in range(5)]
    return [
        {"palette": ["stone"], "rows": [*rows, [number % 60, 0, 2 + number // 60 % 60, 0], [number // 3600, 1, 1, 0]]}
    ]


async def measured(url: str, concurrent: int, rewards: int, first: int) -> float:
    """Returns the rewards a second of one round."""
    numbers = iter(range(first, first + rewards))
    async with AsyncClient(url) as client, Coalescer(client) as grader:

        async def caller() -> None:
            for number in numbers:
                reward = await grader.reward(task="walls/5x1x5-raise", turns=log(number), reward="mean")
                assert reward is not None

        began = time.perf_counter()
        await asyncio.gather(*[caller() for _ in range(concurrent)])
        return rewards / (time.perf_counter() - began)


def main() -> None:
    url, concurrent, rewards = sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 512, 20_000
    rates = [asyncio.run(measured(url, concurrent, rewards, index * rewards)) for index in range(5)]
    told = ", ".join(f"{rate:,.0f}" for rate in rates)
    print(f"{concurrent} concurrent rewards: median {statistics.median(rates):,.0f} a second of five rounds ({told})")


main()
