"""Invariant sets and tubes: Propositions 5.1 to 5.3 and Lemma 5.2, checked by trying models, states and noise."""

from __future__ import annotations

import cvxpy as cp
import numpy as np
import pytest
from scipy.linalg import solve_discrete_lyapunov

from theory.errors import EmptySetError, IllPosedError, InfeasibleError, UnboundedError
from theory.tubes.examples import unknown
from theory.tubes.models import LinearModel, ModelSet, Regulator
from theory.tubes.mpc import DualMode, RigidTube
from theory.tubes.polytope import NormalizedPolytope
from theory.tubes.trimodal import Trimodal, prepare
from theory.tubes.tube import Limits, Tube, contractive_set
from theory.tubes.tube_program import TubeProgram


def controller(name: str = "dmd", seed: int = 0) -> Trimodal:
    """A prepared controller."""
    example = unknown(name)
    prepared = prepare(example.plant(seed), example.start, example.settings)
    return Trimodal(example.settings, prepared.models, prepared.window)


def models_of(found: ModelSet, rng: np.random.Generator) -> LinearModel:
    """A corner of the set, or a mixture of corners of every row."""
    weights = [rng.dirichlet(np.full(len(row), 0.2)) for row in found.corners]
    joined = np.array([weight @ row for weight, row in zip(weights, found.corners, strict=True)])
    if rng.random() < 0.7:
        joined = np.array([row[rng.integers(len(row))] for row in found.corners])
    return LinearModel(joined[:, : found.states], joined[:, found.states :])


def states_in(rows: np.ndarray, level: np.ndarray, rng: np.random.Generator) -> np.ndarray | None:
    """A state at the edge of {x : rows x <= level}, from a random ray out of its middle."""
    from theory.tubes.polytope import Polytope

    middle, radius = Polytope(rows, level).chebyshev()
    if radius < 0:
        return None
    ray = rng.normal(size=rows.shape[1])
    along = rows @ ray
    lengths = (level - rows @ middle)[along > 0] / along[along > 0]
    return middle + max(lengths.min(), 0.0) * ray


@pytest.mark.parametrize("name", ["dmd", "dmd_three_states"])
def test_the_invariant_set_shrinks_under_every_model_and_noise(name: str):
    found = controller(name)
    tube, noise, rng = found.tube, found.settings.noise, np.random.default_rng(1)
    assert tube.contraction <= found.settings.contraction + 1e-9
    for corner in tube.shape.corners:
        assert found.settings.limits.kept(corner, tube.gain @ corner)
        for _ in range(10):
            model = models_of(tube.models, rng)
            after = model.after(corner, tube.gain @ corner) + rng.choice([-noise, noise], model.states)
            assert (tube.shape.rows @ after).max() <= found.settings.contraction + 1e-9


def test_a_set_found_without_the_noise_is_left():
    """What the thesis prints: the set of models alone does not contain the noise."""
    found = controller()
    noise, rng, escapes = 0.1, np.random.default_rng(0), 0
    shape = contractive_set(found.models, found.regulator.gain, found.settings.limits, 0.0, 0.99)
    for corner in shape.corners:
        for _ in range(20):
            model = models_of(found.models, rng)
            after = model.after(corner, found.regulator.gain @ corner) + rng.choice([-noise, noise], 2)
            escapes += (shape.rows @ after).max() > 1
    assert escapes > 0
    with_noise = contractive_set(found.models, found.regulator.gain, found.settings.limits, noise, 0.99)
    assert (with_noise.support(shape.rows) <= 1 + 1e-9).all()


@pytest.mark.parametrize("name", ["dmd", "dmd_three_states"])
def test_proposition_5_1_next_states_lie_in_the_next_section(name: str):
    found = controller(name)
    tube, rng = found.tube, np.random.default_rng(2)
    rows = tube.shape.rows
    for _ in range(15):
        level = rows @ rng.normal(size=tube.models.states) + rng.uniform(0.1, 1.5, len(rows))
        perturbation = rng.normal(size=tube.models.inputs)
        following, _ = tube.next_level(level, perturbation)
        for _ in range(10):
            state = states_in(rows, level, rng)
            model = models_of(tube.models, rng)
            drawn = rng.choice([-tube.noise, tube.noise], model.states)
            after = model.after(state, tube.gain @ state + perturbation) + drawn
            assert (rows @ after <= following + 1e-9).all()


