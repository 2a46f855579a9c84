"""Shortages on Poisson days: `scenario` against the bound it states, and against `switched`.

Run as `python -m benchmarks.shortages`; `--document` rewrites the tables of docs/controllers.md, `--preset` and
`--days` pick a part. 100 days for each of two stations, with seeds that nothing was tuned on, half an hour.

A decision's own event is asked of two futures that the controller does not know: one drawn afresh from the law the day
was drawn from, and what the day itself still brings. Days are independent, decisions of a day are not: the limit by
days draws whole days with repetition, that of Clopper and Pearson takes decisions for independent.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta

from api.jobs.cores import cores
from benchmarks.documents import rewrite, seconds, table
from benchmarks.drawn import mean_fill
from controllers.scenario.controller import (
    DECISIONS,
    SCENARIO_SIZE,
    STARTS,
    Scenario,
    decide_by_tree,
    taken_falls_short,
    was_covered,
)
from controllers.slot import create_from
from controllers.switched.controller import EXPECTED
from station.compiled import callback
from station.control_model import ControlModel
from station.controller import DECIDE, CompiledController, Decision, Observation
from station.geometry import BUFFERS
from station.metrics import metrics
from station.parameters import Station
from station.preset_files import load_station
from station.record import Record
from station.scenario import Scenario as Day
from station.scenario import parse_scenario
from station.simulation import simulate

SEED = 6_113_027
DAYS = 100
PRESETS = ("thesis-fit", "thesis-fit-a")

VEHICLES = 10, 25
SPACING = 0.8, 2.0
"""Of arrivals on the mean, by the mean fill."""

START_SPREAD = 0.3
"""Relative half-width of the pressures with which vehicles arrive."""

NEVER = 1e9

NOTES_MAX = 4000
"""Candidates taken in a day."""

_NOTE = 3 + SCENARIO_SIZE

DRAWS = 2000
CONFIDENCE = 0.95


class Law(NamedTuple):
    """What a day is drawn from."""

    gap: float  # mean [s]
    usual: float  # start pressure [bar]

    def starts(self, random: np.random.Generator, count: int) -> NDArray[np.float64]:
        """Start pressures of so many vehicles [bar]."""
        return self.usual * (1 + START_SPREAD * random.uniform(-1, 1, count))


def poisson_day(place: int, station: Station, fill: float) -> tuple[Day, Law]:
    """Day `place` and its law: exponential gaps, each vehicle with its own start pressure."""
    random = np.random.default_rng([SEED, place])
    count = int(random.integers(VEHICLES[0], VEHICLES[1] + 1))
    law = Law(fill * random.uniform(*SPACING), station.vehicle.start_pressure_bar)
    times = np.rint(np.cumsum(random.exponential(law.gap, count)))
    vehicles = [
        {"time_s": float(time), "start_pressure_bar": float(start)}
        for time, start in zip(times, law.starts(random, count), strict=True)
    ]
    given = {
        "name": f"poisson-{place}",
        "station": station.model_dump(),
        "arrivals": {"kind": "trace", "vehicles": vehicles},
        "time_limit_s": float(times[-1] + 3 * fill * count + 20_000),
    }
    return parse_scenario(given), law


@callback(DECIDE)
def decide_noted(observation: Observation, model: ControlModel, settings: np.ndarray, memory: np.ndarray) -> Decision:
    """What `scenario` decides; its memory is copied behind it, with the time, whenever a candidate is taken."""
    before = int(memory[DECISIONS])
    decision = decide_by_tree(observation, model, settings, memory[:SCENARIO_SIZE])
    if memory[DECISIONS] > before:
        place = SCENARIO_SIZE + before * _NOTE
        memory[place] = observation.time
        memory[place + 1] = observation.queue_length
        memory[place + 2] = observation.vehicle
        memory[place + 3 : place + _NOTE] = memory[:SCENARIO_SIZE]
    return decision


class Noted(Scenario):
    """`scenario`, whose candidates can be looked at after a run."""

    ready: CompiledController

    def compiled(self) -> CompiledController:
        """This controller for the compiled loop, with room for notes."""
        ready = super().compiled()
        room = np.concatenate((ready.memory, np.zeros(NOTES_MAX * _NOTE)))
        self.ready = ready._replace(decide=decide_noted, memory=room)
        return self.ready

    @property
    def notes(self) -> NDArray[np.float64]:
        """A row for each candidate taken: time, queue, vehicle, memory."""
        count = int(self.ready.memory[DECISIONS])
        return self.ready.memory[SCENARIO_SIZE:].reshape((-1, _NOTE))[:count]


class Came(NamedTuple):
    """What became of a candidate."""

    time: int  # [s]
    covered: bool
    fresh: bool  # a shortage in a fresh future
    real: bool  # in what the day brought


def came_true(controller: Noted, day: Day, law: Law, place: int) -> list[Came]:
    """Each candidate of a run in a future from the day's law, and in the rest of the day."""
    coming, usual = day.vehicles(), day.station.vehicle
    random = np.random.default_rng([SEED, place, 1])
    found = []
    for note in controller.notes:
        time, queue, vehicle = note[0], int(note[1]), int(note[2])
        seen = Observation(
            time, 1.0, (0.0,) * 3, (0.0,) * 3, vehicle, 0.0, 0.0, usual.volume_m3, True, queue, 0,
            usual.finish_pressure_bar,
        )  # fmt: skip
        fresh = np.cumsum(random.exponential(law.gap, EXPECTED)), law.starts(random, STARTS)
        arrived = int(np.searchsorted(coming.arrival, time, side="right"))
        due, pressure = np.full(EXPECTED, NEVER), np.full(STARTS, law.usual)
        later = coming.arrival[arrived : arrived + EXPECTED] - time
        due[: later.size] = later
        starts = coming.start_pressure[arrived - queue : arrived - queue + STARTS]
        pressure[: starts.size] = starts
        falls = [taken_falls_short(controller.ready, note[3:], seen, *future) for future in (fresh, (due, pressure))]
        found.append(Came(int(time), was_covered(note[3:]), falls[0], falls[1]))
    return found


