"""What a decision costs: the exact engine within the loop, and two solvers on a sample of its states."""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator, Sequence

import numpy as np
from numba import types

from benchmarks.actors import Replay
from benchmarks.measure import Bar, Row
from controllers import create
from controllers.minlp.controller import Minlp, solver_engine
from controllers.minlp.settings import MinlpSettings
from controllers.minlp.solvers import SolverEngine
from station import Observation, Record, Scenario, load_scenario, simulate
from station.compiled import entry, numba_type
from station.controller import OBSERVATION, CompiledController
from station.geometry import BUFFERS, VALVES
from station.kernels import CLOSED_CONTROLLER

MINLPS = ("minlp1", "minlp2", "minlp3")
DECISION_BAR = Bar("at most", 3.0)  # microseconds
AGREEMENT_BAR = Bar("at most", 1e-9)  # relative; the gap at which SCIP stops
SOLVERS = {"pyomo": ("SCIP (Pyomo)", AGREEMENT_BAR), "casadi": ("Bonmin (CasADi)", None)}
"""Titles and bars of the solvers. Bonmin has none: its search is not exact where a problem is not convex."""

SAMPLE_SEED = 7
LONG_ENOUGH = 0.002
"""A timing shorter than this is repeated in a longer loop [s]: the call from Python costs a hundredth of it."""

_CONTROLLER = numba_type(CLOSED_CONTROLLER)


def observation_at(record: Record, row: int) -> Observation:
    """What the controller saw in a row of a record with a vehicle connected and communicating."""
    vehicle = int(record["vehicle"][row])
    pressure = tuple(float(record[f"pressure_{tank}"][row]) for tank in (*BUFFERS, "vehicle"))
    temperature = tuple(float(record[f"temperature_{tank}"][row]) for tank in (*BUFFERS, "vehicle"))
    previous = sum(int(record[valve][row - 1]) << bit for bit, valve in enumerate(VALVES)) if row else 0
    return Observation(
        time=float(record["time"][row]),
        period=1.0,
        pressure=(pressure[0], pressure[1], pressure[2]),
        temperature=(temperature[0], temperature[1], temperature[2]),
        vehicle=vehicle,
        vehicle_pressure=pressure[3],
        vehicle_temperature=temperature[3],
        vehicle_volume=float(record.vehicles["volume"][vehicle]),
        communication=True,
        queue_length=int(record["queue_length"][row]),
        previous=previous,
        finish_pressure=float(record.vehicles["finish_pressure"][vehicle]),
    )


def sample(record: Record, count: int, seed: int = SAMPLE_SEED) -> list[Observation]:
    """`count` observations of a run with a vehicle connected, drawn without repetition, in order of time."""
    busy = np.flatnonzero(record["vehicle"][:-1] >= 0)
    chosen = np.random.default_rng(seed).choice(busy, size=min(count, len(busy)), replace=False)
    return [observation_at(record, int(row)) for row in sorted(chosen)]


def settings_of(controller: Minlp, scenario: Scenario) -> MinlpSettings:
    """The controller's settings at the scenario's station."""
    settings: MinlpSettings = controller.settings_for(scenario.station)
    return settings


def in_the_loop(scenario: Scenario, controller: str, repeats: int) -> tuple[float, ...]:
    """Seconds a decision takes within the compiled loop, each from one pair of runs.

    The second run of a pair repeats the commands of the first from a list, so the difference of their times is what
    deciding cost, in the same loop, on the same states, with the same record written.
    """
    record = simulate(scenario, create(controller))
    replay = Replay(record, obeys_hold=True)
    if not np.array_equal(simulate(scenario, replay)["time"], record["time"]):
        raise AssertionError("the replay takes another way than the run it repeats")
    found = []
    for _ in range(repeats):
        deciding = simulate(scenario, create(controller)).timing.total
        repeating = simulate(scenario, replay).timing.total
        found.append((deciding - repeating) / (len(record) - 1))
    return tuple(found)


def solver(engine: str, controller: Minlp, scenario: Scenario) -> SolverEngine:
    """The solver's engine with the controller's objective at the scenario's station."""
    settings = settings_of(controller, scenario)
    return solver_engine(engine)(scenario.station.control_constants(), controller.objective(settings), settings)


def rows(repeats: int, states: int) -> Iterator[Row]:
    """The exact engine in the loop, then both solvers against it on `states` states of each MINLP."""
    scenario = load_scenario("S3")
    exact: dict[str, float] = {}
    for name in MINLPS:
        seconds = in_the_loop(scenario, name, repeats)
        exact[name] = statistics.median(seconds)
        yield Row(f"exact engine, {name}, t = 1: a decision of S3 in the loop",
                  tuple(1e6 * value for value in seconds), "us", DECISION_BAR)  # fmt: skip
    chosen = {name: sample(simulate(scenario, create(name)), states) for name in MINLPS}
    for engine, (title, bar) in SOLVERS.items():
        differences, durations, ratios = [], [], []
        for name in MINLPS:
            for difference, duration in _against_exact(engine, name, scenario, chosen[name]):
                differences.append(difference)
                durations.append(duration)
                ratios.append(duration / exact[name])
        yield Row(f"{title} against exact: relative difference of the optimum, worst of {len(differences)} states",
                  (max(differences),), "1", bar)  # fmt: skip
        yield Row(f"{title}: solve alone, model built once", tuple(1e3 * value for value in durations), "ms")
        yield Row(f"{title} / exact: time of a decision", tuple(ratios), "times")


def _against_exact(
    engine: str, name: str, scenario: Scenario, chosen: Sequence[Observation]
) -> Iterator[tuple[float, float]]:
    """Relative difference of the optima, and the solver's seconds, for each observation."""
    controller = create(name)
    controller.start(scenario.station)
    solving = solver(engine, controller, scenario)
    for observation in chosen:
        best = controller.decide(observation).cost
        solution = solving.solve(observation)
        yield abs(solution.cost - best) / max(1.0, abs(best)), solution.solve_seconds


@entry(types.float64(_CONTROLLER, OBSERVATION, types.int64))
def _again(controller: CompiledController, observation: Observation, times: int) -> float:
    """Decide so many times over; the sum of the costs, so that nothing can be left out."""
    total = 0.0
    for _ in range(times):
        total += controller.decide(observation, controller.model, controller.settings, controller.memory).cost
    return total


def each_decision(controller: Minlp, scenario: Scenario, chosen: Sequence[Observation]) -> list[float]:
    """Seconds a decision of the exact engine takes, for each observation.

    A quick decision is repeated within compiled code until `LONG_ENOUGH` have passed, so that neither the call from
    Python nor the clock counts.
    """
    controller.start(scenario.station)
    compiled = controller.compiled()
    if compiled is None:
        raise ValueError(f"{controller.name} has no compiled form with this engine")
    found = []
    for observation in chosen:
        times, seconds = 1, 0.0
        while True:
            before = time.perf_counter()
            _again(compiled, observation, times)
            seconds = time.perf_counter() - before
            if seconds >= LONG_ENOUGH:
                break
            times *= 8
        found.append(seconds / times)
    return found
