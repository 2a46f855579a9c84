"""What is asked for: runs and comparisons of a few vehicles, the same again and again."""

from __future__ import annotations

import random

from tests.nemesis.client import Request

CONTROLLERS = ("logic", "minlp1", "minlp1:horizon=2", "minlp3")


def few(count: int, seed: int) -> Request:
    """A scenario of a few vehicles: some milliseconds of work, some kilobytes of record."""
    arrivals = {"kind": "uniform", "count": count, "period_s": 300.0 * count}
    return {"name": f"few-{count}-{seed}", "arrivals": arrivals}


def a_run(chance: random.Random) -> Request:
    """A run; one of some dozens, so that the same is asked for again and again."""
    scenario = few(chance.randint(1, 3), 0)
    return {
        "scenario": scenario, "controller": chance.choice(CONTROLLERS), "replication": chance.randint(0, 3),
        "seed": chance.randint(0, 1),
    }  # fmt: skip


def a_comparison(chance: random.Random) -> Request:
    """A comparison of some chunks; some of them last for seconds."""
    scenarios = [few(count, 0) for count in (1, 3)]
    controllers = ["logic", chance.choice(["minlp1:horizon=2", "minlp1:horizon=3"])]
    return {
        "scenarios": scenarios, "controllers": controllers, "replications": chance.choice([2, 8, 24]),
        "seed": chance.randint(0, 1),
    }  # fmt: skip
