"""Regression of a model from samples, and the set of all models the samples allow."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from theory.errors import EmptySetError, IllPosedError, RankError
from theory.tubes.dmd import Window, regress
from theory.tubes.examples import unknown
from theory.tubes.models import LinearModel, ModelSet, Regulator


def samples(model: LinearModel, count: int, noise: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Random states and inputs, and what follows."""
    rng = np.random.default_rng(seed)
    states = rng.normal(size=(count, model.states))
    inputs = rng.normal(size=(count, model.inputs))
    after = states @ model.A.T + inputs @ model.B.T + rng.uniform(-noise, noise, (count, model.states))
    return states, inputs, after


@pytest.mark.parametrize("name", ["dmd", "dmd_three_states"])
def test_without_noise_the_model_is_found(name: str):
    model = unknown(name).model
    found = regress(*samples(model, 10, 0.0))
    assert np.allclose(found.model.joined, model.joined, atol=1e-12)
    assert found.full_rank
    assert found.rank == model.states + model.inputs
    assert found.residual < 1e-12
    assert 1 <= found.condition < 100


def test_the_regression_is_the_least_squares_solution():
    states, inputs, after = samples(unknown().model, 30, 0.5)
    by_numpy = np.linalg.lstsq(np.hstack([states, inputs]), after, rcond=None)[0].T
    assert np.allclose(regress(states, inputs, after).model.joined, by_numpy)


def test_data_of_low_rank_are_reported_and_truncation_is_possible():
    states, inputs, after = samples(unknown().model, 10, 0.0)
    states[:, 1] = 2 * states[:, 0]
    found = regress(states, inputs, after)
    assert found.rank == 2
    assert not found.full_rank
    truncated = regress(*samples(unknown().model, 10, 0.1), rank=1)
    assert truncated.rank == 1
    assert np.linalg.matrix_rank(truncated.model.joined) == 1
    with pytest.raises(RankError, match="excite"):
        regress(np.zeros((3, 2)), np.zeros((3, 1)), np.zeros((3, 2)))
    with pytest.raises(IllPosedError, match="rank: must be a whole number between 1 and 3"):
        regress(states, inputs, after, rank=4)
    with pytest.raises(IllPosedError, match="inputs: must have the shape"):
        regress(states, inputs[:-1], after)
    with pytest.raises(IllPosedError, match="not finite"):
        regress(np.full((3, 2), np.nan), np.zeros((3, 1)), np.zeros((3, 2)))


def test_the_window_slides():
    window = Window(3)
    with pytest.raises(RankError, match="none yet"):
        window.estimate()
    for i in range(5):
        window.push(np.array([float(i)]), np.array([1.0]), np.array([i + 1.0]))
    states, _, after = window.arrays()
    assert states.ravel().tolist() == [2, 3, 4]
    assert after.ravel().tolist() == [3, 4, 5]
    assert np.allclose(window.estimate().model.joined, [[1, 1]])


@pytest.mark.parametrize("name", ["dmd", "dmd_three_states"])
@pytest.mark.parametrize("seed", range(5))
def test_the_true_model_is_in_the_set_and_no_excluded_one_explains_the_data(name: str, seed: int):
    model, noise = unknown(name).model, 0.02
    states, inputs, after = samples(model, 20, noise, seed)
    found = ModelSet.from_data(states, inputs, after, noise)
    assert found.contains(model)
    assert found.contains(found.centre)
    rng = np.random.default_rng(seed)
    for _ in range(200):
        other = LinearModel(
            model.A + rng.normal(size=model.A.shape) * 0.02, model.B + rng.normal(size=model.B.shape) * 0.02
        )
        explains = np.abs(after - states @ other.A.T - inputs @ other.B.T).max() <= noise
        assert found.contains(other) == explains


def test_a_direction_of_the_next_state_sees_the_whole_product_through_few_corners():
    model = unknown().model
    found = ModelSet.from_data(*samples(model, 15, 0.02), 0.02)
    every = np.array([item.joined for item in found.vertex_models()])
    assert len(every) == found.size
    for direction in np.random.default_rng(0).normal(size=(6, 2)):
        image = found.image(direction)
        brute = np.einsum("i,kij->kj", direction, every)
        assert len(image) < len(every) / 2
        for ray in np.random.default_rng(1).normal(size=(40, 3)):
            assert (image @ ray).max() == pytest.approx((brute @ ray).max(), abs=1e-9)


