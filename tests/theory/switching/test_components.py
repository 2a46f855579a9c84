"""Large inequalities a component at a time: the verdicts of CVXPY, and matrices that prove what they say."""

from __future__ import annotations

import cvxpy as cp
import numpy as np
import pytest

from benchmarks.theory import random_graph
from theory import InfeasibleError, SolverError
from theory.switching import components, lyapunov
from theory.switching.graph import Graph


def chain():
    """Two cycles, a node before, one between and one after them, an edge from the first cycle to the end, a jump."""
    edges = ((0, 1, 1), (1, 1, 2), (2, 1, 1), (2, 1, 3), (3, 1, 4), (4, 1, 4), (4, 1, 5), (1, 1, 5))
    return Graph(6, edges, ((2, 4), (0, 5)))


def alike(nodes, size):
    return np.broadcast_to(np.eye(size), (nodes, size, size))


def by_cvxpy(graph, maps):
    size = maps.shape[-1]
    unknown = [cp.Variable((size, size), symmetric=True) for _ in range(graph.nodes)]
    limits = [item >> np.eye(size) for item in unknown]
    limits += [unknown[u] - maps[k].T @ unknown[v] @ maps[k] >> np.eye(size) for k, (u, _, v) in enumerate(graph.edges)]
    limits += [unknown[u] - unknown[v] >> np.eye(size) for u, v in graph.jumps]
    problem = cp.Problem(cp.Minimize(0), limits)
    problem.solve(solver=cp.CLARABEL)
    return {"optimal": True, "infeasible": False}[problem.status]


def test_what_is_before_a_cycle_is_as_large_as_it_has_to_be():
    graph = chain()
    maps = np.random.default_rng(3).normal(size=(len(graph.edges), 3, 3))
    maps *= (
        np.where([u == v or {u, v} == {1, 2} for u, _, v in graph.edges], 0.9, 50.0) / np.linalg.norm(maps, 2, (1, 2))
    )[:, None, None]
    found = components.solved(graph, maps, alike(6, 3))
    assert lyapunov.margin_of(graph, maps, found, 1.0) > 0
    assert np.linalg.eigvalsh(found[5]) == pytest.approx(np.ones(3))


@pytest.mark.parametrize("spoiled", [1, 5])
def test_one_component_without_a_solution_is_enough(spoiled):
    graph = chain()
    maps = np.full((len(graph.edges), 1, 1), 0.5)
    assert lyapunov.margin_of(graph, maps, components.solved(graph, maps, alike(6, 1)), 1.0) > 0
    maps[spoiled] = 3.0
    with pytest.raises(InfeasibleError):
        components.solved(graph, maps, alike(6, 1))


def test_jumps_around_a_cycle_contradict_each_other():
    graph = Graph(2, ((0, 1, 0), (1, 1, 1)), ((0, 1), (1, 0)))
    with pytest.raises(InfeasibleError):
        components.solved(graph, np.full((2, 2, 2), 0.1), alike(2, 2))


@pytest.mark.parametrize("share", [0.99, 0.93, 0.85])
@pytest.mark.parametrize(("nodes", "size", "seed"), [(9, 6, 1), (5, 9, 2), (14, 5, 3), (3, 12, 4), (8, 7, 5)])
def test_verdicts_are_those_of_cvxpy(nodes, size, seed, share):
    """Below the rates that means prove, above and below the smallest that matrices do."""
    graph, maps = random_graph(nodes, size=size, norm=1.0, seed=seed)
    low, high = 0.1, 2.0
    for _ in range(12):
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if lyapunov.over_means(graph, maps, middle) is not None else (middle, high)
    maps = maps / (share * high)
    try:
        found = lyapunov.feasible(graph, maps)
        said = True
        assert lyapunov.margin_of(graph, maps, found, 1.0) > 0.99
    except InfeasibleError:
        said = False
    assert said == by_cvxpy(graph, maps)


@pytest.mark.parametrize(("size", "nodes", "norm"), [(8, 60, 1.4), (12, 24, 1.4), (20, 8, 1.6), (10, 20, 1.4)])
def test_large_inequalities_need_no_clarabel(size, nodes, norm, monkeypatch):
    monkeypatch.delattr(lyapunov.LmiProblem, "feasible")
    graph, maps = random_graph(nodes, size=size, norm=norm)
    assert lyapunov.over_means(graph, maps, 1.0) is None
    found = lyapunov.feasible(graph, maps)
    for (u, _, v), one in zip(graph.edges, maps, strict=True):
        assert np.linalg.eigvalsh(found[u] - one.T @ found[v] @ one)[0] > 0.99
    assert np.linalg.eigvalsh(found).min() > 0.99


def test_what_takes_too_long_is_left_to_clarabel(monkeypatch):
    graph, maps = random_graph(10, size=8, norm=1.4)

    def given_up(*_):
        raise SolverError("no decision", "stability")

    monkeypatch.setattr(components, "solved", given_up)
    assert lyapunov.margin_of(graph, maps, lyapunov.feasible(graph, maps), 1.0) > 0.99
