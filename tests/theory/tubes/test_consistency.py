"""Samples that no admissible model explains: flagged before the tube is left, and never where all is as stated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from theory.errors import EmptySetError, InfeasibleError
from theory.tubes.consistency import ConsistencyMonitor
from theory.tubes.examples import unknown
from theory.tubes.models import LinearModel, ModelSet
from theory.tubes.trimodal import Trimodal, prepare


def closed(seed, plant, steps=40):
    """Flags and escapes from the tube, by sample, of a loop whose plant is the example's for the preparation alone."""
    example = unknown()
    rng = np.random.default_rng(seed)
    noise = example.settings.noise
    prepared = prepare(
        lambda state, action: example.model.after(state, action) + rng.uniform(-noise, noise, 2),
        example.start, example.settings,
    )  # fmt: skip
    controller = Trimodal(example.settings, prepared.models, prepared.window)
    state, escapes = np.array(example.start), []
    for k in range(steps):
        try:
            action = controller.decide(state)
        except InfeasibleError:
            break
        after = plant(example.model, k, state, action.input, rng, noise)
        level = 1.0 if action.plan is None else action.plan.levels[1]
        if (controller.tube.shape.rows @ after > level + 1e-6).any():
            escapes.append(k)
        controller.observe(state, action.input, after)
        state = after
    return controller.monitor.flagged, escapes


def honest(model, _, state, action, rng, noise):
    return model.after(state, action) + rng.choice([-noise, noise], 2)


def drifting(model, k, state, action, rng, noise):
    moved = LinearModel(model.A + 0.004 * k * np.array([[1.0, 0.5], [0.0, -1.0]]), model.B * (1 - 0.01 * k))
    return moved.after(state, action) + rng.uniform(-noise, noise, 2)


def loud(model, _, state, action, rng, noise):
    return model.after(state, action) + rng.uniform(-1.5 * noise, 1.5 * noise, 2)


@pytest.mark.parametrize("count", [2, pytest.param(100, marks=pytest.mark.full)])
def test_no_false_flag(count):
    for seed in range(count):
        assert closed(seed, honest) == ([], [])


@pytest.mark.parametrize("plant", [drifting, loud])
@pytest.mark.parametrize("count", [2, pytest.param(100, marks=pytest.mark.full)])
def test_what_leaves_its_tube_was_flagged(plant, count):
    left = flagged = 0
    for seed in range(count):
        flags, escapes = closed(seed, plant)
        flagged += bool(flags)
        if escapes:
            left += 1
            assert flags
            assert flags[0] <= escapes[0]
    assert flagged > count / 2
    assert left


def test_a_flag_names_its_sample():
    model = LinearModel(np.array([[0.5]]), np.array([[1.0]]))
    rng = np.random.default_rng(0)
    states, inputs = rng.normal(size=(20, 1)), rng.normal(size=(20, 1))
    after = states @ model.A.T + inputs @ model.B.T + rng.uniform(-0.01, 0.01, (20, 1))
    monitor = ConsistencyMonitor(ModelSet.from_data(states, inputs, after, 0.01), 0.01)
    assert monitor.observe(states[0], inputs[0], after[0])
    assert not monitor.observe(states[1], inputs[1], after[1] + 0.1)
    assert monitor.observe(states[2], inputs[2], after[2])
    assert monitor.flagged == [1]


def test_models_are_asked_together():
    """Each sample is explained by some model of the set, but no model explains both."""
    model = LinearModel(np.array([[0.5]]), np.array([[1.0]]))
    states, inputs = np.array([[1.0], [0.0], [1.0]]), np.array([[0.0], [1.0], [1.0]])
    monitor = ConsistencyMonitor(ModelSet.from_data(states, inputs, states @ model.A.T + inputs @ model.B.T, 0.1), 0.1)
    one = np.array([1.0]), np.array([0.0])
    assert monitor.observe(*one, np.array([0.5 + 0.19]))
    assert not monitor.observe(*one, np.array([0.5 - 0.19]))
    assert monitor.flagged == [1]


def test_the_preparation_names_the_first_sample_it_cannot_explain():
    example = unknown()
    count = 0

    def plant(state, action):
        nonlocal count
        count += 1
        jump = 1.0 if count == 8 else 0.0
        return example.model.after(state, action) + jump

    with pytest.raises(EmptySetError, match="beginning with sample 7: raise the bound"):
        prepare(plant, example.start, replace(example.settings, noise=0.001))