class Outcome(NamedTuple):
    """One day under one controller."""

    place: int
    controller: str
    t_avg: float
    t_comp_restored: float
    t_dis: float
    unserved: float
    short_seconds: int
    plans: int
    followed: int  # by a shortage before the next
    covered: int
    fresh: int  # covered decisions with a shortage in a fresh future
    real: int  # and in what the day brings
    open_fresh: int  # decisions that were not covered, likewise
    open_real: int


def short_rows(record: Record) -> NDArray[np.bool_]:
    """The seconds in which a vehicle is connected and every buffer is closer than the dispenser's least gap."""
    highest = np.max([record[f"pressure_{buffer}"][:-1] for buffer in BUFFERS], axis=0)
    gap = record.scenario.station.dispenser.outlet_gap_min_bar
    found: NDArray[np.bool_] = (record["vehicle"][:-1] >= 0) & (highest - record["pressure_vehicle"][:-1] < gap)
    return found


def followed(short: NDArray[np.bool_], times: Sequence[int]) -> int:
    """Decisions with a shortage before the next one."""
    begins = np.array(times, np.int64)
    sums = np.add.reduceat(short.astype(np.int64), begins[begins < short.size])
    return int(np.count_nonzero(sums))


def outcome(task: tuple[int, str, str, float]) -> Outcome:
    """One day at one station under one controller, of which `scenario` is listened to."""
    place, preset, name, fill = task
    day, law = poisson_day(place, load_station(preset), fill)
    controller = create_from(name) if name != "scenario" else Noted()
    record = simulate(day, controller)
    found, short = metrics(record), short_rows(record)
    if isinstance(controller, Noted):
        came = came_true(controller, day, law, place)
        times = [item.time for item in came]
        notes = np.array([item[1:] for item in came], np.bool_)
    else:
        times = np.flatnonzero(np.diff(record["decision_cost"][:-1], prepend=np.nan) != 0).tolist()
        notes = np.zeros((0, 3), np.bool_)
    covered, fresh, real = notes.T
    return Outcome(
        place, name, found.t_avg, found.t_comp_restored, found.t_dis, found.vehicles_not_finished, int(short.sum()),
        len(times), followed(short, times), int(covered.sum()), int((covered & fresh).sum()),
        int((covered & real).sum()), int((~covered & fresh).sum()), int((~covered & real).sum()),
    )  # fmt: skip


def outcomes(preset: str, names: Sequence[str], days: int = DAYS) -> Iterator[Outcome]:
    """Every controller on the first `days` days, as they are done."""
    fill = mean_fill(load_station(preset))
    tasks = [(place, preset, name, fill) for place in range(days) for name in names]
    with ProcessPoolExecutor(cores(), mp_context=get_context("spawn")) as pool:
        yield from pool.map(outcome, tasks, chunksize=len(names))


