"""The system of an interior-point step: conjugate gradients and a factor give the same, which satisfies it."""

from __future__ import annotations

import numpy as np
import pytest

from theory.solvers import normal_equations
from theory.solvers.inequalities import Inequalities
from theory.solvers.margins import positive_margin
from theory.solvers.normal_equations import NormalEquations


def positive(chance, count, size):
    halves = chance.normal(size=(count, size, size))
    return halves @ np.swapaxes(halves, 1, 2) + 0.1 * np.eye(size)


@pytest.fixture(params=[(1, 1), (1, 4), (3, 2), (5, 3)])
def system(request):
    """Edges among few nodes, loops among them, and metrics of all sizes."""
    nodes, size = request.param
    chance = np.random.default_rng(nodes * size)
    source, target = chance.integers(0, nodes, (2, 3 * nodes))
    problem = Inequalities(nodes, source, target, chance.normal(size=(3 * nodes, size, size)))
    metrics = 10.0 ** chance.uniform(-1, 1, (3 * nodes, 1, 1)) * positive(chance, 3 * nodes, size)
    equations = NormalEquations(problem, metrics, positive(chance, nodes, size))
    right = chance.normal(size=(nodes, size, size))
    return equations, right + np.swapaxes(right, 1, 2)


def test_both_ways_satisfy_the_equations(system, monkeypatch):
    monkeypatch.setattr(normal_equations, "RESIDUAL", 1e-12)
    equations, right = system
    problem, metric = equations.problem, equations.edges
    for step, level in (equations.factorised(right), equations.iterated(right, np.zeros(right.shape))):
        value = np.vdot(equations.tilt, step) / equations.weight
        flow = metric @ (problem.drop(step) - value * np.eye(problem.size)) @ metric
        assert np.trace(step, axis1=1, axis2=2).sum() == pytest.approx(0, abs=1e-9)
        assert np.trace(flow, axis1=1, axis2=2).sum() == pytest.approx(0, abs=1e-8)
        left = problem.balance(flow) + equations.nodes @ step @ equations.nodes + level * np.eye(problem.size)
        assert left == pytest.approx(right, abs=1e-6)


def test_conjugate_gradients_do_not_lose_the_trace_next_to_rounding(system, monkeypatch):
    monkeypatch.setattr(normal_equations, "RESIDUAL", 0.0)
    equations, right = system
    step, level = equations.iterated(right, np.zeros(right.shape))
    other, same = equations.factorised(right)
    assert step == pytest.approx(other, abs=1e-7 * (1 + abs(other).max()))
    assert level == pytest.approx(same, abs=1e-6 * (1 + abs(same)))


@pytest.mark.parametrize("worth", [0.0, np.inf])
def test_a_margin_is_found_either_way(worth, monkeypatch):
    monkeypatch.setattr(NormalEquations, "worth", worth)
    used = []
    monkeypatch.setattr(NormalEquations, "factorised", seen(NormalEquations.factorised, used))
    maps = np.random.default_rng(5).normal(size=(1, 6, 6))
    every = np.zeros(1, dtype=int)
    problem = Inequalities(1, every, every, maps / np.abs(np.linalg.eigvals(maps[0])).max() / 1.001)
    assert positive_margin(problem, np.eye(6)[None], "a margin").value > 0
    assert bool(used) == (worth == 0)


def seen(method, used):
    def watched(*given):
        used.append(1)
        return method(*given)

    return watched
