"""What predictive controllers cost: a step of Algorithm 1 and its programs, a search over paths against SCIP."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import suppress

import clarabel
import numpy as np
from scipy import sparse

from benchmarks.big_m import Case, cases, optimum
from benchmarks.measure import Bar, Row
from theory.arrays import Array
from theory.errors import InfeasibleError
from theory.paths.closed_loop import simulate_mission
from theory.paths.examples import mission
from theory.paths.scenario_program import search_paths
from theory.solvers import qp
from theory.tubes.examples import unknown
from theory.tubes.trimodal import Trimodal, prepare


def rows(repeats: int) -> Iterator[Row]:
    """Every row, measured when asked for."""
    yield from _trimodal(repeats)
    yield from _programs(repeats)
    yield from _paths(repeats)


def _trimodal(repeats: int) -> Iterator[Row]:
    """Steps before mode 3, each with a new regression, its gain, its tube over all models, and two or three plans."""
    example = unknown()
    steps: list[float] = []
    plans: list[float] = []
    for seed in range(3 * repeats):
        plant = example.plant(seed)
        prepared = prepare(plant, example.start, example.settings)
        controller = Trimodal(example.settings, prepared.models, prepared.window)
        state = prepared.states[-1]
        while not controller.inside(state):
            before = time.process_time()
            action = controller.decide(state)
            steps.append(1000 * (time.process_time() - before))
            before = time.process_time()
            controller.central.plan(state)
            plans.append(1000 * (time.process_time() - before))
            after = plant(state, action.input)
            controller.observe(state, action.input, after)
            state = after
    yield Row("a step of Algorithm 1, 2 states, all vertex models (CPU)", tuple(steps), "ms", Bar("at most", 60))
    yield Row("program (5.24), N = 15, its tube and cuts (CPU)", tuple(plans), "ms", Bar("at most", 15))


def _programs(repeats: int) -> Iterator[Row]:
    """The solver alone, on programs of the path search, beside an interior-point method."""
    found = cases(10, 3, 6, seed=0)
    ours, theirs = [], []
    for case in found * max(1, repeats // 3):
        program = case.program
        upper = program.upper(*program.limits(case.free, (None,) * 3, [(0,), (1,), (2,)]))
        rows_of = np.vstack([np.eye(6), -np.eye(6), program.state_rows, -program.state_rows])
        before = time.process_time()
        exact = qp.minimize(program.hessian, program.linear, rows_of, upper, "benchmark")
        ours.append(1e6 * (time.process_time() - before))
        before = time.process_time()
        value = _interior(program.hessian, program.linear, rows_of, upper)
        theirs.append(1e6 * (time.process_time() - before))
        if abs(value - exact.value) > 1e-6 * (1 + abs(value)):
            raise RuntimeError(f"the solvers disagree: {exact.value} and {value}")
    rows_count = len(rows_of)
    yield Row(f"DAQP, 6 inputs, {rows_count} rows, from nothing, checked (CPU)", tuple(ours), "us")
    yield Row("the same with Clarabel (CPU)", tuple(theirs), "us")


def _interior(hessian: Array, linear: Array, rows_of: Array, upper: Array) -> float:
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    matrix, triangle = sparse.csc_matrix(rows_of), sparse.csc_matrix(np.triu(hessian))
    solver = clarabel.DefaultSolver(triangle, linear, matrix, upper, [clarabel.NonnegativeConeT(len(upper))], settings)
    return float(solver.solve().obj_val)


def _paths(repeats: int) -> Iterator[Row]:
    for horizon, obstacles in ((3, 6), (5, 4)):
        found = cases(5 * max(1, repeats // 3), horizon, obstacles, seed=4)
        ours, theirs = [], []
        for case in found:
            before = time.process_time()
            value = _searched(case)
            ours.append(1000 * (time.process_time() - before))
            before = time.process_time()
            referee = optimum(case)
            theirs.append(1000 * (time.process_time() - before))
            if (value is None) != (referee is None) or (value and referee and abs(value / referee - 1) > 1e-7):
                raise RuntimeError(f"the search and SCIP disagree: {value} and {referee}")
        what = f"N = {horizon}, {obstacles} obstacles, S = 19"
        yield Row(f"path search, {what} (CPU)", tuple(ours), "ms")
        yield Row("SCIP on the same, same optimum to 1e-7 (CPU)", tuple(theirs), "ms")
        ratios = tuple(b / a for a, b in zip(ours, theirs, strict=True))
        yield Row("SCIP / path search (CPU)", ratios, "times", Bar("at least", 5))
    task, start = mission()
    spent = []
    for seed in range(max(1, repeats // 3)):
        before = time.process_time()
        decisions = len(simulate_mission(task, start, seed).steps)
        spent.append(1000 * (time.process_time() - before) / decisions)
    yield Row("Sec. 6.4: a decision in the loop, bounds included (CPU)", tuple(spent), "ms")


def _searched(case: Case) -> float | None:
    with suppress(InfeasibleError):
        return search_paths(*case.built()).solved.cost
    return None
