"""The path search against SCIP, against all candidate paths, and the programs it solves."""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np
import pytest

from benchmarks.big_m import Case, cases, optimum
from theory.errors import IllPosedError, InfeasibleError, TooLargeError
from theory.paths.boxes import Boxes, free_boxes
from theory.paths.enumeration import best_of_paths, candidate_paths, solve_path, visible_faces
from theory.paths.examples import mission
from theory.paths.scenario_program import ScenarioProgram, confined_steps, search_paths, search_softened


def found_by(case: Case) -> float | None:
    """Our optimum."""
    try:
        return search_paths(case.program, case.free).solved.cost
    except InfeasibleError:
        return None


def agree(case: Case) -> bool:
    """SCIP and the search give the same optimum; whether obstacles mattered."""
    ours, theirs = found_by(case), optimum(case)
    assert (ours is None) == (theirs is None)
    if ours is None or theirs is None:
        return True
    assert ours == pytest.approx(theirs, rel=1e-7)
    steps = case.program.steps
    alone = case.program.solve(*case.program.limits(case.free, (None,) * steps, confined_steps(steps, between=False)))
    return ours > alone.cost * (1 + 1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(("horizon", "obstacles"), [(3, 6), pytest.param(5, 4, marks=pytest.mark.slow)])
def test_the_search_finds_scips_optimum(horizon: int, obstacles: int):
    assert sum(agree(case) for case in cases(6, horizon, obstacles, seed=1)) >= 2


@pytest.mark.full
@pytest.mark.parametrize(("horizon", "obstacles"), [(3, 6), (5, 4)])
def test_the_search_finds_scips_optimum_in_50_states(horizon: int, obstacles: int):
    assert sum(agree(case) for case in cases(50, horizon, obstacles, seed=2)) >= 20


@pytest.mark.parametrize("seed", range(3))
def test_the_search_finds_the_best_of_all_candidate_paths(seed: int):
    for case in cases(3, 2, 2, seed):
        try:
            _, solved = best_of_paths(case.program, case.obstacles, [[1, 2, 3, 4]] * 2)
        except InfeasibleError:
            assert found_by(case) is None
            continue
        assert found_by(case) == pytest.approx(solved.cost, rel=1e-9)


def test_with_the_line_between_samples_it_finds_the_best_of_all_sequences():
    tried = 0
    for case in cases(12, 2, 3, seed=5):
        start = case.state[:2]
        spans, best = confined_steps(2, between=True), np.inf
        for path in product(range(len(case.free)), repeat=2):
            if not case.free.containing(start[None])[path[0]]:
                continue
            try:
                best = min(best, case.program.solve(*case.program.limits(case.free, path, spans)).cost)
            except InfeasibleError:
                continue
        try:
            found = search_paths(case.program, case.free, start)
        except InfeasibleError:
            assert best == np.inf
            continue
        assert found.solved.cost == pytest.approx(best, rel=1e-9)
        places = np.vstack([start[None], case.program.states(found.solved.inputs)[:, 0, :2]])
        for before, after in pairwise(places):
            assert not case.obstacles.cut_by(before, after, 1e-6).any()
        tried += 1
    assert tried > 3


@pytest.mark.slow
def test_softening_finds_the_least_slack_of_all_sequences():
    task, _ = mission("paths", horizon=2)
    rng = np.random.default_rng(0)
    tried = 0
    for _ in range(12):
        state = np.array([rng.uniform(75, 90), rng.uniform(20, 150), 20.0, rng.uniform(-5, 5)])
        program = ScenarioProgram(
            task.system.draw(rng, 5, 2), state, task.goal, task.Q, task.R, task.state_limits, task.input_limits
        )
        free = free_boxes(task.room, task.grown)
        try:
            search_paths(program, free)
            continue
        except InfeasibleError:
            pass
        found, slack = search_softened(program, free)
        spans = confined_steps(2, between=False)
        paths = product(range(len(free)), repeat=2)
        best = min(program.least_slack(*program.limits(free, path, spans))[0] for path in paths)
        assert slack == pytest.approx(best, abs=1e-6)
        assert slack > 0
        assert np.abs(found.solved.inputs).max() <= 10 + 1e-6
        tried += 1
    assert tried >= 3


def test_states_are_the_system_s_own():
    task, _ = mission("paths", horizon=4)
    samples = task.system.draw(np.random.default_rng(0), 3, 4)
    state = np.array([10.0, 20.0, 3.0, -2.0])
    program = ScenarioProgram(samples, state, task.goal, task.Q, task.R, task.state_limits, task.input_limits)
    inputs = np.random.default_rng(1).normal(size=(4, 2))
    total = 0.0
    for s in range(3):
        at = state
        for i in range(4):
            at = samples.A[s, i] @ at + samples.B[s, i] @ inputs[i] + samples.w[s, i]
            assert np.allclose(program.states(inputs)[i, s], at)
            total += (at - task.goal) @ task.Q @ (at - task.goal) / 3
    total += np.einsum("iu,uv,iv->", inputs, task.R, inputs)
    flat = inputs.ravel()
    assert flat @ program.hessian @ flat / 2 + program.linear @ flat + program.constant == pytest.approx(total)


def test_example_6_1():
    """From the top left of obstacle 1, with obstacle 2 out of sight: four paths over two steps."""
    obstacles = Boxes.of(((100, 0), (200, 200)))
    faces = visible_faces(np.array([50.0, 250.0]), obstacles)
    assert faces == [[1, 4]]
    found = list(candidate_paths([*faces, []], 2))
    assert found == [((1, 0), (1, 0)), ((1, 0), (4, 0)), ((4, 0), (1, 0)), ((4, 0), (4, 0))]
    for counts, steps in (((2, 3), 3), ((1, 4, 2), 2)):
        paths = candidate_paths([list(range(1, n + 1)) for n in counts], steps)
        assert sum(1 for _ in paths) == np.prod(counts) ** steps
    with pytest.raises(TooLargeError, match="candidate paths"):
        candidate_paths([[1, 2, 3, 4]] * 6, 5)
    with pytest.raises(IllPosedError, match="path: must name faces"):
        solve_path(cases(1, 2, 1, 0)[0].program, obstacles, [(1,)])