def test_proposition_5_1_equation_5_13a():
    tube = controller().tube
    targets = tube.images[..., :2] + tube.images[..., 2:] @ tube.gain
    assert (tube.steps >= 0).all()
    assert np.allclose(tube.steps @ tube.shape.rows, targets, atol=1e-9)
    assert np.allclose(tube.limiting @ tube.shape.rows, tube.limits.under(tube.gain), atol=1e-9)


def test_proposition_5_2_limits_hold_in_a_section():
    tube, rng = controller().tube, np.random.default_rng(3)
    tried = 0
    for _ in range(200):
        level = tube.shape.rows @ rng.normal(size=2) + rng.uniform(0.05, 0.5, len(tube.shape.rows))
        perturbation = rng.normal(size=1) * 0.3
        if (tube.limiting @ level + tube.limits.G @ perturbation <= 1).all():
            state = states_in(tube.shape.rows, level, rng)
            assert tube.limits.kept(state, tube.gain @ state + perturbation, 1e-9)
            tried += 1
    assert tried > 20


def test_proposition_5_3_the_inputs_bound_where_the_state_ends():
    """With the noise: limsup |V x| <= (sup |V B c| + w) / (1 - lambda), lambda of the models alone."""
    found = controller()
    tube, rng = found.tube, np.random.default_rng(4)
    lam = float(tube.shape.support(tube.images[..., :2] + tube.images[..., 2:] @ tube.gain).max())
    assert lam < 1
    for _ in range(5):
        push = rng.uniform(0.05, 0.3)
        bound = (np.abs(tube.pushes).max() * push + tube.disturbance_support.max()) / (1 - lam)
        state = np.zeros(2)
        for _ in range(300):
            model = models_of(tube.models, rng)
            perturbation = rng.choice([-push, push], 1)
            state = model.after(state, tube.gain @ state + perturbation) + rng.choice([-tube.noise, tube.noise], 2)
            assert (tube.shape.rows @ state).max() <= bound + 1e-9


def test_lemma_5_2_sections_without_noise_shrink_by_lambda():
    found = controller()
    shape = contractive_set(found.models, found.regulator.gain, found.settings.limits, 0.0, 0.95)
    tube = Tube(shape, found.models, found.regulator.gain, found.settings.limits, 0.0)
    level, still = np.random.default_rng(5).uniform(0.1, 1, len(shape.rows)), np.zeros(1)
    for _ in range(30):
        following, _ = tube.next_level(level, still)
        assert np.abs(following).max() <= 0.95 * np.abs(level).max() + 1e-12
        level = following


def test_the_terminal_section_is_the_least_that_never_grows():
    tube = controller().tube
    for seed in range(4):
        level = np.random.default_rng(seed).uniform(-0.2, 0.4, len(tube.shape.rows))
        found, onto, constant = tube.settle(level)
        stepped, _ = tube.next_level(found, np.zeros(1))
        assert (found >= level - 1e-12).all()
        assert (found >= stepped - 1e-10).all()
        assert np.allclose(found, onto @ level + constant, atol=1e-9)
        unknowns = cp.Variable(len(level))
        corners, per_row = tube.steps.reshape(-1, len(level)), tube.steps.shape[1]
        limits = [
            unknowns >= level,
            np.kron(np.eye(len(level)), np.ones((per_row, 1))) @ unknowns
            >= corners @ unknowns + np.repeat(tube.disturbance_support, per_row),
        ]
        program = cp.Problem(cp.Minimize(cp.sum(unknowns)), limits)
        assert found.sum() == pytest.approx(program.solve(solver=cp.CLARABEL), abs=1e-6)


