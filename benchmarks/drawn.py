"""Drawn scenarios: what a station, its arrivals and its vehicles may be, fixed by seeds before anything was tuned."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.duel import Outcome, Verdict, outcome, outcomes, verdict
from controllers.slot import create_from
from station.metrics import metrics
from station.parameters import Station
from station.preset_files import load_station
from station.scenario import Scenario, parse_scenario
from station.scenario_files import load_scenario
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


def _play(task: tuple[str, int, str, float]) -> Outcome:
    controller, place, preset, fill = task
    return outcome(drawn(place, load_station(preset), fill), controller)


def verdicts(controllers: Sequence[str], preset: str, count: int = COUNT) -> list[Verdict]:
    """Each controller against logic on the first `count` drawn scenarios."""
    fill = mean_fill(load_station(preset))
    runs = [
        list(outcomes(_play, [(name, place, preset, fill) for place in range(count)]))
        for name in ("logic", *controllers)
    ]
    return [verdict(runs[0], found) for found in runs[1:]]


def main(arguments: list[str]) -> None:
    """`python -m benchmarks.drawn [PRESET [COUNT [CONTROLLER ...]]]`."""
    preset = arguments[0] if arguments else "thesis-fit"
    count = int(arguments[1]) if len(arguments) > 1 else COUNT
    controllers = arguments[2:] or ["switched"]
    for name, found in zip(controllers, verdicts(controllers, preset, count), strict=True):
        print(preset, name, found)


if __name__ == "__main__":
    import sys

    main(sys.argv[1:])
