"""Forecasts of measured twins against what came: `python -m benchmarks.measured_forecasts [--station h70-light]`.

Stations are drawn around a preset, as far off as a station's file may be. Each is calibrated from a measured day of
`logic`, and followed through another one by the filter of a twin. At drawn times its next hour is forecast from what
the filter believes, with every vehicle announced that waits or comes, and held against the hour that came.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from controllers import create_from
from controllers.contenders import contender
from station import Scenario, load_station, parse_scenario, simulate
from station.arrivals import Vehicles
from station.estimation.belief import Belief
from station.estimation.calibration import Calibration, calibrate
from station.estimation.filter import model_of
from station.estimation.interface import field_of
from station.estimation.online import OnlineFilter
from station.forecasting.accounts import Account
from station.forecasting.estimate import drawn, fork_of_belief, in_air
from station.forecasting.forecast import LEVELS, Price, forecast
from station.forecasting.futures import GRID
from station.frames import Frames, frames_of
from station.geometry import BUFFERS
from station.measured_day import measured_day, tags_of_day
from station.measurement import samples_of
from station.parameters import Station
from station.record import Record

HORIZON, FUTURES = 3600, 50
CALIBRATED_H, FOLLOWED_H, FIRST_H = 24, 12, 1
PRICE = Price(waiting=20.0, unserved=50.0)
AIR = 5.0
"""The air of a drawn station differs from its file's by at most this [K]."""

WIDE = 1.0
"""Bands narrower than this say nothing that could be wrong [bar]."""

Floats = NDArray[np.float64]


class Held(NamedTuple):
    """A forecast held against what came."""

    errors: Floats  # (times, buffers) of the medians [bar]
    inside: Floats  # (times, buffers) 1: within the band of 90 %, 0: outside; NaN: it is narrower than WIDE
    served: tuple[float, float]  # median of the futures, and what came


def drawn_station(preset: str, seed: int, part: float = 1.0) -> Station:
    """A station whose parameters are off by up to a part of the width of their priors: 15 %, of a top pressure 3 %.

    The air is off by up to AIR whatever the part is.
    """
    known, random = load_station(preset), np.random.default_rng([seed, 27])
    model = model_of(known)
    air = "thermal.ambient_temperature_c"
    values = {air: known.thermal.ambient_temperature_c + AIR * random.uniform(-1, 1)}
    for name, width in model.parameters.items():
        given, by = field_of(known, name), (1.0 if name == air else part) * width * random.uniform(-1, 1)
        values[name] = given + by if name in model.absolute else given * (1 + by)
    return model.station_at(known, values)


def day_of(station: Station, rate: float, hours: int) -> Scenario:
    """A day with so many vehicles an hour."""
    law = {"kind": "poisson", "rate_per_h": rate, "period_s": 3600.0 * hours}
    given = {"name": "day", "about": "drawn", "station": station.model_dump(mode="json"), "arrivals": law}
    return parse_scenario({**given, "time_limit_s": 3600.0 * hours})


def measured(record: Record, seed: int) -> Frames:
    """A record as sensors tell it, second by second."""
    return frames_of(samples_of(measured_day(record, seed), tags_of_day()))


def coming(record: Record, begin: float) -> Vehicles:
    """The vehicles that wait at a time, and those that come within the horizon."""
    given = record.vehicles
    there = (given["arrival"] <= begin + HORIZON) & ~(given["connected"] < begin)
    names = ("start_pressure", "start_temperature", "volume", "finish_pressure")
    return Vehicles(np.maximum(given["arrival"][there], begin), *(given[name][there] for name in names))


