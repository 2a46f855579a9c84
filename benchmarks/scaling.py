"""What a second core brings to a comparison of many runs."""

from __future__ import annotations

import time
from collections.abc import Iterator

from api.comparisons.service import compare
from api.runs.service import Result
from benchmarks.days import CONTROLLERS
from benchmarks.measure import Bar, Row
from station import load_scenario

REPLICATIONS = 100
SCALING_BAR = Bar("at least", 1.7)


def rows(repeats: int) -> Iterator[Row]:
    """Wall clock of S4 with 100 replications and four controllers, one worker against two, taken in turn."""
    _timed(1, 2)
    one, two = [], []
    for _ in range(repeats):
        seconds, first = _timed(REPLICATIONS, 1)
        one.append(seconds)
        seconds, second = _timed(REPLICATIONS, 2)
        two.append(seconds)
        if first != second:
            raise AssertionError("the number of workers changes the results")
    runs = REPLICATIONS * len(CONTROLLERS)
    yield Row(f"compare S4, {runs} runs, 1 worker (wall)", tuple(one), "s")
    yield Row(f"compare S4, {runs} runs, 2 workers, same results (wall)", tuple(two), "s")
    ratios = tuple(slow / fast for slow, fast in zip(one, two, strict=True))
    yield Row("compare S4, 1 worker / 2 workers", ratios, "times", SCALING_BAR)


def _timed(replications: int, workers: int) -> tuple[float, list[Result]]:
    """Wall clock [s] and results of one comparison."""
    before = time.perf_counter()
    results = compare([load_scenario("S4")], CONTROLLERS, replications=replications, workers=workers)
    return time.perf_counter() - before, results
