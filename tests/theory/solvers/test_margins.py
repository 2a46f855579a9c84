"""Margins found by conjugate gradients: bounds from both sides, Clarabel and spectral radii as referees."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.theory import random_graph
from theory import InfeasibleError, NotCertifiedError, SolverError
from theory.solvers.inequalities import Inequalities
from theory.solvers.margins import positive_margin
from theory.switching import lyapunov
from theory.switching.graph import Graph


def identities(nodes, size):
    return np.broadcast_to(np.eye(size), (nodes, size, size))


def of_graph(graph, maps):
    source, target = np.array([(u, v) for u, _, v in graph.edges]).T
    return Inequalities(graph.nodes, source, target, maps)


def test_balance_is_the_adjoint_of_drop():
    chance = np.random.default_rng(0)
    graph, maps = random_graph(7, size=3)
    problem = of_graph(graph, maps)
    matrices, flows = chance.normal(size=(7, 3, 3)), chance.normal(size=(14, 3, 3))
    assert np.vdot(problem.drop(matrices), flows) == pytest.approx(np.vdot(matrices, problem.balance(flows)))


@pytest.mark.parametrize("norm", [1.0, 1.15, 1.3])
@pytest.mark.parametrize("seed", [1, 2])
def test_the_largest_margin_lies_between_the_bounds(norm, seed):
    graph, maps = random_graph(6, size=4, norm=norm, seed=seed)
    try:
        largest = lyapunov.largest_margin(graph, maps, 1.0)[1]
    except NotCertifiedError:
        with pytest.raises(InfeasibleError, match="a margin"):
            positive_margin(of_graph(graph, maps), identities(6, 4), "a margin")
        return
    found = positive_margin(of_graph(graph, maps), identities(6, 4), "a margin")
    held = lyapunov.margin_of(graph, maps, found.matrices, 1.0)
    assert 0 < found.value <= held <= largest * (1 + 1e-6) <= found.bound * (1 + 2e-6)
    assert np.trace(found.matrices, axis1=1, axis2=2).sum() == pytest.approx(24)


@pytest.mark.parametrize("size", [1, 2, 5, 9])
@pytest.mark.parametrize("distance", [0.1, 1e-3, 1e-5])
def test_a_single_map_is_decided_by_its_spectral_radius(size, distance):
    maps = np.random.default_rng(size).normal(size=(1, size, size))
    radius = np.abs(np.linalg.eigvals(maps[0])).max()
    every = np.zeros(1, dtype=int)
    start = identities(1, size)
    stable = Inequalities(1, every, every, maps / radius / (1 + distance))
    assert positive_margin(stable, start, "a margin").value > 0
    with pytest.raises(InfeasibleError):
        positive_margin(Inequalities(1, every, every, maps / radius * (1 + distance)), start, "a margin")


def test_a_good_start_is_an_answer():
    graph, maps = random_graph(5, size=4, norm=1.1, seed=1)
    first = positive_margin(of_graph(graph, maps), identities(5, 4), "a margin")
    assert first.work > 0
    again = positive_margin(of_graph(graph, maps), 7 * first.matrices, "a margin")
    assert again.work <= first.work
    assert lyapunov.margin_of(graph, maps, again.matrices, 1.0) > 0


def test_too_much_work_and_matrices_without_a_factor_are_told():
    graph, maps = random_graph(5, size=4, norm=1.6, seed=1)
    with pytest.raises(SolverError, match="no decision") as caught:
        positive_margin(of_graph(graph, maps), identities(5, 4), "a margin", work=1)
    assert not isinstance(caught.value, InfeasibleError)
    with pytest.raises(SolverError, match="no progress"):
        positive_margin(of_graph(graph, maps), -identities(5, 4), "a margin")


def test_a_graph_of_two_loops():
    """From either node to both: the maps' common growth decides, which is that of a product of both."""
    maps = np.array([[[0.0, 1.0], [0.0, 0.0]], [[0.0, 0.0], [1.0, 0.0]]])
    graph = Graph(1, ((0, 1, 0), (0, 2, 0)))
    assert positive_margin(of_graph(graph, maps / 1.01), identities(1, 2), "a margin").value > 0
    with pytest.raises(InfeasibleError):
        positive_margin(of_graph(graph, maps / 0.99), identities(1, 2), "a margin")
