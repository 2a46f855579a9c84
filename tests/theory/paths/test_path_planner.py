"""Algorithm 2 on Sec. 6.4: it arrives, keeps its distance as often as stated, and says when it could not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from theory.errors import IllPosedError
from theory.paths.boxes import Boxes
from theory.paths.closed_loop import simulate_mission
from theory.paths.examples import mission
from theory.paths.experiments import at_the_limit, one_step
from theory.paths.mission import Mission
from theory.paths.planner import PathPlanner
from theory.paths.stochastic import RandomSystem, ScenarioSamples


def test_section_6_4_in_the_reading_that_works():
    """Fig. 6.2: beside obstacle 1 around samples 7 to 9, beside obstacle 2 around 14 to 17."""
    task, start = mission()
    for seed in range(4):
        found = simulate_mission(task, start, seed)
        assert found.arrived
        assert 20 <= len(found.steps) <= 30
        assert np.abs(found.positions[7:10, 0] - 95).max() < 6
        assert np.abs(found.positions[14:18, 1] - 245).max() < 6
        inputs = np.array([step.input for step in found.steps])
        assert np.abs(inputs).max() <= 10 + 1e-6
        assert np.abs(inputs[14:18, 0]).max() < 0.1  # u1 tends to 0 beside obstacle 2
        assert np.abs(inputs[4:9, 1]).max() < 0.1  # u2 beside obstacle 1


@pytest.mark.full
@pytest.mark.parametrize("between", [False, True])
def test_40_runs(between: bool):
    task, start = mission(between_samples=between)
    runs = [simulate_mission(task, start, seed) for seed in range(40)]
    assert all(run.arrived for run in runs)
    near = [kept for run in runs for kept, close in zip(run.kept, run.near, strict=True) if close]
    assert np.mean(near) >= 0.95
    steps = [step for run in runs for step in run.steps]
    assert 0 < sum(step.softened for step in steps) < 0.1 * len(steps)
    assert (sum(len(run.cuts()) for run in runs) == 0) == between


def test_with_the_line_between_samples_nothing_is_cut():
    task, start = mission(between_samples=True)
    for seed in range(4):
        found = simulate_mission(task, start, seed)
        assert found.arrived
        assert found.cuts() == []


def test_the_printed_reading_leaves_the_map():
    """theta in [0, 1]: from x_1 = 50 on the mean growth is more than speed and input can undo."""
    task, start = mission("paths_printed")
    for seed in range(3):
        found = simulate_mission(task, start, seed)
        assert not found.arrived
        assert found.lost
        assert len(found.steps) < 20


@pytest.mark.parametrize("scenarios", [39, 19, 9])
def test_one_step_at_an_active_limit(scenarios: int):
    """97.5, 95 and 90 % within sampling error, not the 95, 90 and 80 % that (6.6) asks for."""
    found = at_the_limit(scenarios, draws=150)
    assert abs(found.mean - found.expected) < 4 * found.error
    assert found.softened == 0


@pytest.mark.full
@pytest.mark.parametrize("scenarios", [39, 19, 9])
def test_one_step_at_an_active_limit_400_draws(scenarios: int):
    found = at_the_limit(scenarios, draws=400)
    assert abs(found.mean - found.expected) < 3 * found.error
    binomial = np.sqrt(found.expected * (1 - found.expected) / 400)
    assert abs(found.kept.mean() - found.expected) < 4 * binomial


def test_a_decision_says_what_it_is():
    task, _ = mission()
    planner = PathPlanner(task, 0)
    step = planner.decide(np.array([93.57, 138.23, 1.29, 20.0]))
    assert not step.softened
    assert 2 * step.paths / 20 >= 1
    assert [bound.kind for bound in step.bounds] == ["range", "tail"]  # the bound by count would be 1
    assert all(bound.value < 1 for bound in step.bounds)
    assert step.bounds[0].value == pytest.approx(4 / 20)  # two random coordinates, two sides
    assert step.paths == 27
    assert len(step.path) == 3
    judged = planner.a_posteriori_bound(step)
    assert judged is not None
    assert judged.kind == "judged"
    assert 0 < judged.value < 1
    open_field = planner.decide(np.zeros(4))
    assert open_field.paths == 1
    assert open_field.bounds[1].value == pytest.approx(0.1)
    assert open_field.sensed == ()


def test_without_a_path_limits_give_way_and_it_is_said():
    task, _ = mission()
    step = PathPlanner(task, 0).decide(np.array([85.0, 80.0, 20.0, 20.0]))
    assert step.softened
    assert step.slack > 1
    assert step.bounds == ()
    assert PathPlanner(task, 0).a_posteriori_bound(step) is None


def test_giving_up_scenarios_lowers_the_cost_and_weakens_the_bound():
    state = np.array([93.57, 138.23, 1.29, 20.0])
    kept = mission(scenarios=40)[0]
    fewer = mission(scenarios=40, removed=2)[0]
    samples = kept.system.draw(np.random.default_rng(0), 40, 3)
    all_kept, some = PathPlanner(kept, 1).decide(state, samples), PathPlanner(fewer, 1).decide(state, samples)
    assert len(some.given_up) == 2
    assert some.cost < all_kept.cost
    assert [bound.kind for bound in some.bounds] == ["tail"]
    assert some.bounds[0].value > all_kept.bounds[-1].value
    assert PathPlanner(fewer).a_posteriori_bound(some) is None


def test_the_support_of_a_decision_is_what_the_judge_counts():
    """Leaving out a scenario that is not counted changes nothing; the counted ones alone give the same decision."""
    task, _ = mission()
    planner = PathPlanner(task, 3)
    step = planner.decide(np.array([93.57, 138.23, 1.29, 20.0]))
    bound = planner.a_posteriori_bound(step)
    assert bound is not None
    count = int(bound.statement.split(": ")[1].split()[0])
    assert 1 <= count <= 6  # no more than the six inputs


def test_the_same_seed_gives_the_same_drive():
    task, start = mission()
    assert np.array_equal(simulate_mission(task, start, 5, 8).states, simulate_mission(task, start, 5, 8).states)
    assert not np.array_equal(simulate_mission(task, start, 5, 8).states, simulate_mission(task, start, 6, 8).states)


def test_a_vehicle_in_space():
    """Three coordinates, one obstacle between start and goal."""
    eye, none = np.eye(3), np.zeros((3, 3))
    system = RandomSystem(
        np.block([[eye, eye], [none, eye]]), np.vstack([0.5 * eye, eye]), np.array([0.1] * 3 + [0.0] * 3),
        np.zeros((0, 6, 6)), np.zeros(0), np.zeros(0),
    )  # fmt: skip
    task, _ = mission(
        system=system, goal=np.array([40.0, 20, 20, 0, 0, 0]), Q=0.5 * np.eye(6), R=3 * eye,
        state_limits=Boxes.of(((0, 0, 0, -8, -8, -8), (50, 40, 40, 8, 8, 8))),
        input_limits=Boxes.of(([-4] * 3, [4] * 3)),
        obstacles=Boxes.of(((18, 12, 12), (24, 28, 28))), safe_distance=1.0, perception=20.0, reached=2.0,
    )  # fmt: skip
    found = simulate_mission(task, np.array([2.0, 19, 19, 0, 0, 0]), 0, 60)
    assert found.arrived
    assert not any(task.obstacles.inside(place).any() for place in found.positions)
    assert max(step.paths for step in found.steps) == 6**3


def test_bad_missions_are_named():
    task, start = mission()
    with pytest.raises(IllPosedError, match=r"goal: .* outside the map"):
        mission(goal=np.array([400.0, 300, 0, 0]))
    with pytest.raises(IllPosedError, match=r"goal: .* safe distance of obstacle 1"):
        mission(goal=np.array([150.0, 100, 0, 0]))
    for field, value in (("goal", np.full(4, np.nan)), ("R", np.full((2, 2), np.nan)), ("Q", np.full((4, 4), np.inf))):
        with pytest.raises(IllPosedError, match=f"{field}: an entry is not finite"):
            mission(**{field: value})
    with pytest.raises(IllPosedError, match="Q: must be symmetric"):
        mission(Q=np.eye(4) + np.eye(4, k=1))
    with pytest.raises(IllPosedError, match="horizon: must be a whole number"):
        mission(horizon=2.5)
    with pytest.raises(IllPosedError, match="state: an entry is not finite"):
        PathPlanner(task).decide(np.full(4, np.nan))
    with pytest.raises(IllPosedError, match="state: must have the shape"):
        PathPlanner(task).decide(np.zeros(3))
    with pytest.raises(IllPosedError, match="samples: must be more than 0 futures"):
        PathPlanner(task).decide(start, task.system.draw(np.random.default_rng(0), 5, 2))
    with pytest.raises(IllPosedError, match="start: must be an array of numbers"):
        simulate_mission(task, "here", 0)
    with pytest.raises(IllPosedError, match="steps, seed"):
        simulate_mission(task, start, 0, 0)
    with pytest.raises(IllPosedError, match="B: an entry is not finite"):
        RandomSystem(np.eye(1), np.full((1, 1), np.nan), np.zeros(1), np.zeros((0, 1, 1)), np.zeros(0), np.zeros(0))
    with pytest.raises(IllPosedError, match="goal: must have the shape"):
        mission(goal=np.array([1.0, 2.0]))
    with pytest.raises(IllPosedError, match="removed: must be a whole number between 0 and 18"):
        mission(removed=19)
    with pytest.raises(IllPosedError, match="R only positive"):
        mission(R=np.zeros((2, 2)))
    with pytest.raises(IllPosedError, match=r"start: .* inside obstacle 1: move it out"):
        simulate_mission(task, np.array([150.0, 100, 0, 0]), 0)
    with pytest.raises(IllPosedError, match=r"start: .* breaks the state limits"):
        simulate_mission(task, np.array([-50.0, 100, 0, 0]), 0)
    with pytest.raises(IllPosedError, match="start: must have the shape"):
        simulate_mission(task, np.zeros(2), 0)
    with pytest.raises(IllPosedError, match="draws, fresh"):
        one_step(task, start, draws=1)


class Uniform:
    """z+ = z + u + w, w uniform in [-1, 1]; nothing more is known of it."""

    states, inputs = 1, 1

    def draw(self, rng: np.random.Generator, scenarios: int, steps: int) -> ScenarioSamples:
        one = np.ones((scenarios, steps, 1, 1))
        return ScenarioSamples(one, one, rng.uniform(-1, 1, (scenarios, steps, 1)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("limit", "apart"),
    [
        (0.9, True),
        *(pytest.param(*each, marks=pytest.mark.slow) for each in ((0.9, False), (1.0, True), (1.0, False))),
    ],
)
def test_bounds_hold_where_the_cost_matters_and_samples_may_leave_no_way(apart: bool, limit: float):
    """One unknown and one limit each side; the cost pulls to the middle, and with 0.9 many draws leave no input."""
    known = RandomSystem(np.eye(1), np.eye(1), np.full(1, 0.4), np.zeros((0, 1, 1)), np.zeros(0), np.zeros(0))
    task = Mission(
        known, np.zeros(1), np.eye(1), 1e-6 * np.eye(1), Boxes.of(([-limit], [limit])), Boxes.of(([-9], [9])),
        Boxes.none(1), 0.0, 1.0, horizon=1, scenarios=19, apart=apart,
    )  # fmt: skip
    planner, broken, carried, draws = PathPlanner(task, 0), [], 0, 600
    for _ in range(draws):
        step = planner.decide(np.zeros(1))
        chance = norm.sf(limit - step.input[0], scale=0.4) + norm.cdf(-limit - step.input[0], scale=0.4)
        broken.append(float(chance) if step.bounds else 0.0)
        carried += bool(step.bounds)
        if step.bounds:
            assert step.bounds[0].kind == "range"
            assert step.bounds[0].value == pytest.approx(2 / 20)
            assert len(step.bounds) == (3 if apart else 1)
    assert carried > draws / 3
    assert np.mean(broken) < 2 / 20


def test_a_system_of_unknown_making_carries_no_bound_by_its_range():
    task = Mission(
        Uniform(), np.zeros(1), np.eye(1), np.eye(1), Boxes.of(([-3], [3])), Boxes.of(([-9], [9])), Boxes.none(1), 0.0,
        1.0, horizon=1,
    )  # fmt: skip
    assert [bound.kind for bound in PathPlanner(task).decide(np.zeros(1)).bounds] == ["count", "tail"]
    alone = PathPlanner(replace(task, apart=False)).decide(np.zeros(1))
    assert alone.bounds == ()


@pytest.mark.slow
def test_noise_that_carries_into_a_safe_distance_opens_no_way_through():
    """From inside the margin the first line goes to the nearest free box; later ones keep sharing boxes."""
    eye = np.eye(2)
    system = RandomSystem(eye, eye, np.full(2, 0.3), np.zeros((0, 2, 2)), np.zeros(0), np.zeros(0))
    task = Mission(
        system, np.array([25.0, 15.0]), eye, 5 * eye, Boxes.of(((0, 0), (40, 30))), Boxes.of(((-20, -20), (20, 20))),
        Boxes.of(((10, 10), (20, 20))), 1.0, 50.0, between_samples=True, reached=2.0,
    )  # fmt: skip
    for start in ([9.3, 15.0], [9.0001, 15.0]):
        step = PathPlanner(task, 0).decide(np.array(start))
        assert not task.obstacles.cut_by(np.array(start), np.array(start) + step.input).any()
    inside = 0
    for seed in range(12):
        found = simulate_mission(task, np.array([3.0, 15.0]), seed, 25)
        assert found.cuts() == []
        inside += sum(task.grown.inside(place).any() for place in found.positions)
    assert inside > 0


@pytest.mark.slow
@pytest.mark.parametrize("apart", [True, False])
def test_stages_that_share_scenarios_break_the_count_and_futures_apart_restore_it(apart: bool):
    """One path, one input, always a way: the second step's rows swing the first input with either extreme scenario."""
    low, high = np.full(8, -np.inf), np.full(8, np.inf)
    p, h, hh, r, rr, c, g, y = range(8)
    a, b, term = np.zeros((8, 8)), np.zeros((8, 1)), np.zeros((1, 8, 8))
    term[0, [p, h, hh], c] = 1.0
    a[c, c], b[p], a[r, p], a[r, h], b[r], a[rr, p], a[rr, hh], b[rr] = 1, 1, -1, -9, -1e4, 1, 9, -1e4
    a[g, c], a[y, g], b[y] = 1e5, 1, 0.1
    low[p], high[p], high[r], high[rr] = -1.002, 1.002, 0.0, 0.0
    weight = np.zeros((8, 8))
    weight[y, y] = 1.0
    task = Mission(
        RandomSystem(a, b, np.zeros(8), term, np.array([-1.0]), np.array([1.0])), np.zeros(8), weight,
        np.array([[0.01]]), Boxes(low[None], high[None]), Boxes.of(((-10,), (10,))), Boxes.none(1), 0.0, 1.0,
        horizon=2, scenarios=3, apart=apart,
    )  # fmt: skip
    state = np.zeros(8)
    state[h], state[hh], state[c] = 1e4, -1e4, 1.0
    planner, rates = PathPlanner(task, 1), []
    for _ in range(500):
        step = planner.decide(state)
        assert not step.softened
        kept = min(1.0, 1.002 - step.input[0]) - max(-1.0, -1.002 - step.input[0])
        rates.append(1 - kept / 2)
    error = np.std(rates) / np.sqrt(len(rates))
    if apart:
        assert np.mean(rates) < step.bounds[1].value + 3 * error  # 1/(1+S)
        assert step.bounds[1].value == pytest.approx(0.25)
    else:
        assert np.mean(rates) > 0.25 + 3 * error
        assert [bound.kind for bound in step.bounds] == ["range"]
    assert np.mean(rates) < step.bounds[0].value


def test_no_path_is_told_where_a_wall_leaves_none(capsys):
    task, start = mission("paths")
    assert task.path_exists(start)
    wall = Boxes.of(((-10.0, 150.0), (330.0, 160.0)))
    walled = replace(task, obstacles=wall, between_samples=True)
    assert not walled.path_exists(start)
    with_gap = replace(task, obstacles=Boxes.of(((-10.0, 150.0), (300.0, 160.0))))
    assert with_gap.path_exists(start)
    assert not replace(with_gap, safe_distance=25.0).path_exists(start)
    assert not simulate_mission(walled, start, 0, 2).path_exists
