"""Forecasts: futures that all controllers share, their bands, and which controller they advise."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.forecasting.accounts import Account
from station.forecasting.demand import Demand, table
from station.forecasting.fork import Fork
from station.forecasting.futures import Contender, Loom, Outcomes

Floats = NDArray[np.float64]

LEVELS = (0.05, 0.5, 0.95)
"""Quantiles of a band."""

Progress = Callable[[int, int], None]
"""Told of futures done, and of how many there are."""


class Band(NamedTuple):
    """Quantiles of a figure over the futures, at LEVELS, and its mean."""

    low: float
    median: float
    high: float
    mean: float

    @classmethod
    def of(cls, values: Floats) -> Band:
        """The band of one figure (futures,); of those that are numbers."""
        known = values[~np.isnan(values)]
        if not len(known):
            return cls(np.nan, np.nan, np.nan, np.nan)
        low, median, high = np.quantile(known, LEVELS)
        return cls(float(low), float(median), float(high), float(known.mean()))


class Price(NamedTuple):
    """Prices of service, beside what a station pays."""

    waiting: float  # of an hour that a vehicle waits [EUR/h]
    unserved: float  # of a vehicle that leaves before it is full [EUR]


class Ranked(NamedTuple):
    """A controller in the order of its mean score."""

    name: str
    score: float  # mean over the futures of cost, waiting and vehicles unserved at their prices [EUR]
    best: float  # share of the futures in which no other scores better
    saves: float  # mean cost that it saves against the controller that acts [EUR]
    waits: float  # mean wait that it adds for each vehicle against that controller [s]
    loses: float  # mean number of vehicles that it adds to those which leave before they are full
    beats: float  # share of the futures in which it scores better than that controller, ties halved


@dataclass(frozen=True)
class Forecast:
    """Futures of a station under controllers that share them: future k of each has the same state and vehicles."""

    begin: float  # [s]
    horizon: int  # [s]
    outcomes: tuple[Outcomes, ...]  # by controller; the first is the one that acts
    price: Price

    def ranking(self) -> list[Ranked]:
        """The controllers, least mean score first."""
        return ranked(self.outcomes, self.price)


def scores(outcomes: Sequence[Outcomes], price: Price) -> Floats:
    """Cost, waiting and vehicles unserved at their prices [EUR], (controllers, futures).

    Where a station tells no cost, service alone counts.
    """
    return np.array([
        np.nan_to_num(each["cost"], nan=0.0, posinf=1e9)
        + price.waiting * each["wait"] * each["vehicles"] / 3600
        + price.unserved * each["incomplete"]
        for each in outcomes
    ])  # fmt: skip


def ranked(outcomes: Sequence[Outcomes], price: Price) -> list[Ranked]:
    """Controllers, least mean score first; the first of `outcomes` is the one that acts, of equal ones it leads."""
    scored, acting = scores(outcomes, price), outcomes[0]
    least, found = scored.min(axis=0), []
    for each, score in zip(outcomes, scored, strict=True):
        better = (score < scored[0]).mean() + 0.5 * (score == scored[0]).mean()
        saves, waits = (acting["cost"] - each["cost"]).mean(), (each["wait"] - acting["wait"]).mean()
        loses = (each["incomplete"] - acting["incomplete"]).mean()
        best = (score <= least).mean()
        found.append(Ranked(each.name, *map(float, (score.mean(), best, saves, waits, loses, better))))
    return sorted(found, key=lambda one: one.score)


def state_of(fork: Fork) -> Callable[[int], Floats]:
    """The state in which every future of a fork begins, where it is known exactly."""
    return lambda _future: fork.state


def forecast(
    fork: Fork,
    contenders: Sequence[Contender],
    demand: Demand,
    account: Account,
    *,
    horizon: int,
    futures: int,
    price: Price,
    state: Callable[[int], Floats] | None = None,
    progress: Progress = lambda _done, _of: None,
) -> Forecast:
    """Run `futures` futures of `horizon` seconds under each contender; the first is the one that acts.

    Vehicles and states are drawn once and shared (common random numbers), so that differences between controllers
    owe nothing to luck.

    Parameters
    ----------
    fork
        Where the futures begin.
    contenders
        The controllers, at least one.
    demand
        Vehicles of each future besides those the fork knows.
    account
        What the futures cost.
    horizon
        Their length [s].
    futures
        Their number.
    price
        What waiting and vehicles unserved cost.
    state
        The state in which a future begins, where it is not known exactly; else the fork's.
    progress
        Told after each controller's futures.
    """
    begin = state or state_of(fork)
    tables = [table(fork, demand(number)) for number in range(futures)]
    states = [begin(number) for number in range(futures)]
    loom = Loom(fork, horizon, account)

    def each() -> Iterator[Outcomes]:
        for number, contender in enumerate(contenders):
            progress(number * futures, len(contenders) * futures)
            yield loom.run(contender, states, tables)

    return Forecast(fork.time, horizon, tuple(each()), price)
