"""What a longer horizon brings and costs: rewrites the generated parts of docs/horizon.md.

Run as `python -m benchmarks.horizon`, or with the names of some parts; a quarter of an hour on two cores. Metrics and
shares are the same every time, the times are those of the machine named with them.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import NamedTuple

import numpy as np

from api.jobs.cores import cores
from benchmarks.decisions import MINLPS, each_decision, sample, solver
from benchmarks.documents import rewrite, seconds, table
from benchmarks.machine import machine
from benchmarks.measure import number
from controllers import create
from station import Observation, Scenario, Status, load_scenario, parse_scenario, simulate

DOCUMENT = "horizon.md"
HORIZONS = range(1, 11)
DAY_HORIZONS = range(1, 6)
"""Horizons a whole day of S3 is run with: at t = 5 that takes a minute, at t = 6 four."""

HOUR_VEHICLES = 8
STATES = 100
"""Observations of S3 each engine is timed on, of each controller; a solver is timed on every tenth."""

AGREEMENT = 1e-9
"""Two costs that differ by less than this, relatively, are the same: the gap at which SCIP stops."""

SOLVE_MAX = 10.0
"""A solver is not asked for a longer horizon once a solve takes longer [s]."""


def first_hour() -> Scenario:
    """S3 with its first vehicles only: the same times, an hour's worth of them."""
    scenario = load_scenario("S3")
    document = scenario.model_dump()
    arrival = scenario.vehicles().arrival[:HOUR_VEHICLES]
    start = scenario.station.vehicle.start_pressure_bar
    vehicles = [{"time_s": float(time), "start_pressure_bar": start} for time in arrival]
    document.update(arrivals={"kind": "trace", "vehicles": vehicles})
    del document["time_limit_s"]  # that of these arrivals is filled in
    return parse_scenario(document, "first hour of S3")


def outcome(scenario: Scenario, name: str, horizon: int) -> list[str]:
    """A row: controller, t, metrics, share of decisions proven optimal."""
    record = simulate(scenario, create(name, horizon=horizon))
    found = record.metrics()
    proven = float(np.mean(record["decision_status"][:-1] == int(Status.OPTIMAL)))
    return [
        name, f"{horizon}", seconds(found.t_total), seconds(found.t_comp), seconds(found.t_comp_restored),
        seconds(found.t_dis), f"{100 * proven:.1f} %",
    ]  # fmt: skip


def outcomes_part(scenario: Scenario, horizons: Iterable[int]) -> str:
    """The table of one scenario, controllers one after another."""
    jobs = [(name, horizon) for name in MINLPS for horizon in horizons]
    with ThreadPoolExecutor(cores()) as pool:
        rows = list(pool.map(lambda job: outcome(scenario, *job), jobs))
    headings = ["controller", "t", "t_total [s]", "t_comp [s]", "t_comp_restored [s]", "t_dis [s]", "proven"]
    return table(headings, rows)


def _times(values: Sequence[float], unit: float) -> list[str]:
    """Median, 99th percentile and maximum in units of so many seconds."""
    return [number(float(value) / unit) for value in (np.median(values), np.quantile(values, 0.99), max(values))]


def exact_part(scenario: Scenario, chosen: dict[str, list[Observation]]) -> str:
    """Microseconds a decision of the exact engine takes."""
    rows = []
    for name in MINLPS:
        for horizon in HORIZONS:
            actor = create(name, horizon=horizon)
            times = each_decision(actor, scenario, chosen[name])
            proven = np.mean([actor.decide(seen).status == int(Status.OPTIMAL) for seen in chosen[name]])
            rows.append([name, f"{horizon}", *_times(times, 1e-6), f"{100 * proven:.0f} %"])
    headings = ["controller", "t", "median [us]", "99th percentile [us]", "maximum [us]", "proven"]
    return table(headings, rows)


class Solve(NamedTuple):
    """What became of one solve."""

    seconds: float  # nan where it failed
    claimed: bool  # the solver calls it optimal and the plant agrees on its cost
    optimal: bool  # it costs what the exact engine's proven optimum costs


def _solved(engine: str, scenario: Scenario, name: str, horizon: int, states: Sequence[Observation]) -> Iterator[Solve]:
    exact = create(name, horizon=horizon, node_limit=10**7)
    exact.start(scenario.station)
    solving = solver(engine, create(name, horizon=horizon), scenario)
    for state in states:
        try:
            solution = solving.solve(state)
        except Exception as error:  # noqa: BLE001  # PySCIPOpt raises no narrower one where SCIP stumbles
            print(f"{engine}, {name}, t = {horizon}, {state.time:g} s: {error}", file=sys.stderr)
            yield Solve(float("nan"), claimed=False, optimal=False)
            continue
        best = exact.decide(state).cost
        same = abs(solution.cost - best) <= AGREEMENT * max(1.0, abs(best))
        yield Solve(solution.solve_seconds, solution.proven, same)


def solvers_part(scenario: Scenario, chosen: dict[str, list[Observation]]) -> str:
    """Milliseconds a solve takes, solver time alone, and how many solves reach the optimum."""
    rows = []
    for engine, title, longest in (("pyomo", "SCIP (Pyomo)", 6), ("casadi", "Bonmin (CasADi)", 2)):
        for horizon in range(1, longest + 1):
            solves = [
                solve for name in MINLPS for solve in _solved(engine, scenario, name, horizon, chosen[name][::10])
            ]
            times = [solve.seconds for solve in solves if not math.isnan(solve.seconds)]
            counts = (
                sum(solve.claimed for solve in solves),
                sum(solve.optimal for solve in solves),
                len(solves) - len(times),
            )
            rows.append([title, f"{horizon}", *_times(times, 1e-3), *(f"{count} of {len(solves)}" for count in counts)])
            if max(times) > SOLVE_MAX:
                break
    headings = ["engine", "t", "median [ms]", "99th percentile [ms]", "maximum [ms]", "claimed", "optimal", "failed"]
    return table(headings, rows)


def _machine_part() -> str:
    about = machine()
    return ", ".join(f"{name} {about[name]}" for name in about)


def parts(day: Scenario) -> dict[str, Callable[[], str]]:
    """What computes each generated part, by its name."""
    chosen = {name: sample(simulate(day, create(name)), STATES) for name in MINLPS}
    return {
        "machine": _machine_part,
        "exact": partial(exact_part, day, chosen),
        "solvers": partial(solvers_part, day, chosen),
        "S1": partial(outcomes_part, load_scenario("S1"), HORIZONS),
        "S3": partial(outcomes_part, day, DAY_HORIZONS),
        "hour": partial(outcomes_part, first_hour(), HORIZONS),
    }


def main(names: Sequence[str]) -> None:
    """Recompute the parts named, or all, and rewrite the document after each."""
    known = parts(load_scenario("S3"))
    if unknown := set(names) - set(known):
        sys.exit(f"no part is called {', '.join(sorted(unknown))}; there are {', '.join(known)}")
    for name in names or known:
        rewrite(DOCUMENT, {name: known[name]()})


if __name__ == "__main__":
    main(sys.argv[1:])
