"""Drawn scenarios: what a station, its arrivals and its vehicles may be, fixed by seeds before anything was tuned."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from statistics import mean
from typing import Any, NamedTuple

import numpy as np

from api.comparisons.service import cores
from controllers.slot import create_from
from station.metrics import Metrics, metrics
from station.parameters import Station, load_station
from station.scenario import Scenario, load_scenario, parse_scenario
from station.simulation import simulate

SEED = 7_062_026
COUNT = 200

VEHICLES = 3, 120
SPACING = 0.7, 2.0
"""Of arrivals, by the mean fill."""

VEHICLE_SPREAD = 0.3
"""Relative half-width of the pressures with which vehicles arrive."""

BUFFER_SPREAD = 0.1
"""Of those with which buffers start."""

BELOW_COMPRESSOR = 1.0
"""A drawn buffer stays this far below the compressor's pressure [bar]."""


class Outcome(NamedTuple):
    """One controller on one scenario; times in s."""

    controller: str
    place: int
    t_avg: float
    t_comp_restored: float
    t_dis: float
    unserved: float


def mean_fill(station: Station) -> float:
    """Mean time of an open outlet for a vehicle under logic in S3 [s]."""
    found = metrics(simulate(load_scenario("S3").on(station), create_from("logic")))
    return found.t_dis / found.vehicles


def drawn(place: int, station: Station, fill: float, seed: int = SEED) -> Scenario:
    """Scenario `place`: evenly spaced vehicles, each with its own start pressure, and buffers of their own."""
    random = np.random.default_rng([seed, place])
    count = int(random.integers(VEHICLES[0], VEHICLES[1] + 1))
    gap = fill * random.uniform(*SPACING)
    usual = station.vehicle.start_pressure_bar
    given = station.model_dump()
    for name in ("high", "medium", "low"):
        tank = given["buffers"][name]
        pressure = tank["initial_pressure_bar"] * (1 + BUFFER_SPREAD * random.uniform(-1, 1))
        tank["initial_pressure_bar"] = min(pressure, station.compressor.pressure_bar - BELOW_COMPRESSOR)
    vehicles = [
        {"time_s": round(i * gap), "start_pressure_bar": usual * (1 + VEHICLE_SPREAD * random.uniform(-1, 1))}
        for i in range(count)
    ]
    return parse_scenario(
        {
            "name": f"drawn-{place}",
            "station": given,
            "arrivals": {"kind": "trace", "vehicles": vehicles},
            "time_limit_s": 3 * gap * count + 20_000,
        }
    )


def _one(task: tuple[str, int, str, float]) -> Outcome:
    controller, place, preset, fill = task
    found: Metrics = metrics(simulate(drawn(place, load_station(preset), fill), create_from(controller)))
    return Outcome(
        controller, place, found.t_avg, found.t_comp_restored, found.t_dis, found.vehicles_not_finished
    )  # fmt: skip


def outcomes(controllers: list[str], preset: str, count: int = COUNT) -> Iterator[Outcome]:
    """Every controller on the first `count` drawn scenarios, as they are done."""
    fill = mean_fill(load_station(preset))
    tasks = [(name, place, preset, fill) for place in range(count) for name in controllers]
    with ProcessPoolExecutor(cores(), mp_context=get_context("spawn")) as pool:
        yield from pool.map(_one, tasks, chunksize=len(controllers))


class Verdict(NamedTuple):
    """A controller against another over drawn scenarios."""

    scenarios: int
    no_worse: int  # in waiting and compressor time together
    t_avg: tuple[float, float]  # means, of the other and of the controller [s]
    t_comp_restored: tuple[float, float]
    t_dis: tuple[float, float]
    unserved: float

    @property
    def share(self) -> float:
        """Scenarios in which it is no worse in both."""
        return self.no_worse / self.scenarios


def against(found: list[Outcome], controller: str, other: str) -> Verdict:
    """`controller` against `other`; times are compared to the microsecond."""
    by_place: dict[int, dict[str, Outcome]] = {}
    for item in found:
        by_place.setdefault(item.place, {})[item.controller] = item
    pairs = [(both[other], both[controller]) for both in by_place.values()]
    no_worse = sum(a.t_avg >= b.t_avg - 1e-6 and a.t_comp_restored >= b.t_comp_restored - 1e-6 for a, b in pairs)

    def means(name: str) -> tuple[float, float]:
        return mean(getattr(a, name) for a, _ in pairs), mean(getattr(b, name) for _, b in pairs)

    return Verdict(
        len(pairs),
        no_worse,
        means("t_avg"),
        means("t_comp_restored"),
        means("t_dis"),
        sum(b.unserved for _, b in pairs),
    )


def main(arguments: list[str]) -> None:
    """`python -m benchmarks.drawn [PRESET [COUNT [CONTROLLER ...]]]`."""
    preset = arguments[0] if arguments else "thesis-fit"
    count = int(arguments[1]) if len(arguments) > 1 else COUNT
    controllers = arguments[2:] or ["switched"]
    found: list[Outcome] = []
    for item in outcomes(["logic", *controllers], preset, count):
        found.append(item)
        print(f"\r{len(found)} of {count * (1 + len(controllers))} runs", end="", flush=True)
    print()
    for name in controllers:
        print(preset, name, against(found, name, "logic"))


if __name__ == "__main__":
    import sys

    rest: Any = sys.argv[1:]
    main(rest)