def held(record: Record, scenario: Scenario, begin: int, belief: Belief, seed: int) -> Held:
    """A forecast from a belief before a second, against the record of the day."""
    there = in_air(scenario, belief.ambient)
    fork = fork_of_belief(there, float(begin), belief)
    vehicles = coming(record, float(begin))
    (found,) = forecast(
        fork, [contender("logic", there)], lambda _future: vehicles, Account(there, fork, HORIZON, 0.3),
        horizon=HORIZON, futures=FUTURES, price=PRICE, state=drawn(there, fork, belief.spread, seed),
    ).outcomes  # fmt: skip
    low, median, high = np.quantile(found.pressures, LEVELS, axis=0)
    rows = np.arange(begin, begin + HORIZON + 1, GRID)
    true = np.array([record[f"pressure_{name}"][rows] for name in BUFFERS]).T
    inside = np.where(high - low > WIDE, (true >= low) & (true <= high), np.nan)
    finished = record.vehicles["finished"]
    came = int(np.count_nonzero((finished > begin) & (finished <= begin + HORIZON)))
    return Held(median - true, inside, (float(np.median(found["served"])), came))


def calibrated(preset: str, rate: float, seed: int) -> Calibration:
    """The calibration of a drawn station from a measured day."""
    day = day_of(drawn_station(preset, seed), rate, CALIBRATED_H)
    record = simulate(day, create_from("logic"), replication=1, seed=seed)
    return calibrate(measured(record, seed), load_station(preset))


def of_station(preset: str, rate: float, seed: int, count: int, known: Station) -> Iterator[Held]:
    """Forecasts of a drawn station that is known so."""
    hidden = drawn_station(preset, seed)
    scenario = day_of(known, rate, FOLLOWED_H)
    record = simulate(day_of(hidden, rate, FOLLOWED_H), create_from("logic"), replication=2, seed=seed)
    frames, followed, at = measured(record, seed + 1000), OnlineFilter(known), 0
    last = min(FOLLOWED_H * 3600, len(record) - 1) - HORIZON - 1  # a day ends when its last vehicle has left
    for begin in sorted(np.random.default_rng([seed, 3]).integers(FIRST_H * 3600, last, count).tolist()):
        followed.push(frames.part(at, begin + 1))
        at = begin + 1
        belief = followed.belief()
        if belief is None:
            raise AssertionError("an hour has been followed")
        yield held(record, scenario, begin, belief, seed)


def figures(found: list[Held]) -> list[str]:
    """Lines of figures."""
    errors, inside = np.abs([each.errors for each in found]), np.array([each.inside for each in found])
    medians = np.median(errors, axis=(1, 2))
    right = [round(median) == came for median, came in (each.served for each in found)]
    return [
        f"  buffers' median error: {np.median(errors):.2f} bar; after an hour {np.median(errors[:, -1]):.2f} bar",
        f"  median errors of forecasts: 90 % below {np.quantile(medians, 0.9):.2f} bar",
        f"  pressures within 90 % bands wider than {WIDE:g} bar: {np.nanmean(inside):.1%}",
        f"  served count right: {np.mean(right):.1%} of {len(found)}",
    ]


def main() -> None:
    """Parse the arguments and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--station", default="h70-light")
    parser.add_argument("--rate", type=float, default=4.0, help="vehicles an hour")
    parser.add_argument("--stations", type=int, default=8)
    parser.add_argument("--forecasts", type=int, default=25, help="of each station")
    parser.add_argument("--seed", type=int, default=1, help="of the first station")
    asked = parser.parse_args()
    accepted: list[Held] = []
    refused: list[Held] = []
    for seed in range(asked.seed, asked.seed + asked.stations):
        began = time.process_time()
        calibration = calibrated(asked.station, asked.rate, seed)
        if calibration.station is None:
            raise ValueError(f"station {seed} of {asked.station} cannot be calibrated")
        each = list(of_station(asked.station, asked.rate, seed, asked.forecasts, calibration.station))
        (refused if calibration.refused else accepted).extend(each)
        told = f"refused: {'; '.join(calibration.refused)}" if calibration.refused else "accepted"
        print(f"station {seed}, {time.process_time() - began:.0f} CPU-seconds, calibration {told}")
        print("\n".join(figures(each)), flush=True)
    for name, held_ones in (("accepted", accepted), ("refused", refused)):
        if held_ones:
            count = len(held_ones) // asked.forecasts
            print(f"{asked.station}, {asked.rate:g} vehicles an hour: {count} stations whose calibration is {name}")
            print("\n".join(figures(held_ones)))


if __name__ == "__main__":
    main()
