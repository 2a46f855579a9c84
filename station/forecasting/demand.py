"""Demand of futures: vehicles that have announced themselves, and those drawn by a law or as they came so far."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.arrivals import Vehicles, sample
from station.columns import VEHICLE_COLUMNS
from station.forecasting.fork import Fork
from station.parameters import Station
from station.run import (
    ARRIVAL,
    ARRIVED,
    DELIVERED,
    FINISH_PRESSURE,
    START_PRESSURE,
    START_TEMPERATURE,
    VOLUME,
)
from station.scenario import Scenario

Floats = NDArray[np.float64]

FIGURES = [ARRIVAL, START_PRESSURE, START_TEMPERATURE, VOLUME, FINISH_PRESSURE]
"""Rows of a table of vehicles that are given, in the order of `Vehicles`."""

Demand = Callable[[int], Vehicles]
"""Vehicles that arrive in a future of that number, besides those known."""


class Seen(NamedTuple):
    """Vehicles that came while a station was watched, from which demand is learned."""

    vehicles: Floats  # (vehicle columns, n)
    seconds: float  # for which it was watched [s]


def seen_of(time: Floats, vehicle: Floats, pressure: Floats, station: Station, seconds: float) -> Seen:
    """Vehicles that were seen to connect, by rows of a watched station: each when its number was first told.

    Parameters
    ----------
    time, vehicle, pressure
        (n,) times [s], number of the vehicle connected (-1: none; NaN: not read, and as before), its pressure [bar].
    station
        Its usual vehicle has what was not read.
    seconds
        For which it was watched [s].
    """
    last = np.maximum.accumulate(np.where(np.isnan(vehicle), -1, np.arange(len(vehicle))))
    told = np.where(last >= 0, vehicle[last], -1.0)
    begins = np.flatnonzero((told >= 0) & (np.diff(told, prepend=-1.0) != 0))
    usual, found = station.vehicle, np.full((len(VEHICLE_COLUMNS), len(begins)), np.nan)
    start = np.array([_first_read(pressure[begin : begin + _SOON]) for begin in begins])
    known = (start > 0) & (start < usual.finish_pressure_bar)
    found[ARRIVAL] = time[begins]
    found[START_PRESSURE] = np.where(known, start, usual.start_pressure_bar)
    found[START_TEMPERATURE], found[VOLUME] = usual.start_temperature_c, usual.volume_m3
    found[FINISH_PRESSURE], found[DELIVERED] = usual.finish_pressure_bar, 0.0
    return Seen(found, seconds)


_SOON = 10
"""Rows within which the pressure a vehicle came with is read."""


def _first_read(pressure: Floats) -> float:
    read = pressure[np.isfinite(pressure)]
    return float(read[0]) if len(read) else np.nan


def nobody(_future: int) -> Vehicles:
    """No demand but the vehicles that are known."""
    return Vehicles(*np.empty((5, 0)))


def by_law(scenario: Scenario, begin: float, horizon: float, seed: int) -> Demand:
    """Arrivals as the law of a scenario draws them between `begin` and `begin + horizon` [s], day after day.

    Replications of the law follow one another as in a live run that repeats them: each lasts whole seconds.
    """
    period = max(1.0, float(np.ceil(scenario.arrivals.period_s)))
    first, last = int(begin // period), int((begin + horizon) // period)

    def draw(future: int) -> Vehicles:
        days = []
        for day in range(first, last + 1):
            number = 1 + future * (last - first + 1) + day - first
            drawn = sample(scenario.arrivals, scenario.station.vehicle, number, seed)
            days.append(np.array(drawn._replace(arrival=drawn.arrival + day * period)))
        return _within(np.hstack(days), begin, begin + horizon)

    return draw


def as_seen(seen: Seen, begin: float, horizon: float, seed: int) -> Demand:
    """A Poisson process whose rate is drawn from its posterior (Jeffreys' prior), with vehicles like those that came.

    `n` vehicles in `t` seconds leave a rate of Gamma(n + 1/2, t). Where none came, none has figures to be drawn.
    """
    figures, watched = seen.vehicles[FIGURES], max(seen.seconds, 1.0)
    count = figures.shape[1]

    def draw(future: int) -> Vehicles:
        random = np.random.default_rng([seed, future])
        number = random.poisson(random.gamma(count + 0.5) / watched * horizon) if count else 0
        drawn = figures[:, random.integers(0, max(count, 1), number)] if number else np.empty((5, 0))
        arrival = np.sort(np.rint(begin + horizon * random.random(number)))
        return Vehicles(arrival, *drawn[1:])

    return draw


def table(fork: Fork, drawn: Vehicles) -> Floats:
    """The table of vehicles of a future: those of the fork, those drawn, and one that never comes.

    With it a run goes on to its time limit; it is the last.
    """
    arrived = int(fork.counters[ARRIVED])
    coming = np.full((len(fork.vehicles), len(drawn.arrival)), np.nan)
    coming[FIGURES] = drawn
    coming[DELIVERED] = 0.0
    coming = np.hstack((fork.vehicles[:, arrived:], coming))
    coming = coming[:, np.argsort(coming[ARRIVAL], kind="stable")]
    never = np.full((len(fork.vehicles), 1), np.nan)
    never[ARRIVAL], never[DELIVERED] = np.inf, 0.0
    return np.ascontiguousarray(np.hstack((fork.vehicles[:, :arrived], coming, never)))


def _within(drawn: Floats, begin: float, end: float) -> Vehicles:
    return Vehicles(*drawn[:, (drawn[0] > begin) & (drawn[0] <= end)])
