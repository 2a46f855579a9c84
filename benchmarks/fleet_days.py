"""Days of 12 h with 20 to 100 vehicles, usual ones or a mixed fleet, at the presets and two stations of our own."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from benchmarks.duel import Outcome, Verdict, outcome, outcomes, verdict
from station.scenario import Scenario, parse_scenario

SEED = 26_112_311
"""Fixed before anything was tuned; tuning used others."""

PERIOD = 43_200.0
"""Span of the arrivals [s]."""

LIMIT = 400_000.0
"""Time limit of a run [s]: a station that is asked for more than it can give works on until all are served."""

STATIONS: dict[str, dict[str, Any]] = {
    "thesis-fit": {}, "thesis-fit-a": {}, "thesis-fit-b": {}, "thesis-fit-cascade": {}, "light-duty-700": {},
    "two compressors": {"preset": "light-duty-700", "compressor": {"count": 2}},
    "350 bar": {
        "preset": "thesis-fit-b",
        "vehicle": {"volume_m3": 0.4, "start_pressure_bar": 60.0, "finish_pressure_bar": 350.0},
    },
}  # fmt: skip
"""Presets, and changes to one under a name of our own."""

FLEET = [
    {"name": "car", "share": 6, "volume_m3": [0.1, 0.25]},
    {"name": "van", "share": 2, "volume_m3": [0.2, 0.4]},
    {
        "name": "bus", "share": 1, "volume_m3": [0.6, 1.5], "start_pressure_bar": [20, 120],
        "finish_pressure_bar": [350, 350],
    },
]  # fmt: skip


def day(place: int, station: str, mixed: bool) -> Scenario:
    """Day `place`: its number of vehicles and its law are drawn, and with `mixed` the vehicles from three classes."""
    random = np.random.default_rng([SEED, place])
    count = int(random.integers(20, 101))
    laws: list[dict[str, Any]] = [
        {"kind": "uniform", "count": count, "period_s": PERIOD},
        {"kind": "normal", "count": count, "period_s": PERIOD, "truncation": float(random.uniform(0.5, 2.5))},
        {"kind": "poisson", "rate_per_h": 3600 * count / PERIOD, "period_s": PERIOD},
        {"kind": "profile", "count": count, "hourly_weights": random.uniform(0.2, 1.0, 12).tolist()},
    ]
    law = laws[int(random.integers(len(laws)))]
    return parse_scenario(
        {
            "name": f"day-{place}",
            "station": {"preset": station, "name": station, **STATIONS[station]},
            "arrivals": {**law, "fleet": FLEET} if mixed else law,
            "time_limit_s": LIMIT,
        }
    )


def _play(task: tuple[str, int, str, bool]) -> Outcome:
    controller, place, station, mixed = task
    return outcome(day(place, station, mixed), controller, replication=place + 1, seed=SEED)


def verdicts(controller: str, count: int) -> Iterator[tuple[str, bool, Verdict]]:
    """`controller` against logic at every station, with usual vehicles and with a mixed fleet."""
    for mixed in (False, True):
        for station in STATIONS:
            if not (mixed and station == "350 bar"):  # cars would not find 700 bar there
                theirs, ours = (
                    list(outcomes(_play, [(name, place, station, mixed) for place in range(count)]))
                    for name in ("logic", controller)
                )
                yield station, mixed, verdict(theirs, ours)


def main(arguments: list[str]) -> None:
    """`python -m benchmarks.fleet_days [COUNT [CONTROLLER ...]]`."""
    count = int(arguments[0]) if arguments else 20
    for controller in arguments[1:] or ["switched"]:
        for station, mixed, found in verdicts(controller, count):
            print(controller, station, "mixed" if mixed else "usual", found, flush=True)


if __name__ == "__main__":
    import sys

    main(sys.argv[1:])
