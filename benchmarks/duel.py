"""One controller against another, day by day: what both benchmarks of drawn days count."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from statistics import mean
from time import process_time
from typing import NamedTuple, TypeVar

import numpy as np

from api.jobs.cores import cores
from controllers.slot import create_from
from station.metrics import metrics
from station.record import Record
from station.scenario import Scenario
from station.simulation import simulate

Task = TypeVar("Task")


class Outcome(NamedTuple):
    """One controller on one day."""

    t_avg: float  # [s]
    t_comp_restored: float  # [s]
    t_dis: float  # [s]
    unserved: frozenset[int]  # vehicles not finished, incomplete ones among them
    charge: float  # greatest state of charge of a vehicle; NaN at a plant that has none
    heat: float  # greatest temperature of a vehicle [degC]; NaN likewise
    cpu: float  # of a simulated hour [s]


def outcome(scenario: Scenario, controller: str, replication: int = 0, seed: int = 0) -> Outcome:
    """What a controller makes of a day."""
    actor = create_from(controller)
    begun = process_time()
    record = simulate(scenario, actor, replication=replication, seed=seed)
    spent = process_time() - begun
    found = metrics(record)
    return Outcome(
        found.t_avg,
        found.t_comp_restored,
        found.t_dis,
        frozenset(np.flatnonzero(np.isnan(record.vehicles["finished"])).tolist()),
        _greatest(record, "state_of_charge"),
        _greatest(record, "temperature_max"),
        3600 * spent / max(float(record["time"][-1]), 1.0),
    )


def _greatest(record: Record, figure: str) -> float:
    """Of all vehicles; NaN where the record has no such figure."""
    return float(np.max(record.vehicles.get(figure, np.nan), initial=-np.inf))


def outcomes(play: Callable[[Task], Outcome], tasks: Iterable[Task]) -> Iterator[Outcome]:
    """Outcomes of tasks in their order, each as it is done; one process a core."""
    with ProcessPoolExecutor(cores(), mp_context=get_context("spawn")) as pool:
        yield from pool.map(play, tasks)


class Verdict(NamedTuple):
    """A controller against another over days; means and sums are of the other and of the controller."""

    days: int
    wait: int  # days on which it is no worse in waiting
    compress: int  # in compressor time
    both: int
    t_avg: tuple[float, float]  # means [s]
    t_comp_restored: tuple[float, float]
    t_dis: tuple[float, float]
    unserved: tuple[int, int]
    left: int  # days on which it leaves a vehicle unfinished that the other finishes
    charge: float  # greatest state of charge that it gives; NaN at a plant that has none
    heat: float  # greatest temperature of a vehicle [degC]; NaN likewise
    cpu: float  # mean of a simulated hour of the controller [s]


def verdict(theirs: list[Outcome], ours: list[Outcome]) -> Verdict:
    """A controller's days against another's; times are compared to the microsecond."""
    wait = [a.t_avg >= b.t_avg - 1e-6 for a, b in zip(theirs, ours, strict=True)]
    compress = [a.t_comp_restored >= b.t_comp_restored - 1e-6 for a, b in zip(theirs, ours, strict=True)]

    def means(what: str) -> tuple[float, float]:
        return mean(getattr(a, what) for a in theirs), mean(getattr(b, what) for b in ours)

    return Verdict(
        len(ours),
        sum(wait),
        sum(compress),
        sum(a and b for a, b in zip(wait, compress, strict=True)),
        means("t_avg"),
        means("t_comp_restored"),
        means("t_dis"),
        (sum(len(a.unserved) for a in theirs), sum(len(b.unserved) for b in ours)),
        sum(bool(b.unserved - a.unserved) for a, b in zip(theirs, ours, strict=True)),
        max(b.charge for b in ours),
        max(b.heat for b in ours),
        mean(b.cpu for b in ours),
    )


def joined(first: Verdict, then: Verdict) -> Verdict:
    """The verdict over two stretches of days that no day is in twice."""
    days = first.days + then.days

    def mean_of(a: float, b: float) -> float:
        return (first.days * a + then.days * b) / days

    def means(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float]:
        return mean_of(a[0], b[0]), mean_of(a[1], b[1])

    return Verdict(
        days,
        first.wait + then.wait,
        first.compress + then.compress,
        first.both + then.both,
        means(first.t_avg, then.t_avg),
        means(first.t_comp_restored, then.t_comp_restored),
        means(first.t_dis, then.t_dis),
        (first.unserved[0] + then.unserved[0], first.unserved[1] + then.unserved[1]),
        first.left + then.left,
        max(first.charge, then.charge),
        max(first.heat, then.heat),
        mean_of(first.cpu, then.cpu),
    )