def full_program(tube: Tube, regulator: Regulator, horizon: int, state: np.ndarray) -> float:
    """(5.24) with every row and gamma as unknowns: the referee."""
    faces, corners = tube.steps.shape[:2]
    levels = [cp.Variable(faces) for _ in range(horizon + 1)]
    inputs = [cp.Variable(tube.models.inputs) for _ in range(horizon)]
    limits = [tube.shape.rows @ state <= levels[0]]
    disturbance_support = np.repeat(tube.disturbance_support, corners)
    flat, push = tube.steps.reshape(-1, faces), tube.pushes.reshape(-1, tube.models.inputs)
    repeated = np.kron(np.eye(faces), np.ones((corners, 1)))
    for i in range(horizon):
        limits.append(repeated @ levels[i + 1] >= flat @ levels[i] + push @ inputs[i] + disturbance_support)
        limits.append(tube.limiting @ levels[i] + tube.limits.G @ inputs[i] <= 1)
    limits.append(repeated @ levels[-1] >= flat @ levels[-1] + disturbance_support)
    limits.append(tube.limiting @ levels[-1] <= 1)
    cost = sum(cp.quad_form(perturbation, regulator.stage) for perturbation in inputs)
    program = cp.Problem(cp.Minimize(cost), limits)
    program.solve(solver=cp.CLARABEL)
    if program.status in {"infeasible", "infeasible_inaccurate"}:
        return float("inf")
    return float(program.value + state @ regulator.cost @ state)


@pytest.mark.slow
def test_the_small_program_has_the_optimum_of_the_full_one():
    found = controller()
    program = TubeProgram(found.tube, found.regulator, 5)
    rng, solved = np.random.default_rng(6), 0
    for _ in range(12):
        state = rng.uniform(-1, 1, 2) * [9, 12]
        try:
            plan = program.plan(state)
        except InfeasibleError:
            assert full_program(found.tube, found.regulator, 5, state) == float("inf")
            continue
        assert plan.cost == pytest.approx(full_program(found.tube, found.regulator, 5, state), rel=1e-5)
        solved += np.abs(plan.input_perturbations).max() > 0.01
    assert solved >= 4


def test_the_cost_solves_the_lyapunov_equation_5_23():
    found, horizon = controller(), 4
    model, regulator = found.models.centre, found.regulator
    n, m = model.states, model.inputs
    shift = np.kron(np.eye(horizon, k=1), np.eye(m))
    first = np.hstack([np.eye(m), np.zeros((m, (horizon - 1) * m))])
    gain = regulator.gain
    psi = np.block([[model.A + model.B @ gain, model.B @ first], [np.zeros((horizon * m, n)), shift]])
    weight = np.block([
        [np.eye(n) + gain.T @ gain, gain.T @ first], [first.T @ gain, first.T @ first]
    ])  # fmt: skip
    solution = solve_discrete_lyapunov(psi.T, weight)
    plan = TubeProgram(found.tube, regulator, horizon).plan(np.array([-0.41, 6.0]))
    zeta = np.concatenate([[-0.41, 6.0], plan.input_perturbations.ravel()])
    assert plan.cost == pytest.approx(zeta @ solution @ zeta)


def test_without_noise_and_with_the_model_known_it_is_dual_mode_control():
    example = unknown()
    settings, known = example.settings, ModelSet.exact(example.model)
    dual = DualMode(example.model, settings.limits, settings.Q, settings.R, 15)
    shape = contractive_set(known, dual.regulator.gain, settings.limits, 0.0, 1.0)
    program = TubeProgram(Tube(shape, known, dual.regulator.gain, settings.limits, 0.0), dual.regulator, 15)
    for state in ([1.0, 1.0], [5.0, 7.0], [-5.0, -15.0]):
        action, cost = dual.decide(np.array(state))
        plan = program.plan(np.array(state))
        assert plan.cost == pytest.approx(cost, rel=1e-7)
        assert plan.action == pytest.approx(action, abs=1e-5)


