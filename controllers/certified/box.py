"""The states a claim of service is about: what a controller meets in S1-S4 when a vehicle connects, and 5 % more."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from controllers.slot import create
from station.geometry import BUFFERS
from station.parameters import Station
from station.scenario import Scenario
from station.scenario_files import load_scenario
from station.simulation import simulate

SCENARIOS = ("S1", "S2", "S3", "S4")

WIDENING = 0.05
"""Of pressures, by their value; of temperatures, by the width of what was seen."""

WITHIN = 1.5
"""T by the longest fill seen."""

SPACING = 2.0
"""s by the mean fill seen."""

COLUMNS = tuple(f"{quantity}_{buffer}" for quantity in ("pressure", "temperature") for buffer in BUFFERS)


@dataclass(frozen=True)
class Starved:
    """A vehicle of S1-S4 that was never served: the buffers when it connected."""

    scenario: str
    state: tuple[float, ...]  # pressures [bar], temperatures [deg C]


@dataclass(frozen=True)
class OperatingBox:
    """Operating conditions that a controller met in S1-S4."""

    fills: int
    mean_fill: float  # [s]
    worst_fill: float  # [s]
    worst_stay: float  # from arrival to departure [s]
    low: tuple[float, ...]  # pressures [bar], temperatures [deg C], each high, medium, low
    high: tuple[float, ...]
    starved: tuple[Starved, ...]

    @property
    def within(self) -> int:
        """T [s]."""
        return int(WITHIN * self.worst_fill)

    @property
    def spacing(self) -> int:
        """S [s]."""
        return int(SPACING * self.mean_fill)

    def as_document(self) -> dict[str, Any]:
        """As JSON holds it."""
        return {
            "scenarios": list(SCENARIOS), "fills": self.fills, "mean_fill_s": self.mean_fill,
            "worst_fill_s": self.worst_fill, "worst_stay_s": self.worst_stay,
            "low": dict(zip(COLUMNS, self.low, strict=True)), "high": dict(zip(COLUMNS, self.high, strict=True)),
            "starved": [item.scenario for item in self.starved],
        }  # fmt: skip


def observe_scenarios(station: Station, name: str, options: dict[str, Any]) -> OperatingBox:
    """Run S1-S4 at a station; what a controller met when vehicles connected, and how long it took."""
    fills, stays, states, starved = [], [], [], []
    for scenario in SCENARIOS:
        record = simulate(at(station, scenario), create(name, **options))
        vehicles = record.vehicles
        fills.append(vehicles["finished"] - vehicles["connected"])
        stays.append(vehicles["finished"] - vehicles["arrival"])
        connected = vehicles["connected"][np.isfinite(vehicles["connected"])]
        rows = np.searchsorted(record["time"], connected)
        known = rows < len(record["time"])  # one that connects when the run ends has no second of its own
        state = np.array([record[column][rows[known]] for column in COLUMNS]).T
        states.append(state)
        left = vehicles["finished"][np.isfinite(vehicles["connected"])][known]
        starved += [Starved(scenario, tuple(map(float, row))) for row in state[~np.isfinite(left)]]
    every, stay = np.concatenate(fills), np.concatenate(stays)
    done, seen = every[np.isfinite(every)], np.concatenate(states)
    return OperatingBox(
        len(done), float(done.mean()) if len(done) else 0.0, float(done.max(initial=0.0)),
        float(stay[np.isfinite(stay)].max(initial=0.0)), tuple(map(float, seen.min(0))), tuple(map(float, seen.max(0))),
        tuple(starved),
    )  # fmt: skip


def at(station: Station, scenario: str) -> Scenario:
    """A scenario of the thesis at a station."""
    return load_scenario(scenario).on(station)


def widened(seen: OperatingBox, station: Station) -> tuple[np.ndarray, np.ndarray]:
    """The box: ends of the pressures [bar] and temperatures [deg C] of high, medium, low, (6,) each.

    No state above the compressor's pressure or the buffers' temperature limit is in it: a station has none.
    """
    low, high = np.array(seen.low), np.array(seen.high)
    width = WIDENING * (high - low)
    width[:3] = 0.0
    low, top = low - width, high + width
    low[:3] *= 1.0 - WIDENING
    top[:3] *= 1.0 + WIDENING
    top[:3] = np.minimum(top[:3], station.compressor.pressure_bar * (1.0 - 1e-9))
    top[3:] = np.minimum(top[3:], station.thermal.buffer_temperature_max_c)
    return low, top