def upper_limit(hits: int, trials: int) -> float:
    """Upper limit of a chance after Clopper and Pearson, for independent trials."""
    return 1.0 if hits >= trials else float(beta.ppf(CONFIDENCE, hits + 1, trials - hits))


def upper_limit_by_days(hits: Sequence[int], trials: Sequence[int]) -> float:
    """Upper limit of a share, by drawing whole days with repetition."""
    h, n = np.array(hits), np.array(trials)
    chosen = np.random.default_rng(SEED).integers(0, len(h), (DRAWS, len(h)))
    return float(np.quantile(h[chosen].sum(axis=1) / n[chosen].sum(axis=1), CONFIDENCE))


def event_rows(preset: str, found: Sequence[Outcome], bound: float) -> list[list[str]]:
    """The decision's own event at one station: covered, and a shortage in a future."""
    ours = [item for item in found if item.controller == "scenario"]
    plans = [item.plans for item in ours]
    total, covered = sum(plans), sum(item.covered for item in ours)
    rows = []
    for what, field in (("drawn afresh", "fresh"), ("as the day went on", "real")):
        hits = [getattr(item, field) for item in ours]
        open_hits = sum(getattr(item, f"open_{field}") for item in ours)
        shares = (
            sum(hits) / total, upper_limit(sum(hits), total), upper_limit_by_days(hits, plans), sum(hits) / covered,
            open_hits / max(1, total - covered),
        )  # fmt: skip
        rows.append(
            [preset, what, seconds(total), f"{100 * covered / total:.1f} %", seconds(sum(hits)),
             *(f"{100 * share:.2f} %" for share in shares), f"{100 * bound:.1f} %"]
        )  # fmt: skip
    return rows


def day_rows(preset: str, found: Sequence[Outcome], names: Sequence[str]) -> list[list[str]]:
    """The closed loop at one station."""
    by_name = {name: [item for item in found if item.controller == name] for name in names}
    base = by_name[names[0]]
    rows = []
    for name in names:
        items = by_name[name]
        cells = [preset, f"`{name}`"]
        for field in ("t_avg", "t_comp_restored", "t_dis"):
            values = np.array([getattr(item, field) for item in items])
            change = values - np.array([getattr(item, field) for item in base])
            error = change.std(ddof=1) / math.sqrt(len(change)) if len(change) > 1 else math.nan
            by_mean = "" if name == names[0] else f" ({change.mean():+.1f} ± {error:.1f})"
            cells.append(f"{values.mean():,.1f}{by_mean}".replace(",", " "))
        plans, followed = sum(item.plans for item in items), sum(item.followed for item in items)
        cells += [
            f"{sum(item.short_seconds for item in items) / len(items):.1f}", f"{followed} of {seconds(plans)}",
            f"{sum(item.unserved for item in items):g}",
        ]  # fmt: skip
        rows.append(cells)
    return rows


def main(arguments: Sequence[str]) -> None:
    """Measure and print, or rewrite the document."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--preset", action="append", choices=PRESETS)
    parser.add_argument("--days", type=int, default=DAYS)
    parser.add_argument("--document", action="store_true")
    given = parser.parse_args(arguments)
    names = ("switched", "scenario")
    events: list[list[str]] = []
    days: list[list[str]] = []
    for preset in given.preset or PRESETS:
        found = []
        for item in outcomes(preset, names, given.days):
            found.append(item)
            print(f"\r{preset}: {len(found)} of {len(names) * given.days} runs", end="", file=sys.stderr, flush=True)
        print(file=sys.stderr)
        events += event_rows(preset, found, create_from("scenario").settings_for(load_station(preset)).chance.value)
        days += day_rows(preset, found, names)
    parts = tables(events, days)
    print("\n\n".join(parts.values()))
    if given.document:
        rewrite("controllers.md", parts)


def tables(events: list[list[str]], days: list[list[str]]) -> dict[str, str]:
    """The generated parts of docs/controllers.md."""
    return {
        "shortages": table(
            ("station", "future", "decisions", "covered", "of these short", "share", "upper 95 %",
             "upper 95 %, by days", "of covered", "of the others", "bound"), events, 2,
        ),
        "poisson days": table(
            ("station", "controller", "t_avg [s]", "t_comp_restored [s]", "t_dis [s]", "short a day [s]",
             "decisions followed by a shortage", "not served"), days, 2,
        ),
    }  # fmt: skip


if __name__ == "__main__":
    main(sys.argv[1:])
