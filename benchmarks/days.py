"""How long a 12-hour day takes, with its full record: each controller, and the same day stepped from Python."""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import partial

from benchmarks.actors import SecondBySecond
from benchmarks.measure import Bar, Row, repeated
from controllers import create
from station import Scenario, load_scenario, simulate

CONTROLLERS = ("logic", "minlp1", "minlp2", "minlp3")
DAY_BAR = Bar("at most", 0.05)  # CPU seconds


def rows(repeats: int) -> Iterator[Row]:
    """CPU seconds a day and nanoseconds a step of each controller; what stepping from Python costs instead."""
    scenario = load_scenario("S3")
    for name in CONTROLLERS:
        steps = len(simulate(scenario, create(name))) - 1
        seconds = repeated(partial(_day, scenario, name), repeats, time.process_time)
        yield Row(f"day S3, {name}: {steps:,} steps, 96 vehicles, full record (CPU)", seconds, "s", DAY_BAR)
        yield Row(f"day S3, {name}: per step", tuple(1e9 * value / steps for value in seconds), "ns")
    yield _from_python(max(1, repeats // 4))


def _day(scenario: Scenario, name: str) -> None:
    simulate(scenario, create(name))


def _from_python(repeats: int) -> Row:
    """How many times longer the same day takes when Python calls the controller each second."""
    scenario = load_scenario("S3")
    compiled = simulate(scenario, create("minlp1"))
    ratios = []
    for _ in range(repeats):
        slow = simulate(scenario, SecondBySecond(create("minlp1")))
        if slow.to_bytes() != compiled.to_bytes():
            raise AssertionError("the day stepped from Python differs from the compiled one")
        fast = simulate(scenario, create("minlp1"))
        ratios.append(slow.timing.total / fast.timing.total)
    return Row("day S3, minlp1 stepped from Python / compiled, same bytes", tuple(ratios), "times")