def test_many_unknowns_take_parallelotopes_around_the_set():
    model = unknown("dmd_three_states").model
    found = ModelSet.from_data(*samples(model, 20, 0.02), 0.02)
    assert found.axes is not None
    inner = np.array([row.vertices for row in found.rows], dtype=object)
    for direction in np.random.default_rng(0).normal(size=(3, 3)):
        image = found.image(direction)
        for ray in np.random.default_rng(1).normal(size=(20, 5)):
            exact = sum(max(weight * (corners @ ray)) for weight, corners in zip(direction, inner, strict=True))
            assert (image @ ray).max() >= exact - 1e-9
            assert (image @ ray).max() <= exact + 0.2


def test_noise_at_its_bound_in_every_sample_leaves_a_point_that_still_works():
    model = LinearModel([[0.5]], [[1.0]])
    states, inputs = np.array([[s] for s in (1.0, 1, -1, -1)]), np.array([[s] for s in (1.0, -1, 1, -1)])
    for signs in product((-1, 1), repeat=4):
        after = states * 0.5 + inputs + 0.02 * np.array(signs)[:, None]
        found = ModelSet.from_data(states, inputs, after, 0.02)
        assert found.contains(model)


@pytest.mark.parametrize("noise", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize(("name", "corners"), [("dmd", False), ("dmd", True), ("dmd_three_states", True)])
def test_small_noise_leaves_small_sets(noise: float, name: str, corners: bool):
    """The sets are computed in units of the noise; solvers have absolute tolerances."""
    model, rng = unknown(name).model, np.random.default_rng(0)
    states, inputs, after = samples(model, 15, 0.0)
    drawn = rng.choice([-noise, noise], after.shape) if corners else rng.uniform(-noise, noise, after.shape)
    found = ModelSet.from_data(states, inputs, after + drawn, noise)
    assert found.contains(model)
    assert found.width < 100 * noise


def test_data_that_see_a_direction_hardly_at_all():
    states, inputs, after = samples(unknown().model, 15, 0.02)
    states[:, 0] = states[:, 1] + 1e-12 * states[:, 0]
    with pytest.raises(RankError, match="span 2 of 3 directions"):
        ModelSet.from_data(states, inputs, after, 0.02)
    with pytest.raises(IllPosedError, match="successors: must have the shape"):
        ModelSet.from_data(states, inputs, after[:-1], 0.02)


def test_data_that_no_model_explains_or_that_leave_models_without_end():
    states, inputs, after = samples(unknown().model, 15, 0.1)
    with pytest.raises(EmptySetError, match=r"noise: no model explains state 1 .* raise the bound"):
        ModelSet.from_data(states, inputs, after, 0.01)
    with pytest.raises(RankError, match="span 2 of 3 directions"):
        ModelSet.from_data(states[:2], inputs[:2], after[:2], 0.1)
    with pytest.raises(IllPosedError, match="noise: must be finite and above 0"):
        ModelSet.from_data(states, inputs, after, 0.0)


def test_the_regulator_solves_its_equations():
    model = unknown("dmd_three_states").model
    found = Regulator.of(model, np.eye(3), np.eye(2))
    loop = model.A + model.B @ found.gain
    assert np.abs(np.linalg.eigvals(loop)).max() < 1
    stage = np.eye(3) + found.gain.T @ found.gain
    assert np.allclose(found.cost, stage + loop.T @ found.cost @ loop)
    with pytest.raises(IllPosedError, match="no gain stabilises"):
        Regulator.of(LinearModel([[2.0]], [[0.0]]), np.eye(1), np.eye(1))
    with pytest.raises(IllPosedError, match="R only positive"):
        Regulator.of(model, np.eye(3), np.zeros((2, 2)))
    with pytest.raises(IllPosedError, match="Q: must have the shape"):
        Regulator.of(model, np.eye(2), np.eye(2))