def test_the_rigid_tube_keeps_the_limits_with_the_model_known():
    example = unknown()
    settings = example.settings
    rigid = RigidTube(example.model, settings.limits, settings.noise, settings.Q, settings.R, 15)
    plant = example.plant(3, corners=True)
    for start in ([-0.4, 6.0], [9.0, 2.0], [-5.0, -14.0]):
        state = np.array(start)
        for _ in range(30):
            action, _ = rigid.decide(state)
            assert settings.limits.kept(state, action)
            state = plant(state, action)
        assert np.abs(state).max() < 0.3


def test_the_edge_of_the_region_of_attraction():
    found = controller()
    for direction in ([1.0, 0.0], [0.5, 1.0], [-1.0, -1.0]):
        edge = found.central.reach(np.array(direction))
        assert found.central.solvable(edge * np.array(direction))
        assert not found.central.solvable(1.001 * edge * np.array(direction))


def test_what_cannot_be_had_is_named():
    found = controller()
    limits, gain = found.settings.limits, found.regulator.gain
    with pytest.raises(EmptySetError, match="lower the noise"):
        contractive_set(found.models, gain, limits, 20.0, 0.95)
    with pytest.raises(IllPosedError, match="contraction: must lie above 0"):
        contractive_set(found.models, gain, limits, 0.02, 1.2)
    free = Limits(np.array([[0.1, 0.0], [-0.1, 0.0]]), np.zeros((2, 1)))
    loose = ModelSet.exact(LinearModel(0.5 * np.eye(2), np.zeros((2, 1))))
    with pytest.raises(UnboundedError, match=r"limit every direction|span a flat set"):
        contractive_set(loose, np.zeros((1, 2)), free, 0.0, 0.9)
    with pytest.raises(InfeasibleError):
        found.central.plan(np.array([50.0, 50.0]))
    with pytest.raises(IllPosedError, match="horizon: must be a whole number between 1 and 200"):
        TubeProgram(found.tube, found.regulator, 0)
    with pytest.raises(IllPosedError, match="every bound must be finite and above 0"):
        Limits.symmetric({0: -1.0}, {}, 2, 1)
    with pytest.raises(UnboundedError, match="no limit given"):
        Limits(np.zeros((0, 2)), np.zeros((0, 1)))
    with pytest.raises(UnboundedError, match="no limit bears on the state"):
        contractive_set(loose, np.zeros((1, 2)), Limits(np.zeros((1, 2)), np.ones((1, 1))), 0.0, 0.9)
    with pytest.raises(IllPosedError, match="states: must be a whole number between 0 and 1, given 2"):
        Limits.symmetric({2: 1.0}, {}, 2, 1)
    for noise in (-0.02, np.nan, np.inf):
        with pytest.raises(IllPosedError, match="noise: must be finite and at least 0"):
            contractive_set(found.models, gain, limits, noise, 0.95)
        with pytest.raises(IllPosedError, match="noise: must be finite and at least 0"):
            RigidTube(found.models.centre, limits, noise, np.eye(2), np.eye(1), 5)
    with pytest.raises(IllPosedError, match="state: an entry is not finite"):
        found.central.plan(np.array([np.nan, 0.0]))
    with pytest.raises(IllPosedError, match="state: must have the shape"):
        found.central.plan(np.zeros(3))
    with pytest.raises(IllPosedError, match="direction: must not be 0"):
        found.central.reach(np.zeros(2))
    with pytest.raises(IllPosedError, match="F, G: must have 2 and 1 columns, given 3 and 1"):
        DualMode(found.models.centre, Limits(np.eye(3), np.zeros((3, 1))), np.eye(2), np.eye(1), 5)
    shape = NormalizedPolytope(np.array([[1.0], [-1.0]]))
    still = Tube(shape, ModelSet.exact(LinearModel([[1.0]], [[1.0]])), np.zeros((1, 1)),
                 Limits.symmetric({0: 1.0}, {}, 1, 1), 0.01)  # fmt: skip
    with pytest.raises(InfeasibleError, match="grows without end"):
        still.settle(np.ones(2))
    with pytest.raises(IllPosedError, match="a row a limit each"):
        Limits(np.ones((2, 2)), np.ones((3, 1)))
