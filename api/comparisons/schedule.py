"""The schedule of one run, from its record: which vehicle is served and which valve is open when."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from api.jobs.cores import cores
from api.runs.service import Result, run
from station import Record, Scenario, StationError

VALVES = tuple(f"{side}_{buffer}" for side in ("outlet", "inlet") for buffer in ("high", "medium", "low"))
"""In the order of a schedule's rows."""

SCHEDULES_MAX = 24
"""Runs of which a report holds the schedule: a comparison keeps figures only, so each is computed once more."""

Span = tuple[float, float]
"""From when to when [s]."""


@dataclass(frozen=True)
class Schedule:
    """One run: all times in seconds of the station's clock."""

    controller: str
    end: float
    waits: tuple[Span, ...]  # of each vehicle, from its arrival to its connection or the end
    fills: tuple[Span, ...]  # of each vehicle that was connected, to its leaving or the end
    finished: int  # vehicles
    valves: tuple[tuple[Span, ...], ...]  # when each of VALVES was open


def schedules(scenarios: Sequence[Scenario], results: Sequence[Result]) -> dict[str, list[Schedule]]:
    """By scenario, that of each controller's first replication among the results; at most SCHEDULES_MAX.

    A run that cannot be repeated is left out.
    """
    whole = {scenario.name: scenario.model_dump_json() for scenario in scenarios}
    first: dict[tuple[str, str], Result] = {}
    for result in sorted(results, key=lambda each: each.replication):
        first.setdefault((result.scenario, result.controller), result)
    order = dict.fromkeys((result.scenario, result.controller) for result in results if result.scenario in whole)
    chosen = [first[key] for key in order][:SCHEDULES_MAX]
    with ThreadPoolExecutor(cores()) as pool:
        found = pool.map(lambda r: _schedule(whole[r.scenario], r.controller, r.replication, r.seed), chosen)
    drawn: dict[str, list[Schedule]] = {}
    for result, schedule in zip(chosen, found, strict=True):
        if schedule is not None:
            drawn.setdefault(result.scenario, []).append(schedule)
    return drawn


@lru_cache(4 * SCHEDULES_MAX)
def _schedule(scenario: str, controller: str, replication: int, seed: int) -> Schedule | None:
    """The same run gives the same schedule, so a report that is asked for again costs nothing."""
    try:
        return schedule_of(run(Scenario.model_validate_json(scenario), controller, replication, seed=seed)[1])
    except StationError:
        return None


def schedule_of(record: Record) -> Schedule:
    """The schedule of a record."""
    time, vehicles = record["time"], record.vehicles
    end = float(time[-1])
    arrival = vehicles["arrival"]
    connected = np.where(np.isfinite(vehicles["connected"]), vehicles["connected"], np.inf)
    left = np.where(np.isfinite(vehicles["finished"]), vehicles["finished"], end)
    fills = [(float(a), float(b)) for a, b in zip(connected, left, strict=True) if np.isfinite(a)]
    waits = [(float(a), float(b)) for a, b in zip(arrival, np.minimum(connected, end), strict=True)]
    return Schedule(
        record.controller, end, tuple(waits), tuple(fills), int(np.isfinite(vehicles["finished"]).sum()),
        tuple(spans(time, record[valve]) for valve in VALVES),
    )  # fmt: skip


def spans(time: np.ndarray, open_: np.ndarray) -> tuple[Span, ...]:
    """From when to when something is open: a row holds until the next."""
    edges = np.diff(np.concatenate(([0], (np.asarray(open_) != 0).astype(np.int8), [0])))
    stops = np.minimum(np.flatnonzero(edges == -1), len(time) - 1)
    found = zip(time[np.flatnonzero(edges == 1)], time[stops], strict=True)
    return tuple((float(a), float(b)) for a, b in found if b > a)
