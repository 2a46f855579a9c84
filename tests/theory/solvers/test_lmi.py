"""The solver's conventions, its statuses, and CVXPY as referee."""

from __future__ import annotations

import cvxpy as cp
import numpy as np
import pytest

from benchmarks.theory import random_graph
from theory import InfeasibleError, SolverError, TooLargeError
from theory.solvers.lmi import LmiProblem
from theory.switching import stability


@pytest.mark.parametrize("size", [1, 2, 3, 4, 5])
def test_triangles_go_in_and_come_out_as_they_should(size):
    """The nearest bound: min trace X with X > C is C itself, off the diagonal too."""
    half = np.random.default_rng(size).normal(size=(size, size))
    wanted = half @ half.T + np.eye(size)
    problem = LmiProblem()
    unknown = problem.symmetric(2, size)
    problem.blocks(2, size, -np.array([wanted, 2 * wanted])).congruence(unknown, np.arange(2), np.eye(size))
    diagonal = np.flatnonzero(np.equal(*np.triu_indices(size)))
    weights = {int(k + unknown.entries * which): 1.0 for which in range(2) for k in diagonal}
    found = unknown.of(problem.minimize(weights, "a bound").values)
    assert found == pytest.approx(np.array([wanted, 2 * wanted]), abs=1e-5)


@pytest.mark.parametrize("size", [1, 2, 3])
def test_products_with_full_unknowns(size):
    """X + X' > 2 C with the smallest sum of entries weighted as C: the symmetric part is C."""
    problem = LmiProblem()
    unknown = problem.full(1, size, size)
    wanted = np.diag(np.arange(1.0, size + 1))
    problem.blocks(1, size, -2 * wanted).product(unknown, np.arange(1), np.eye(size), np.eye(size))
    diagonal = {k * size + k: 1.0 for k in range(size)}
    found = unknown.of(problem.minimize(diagonal, "a bound").values)[0]
    assert found + found.T == pytest.approx(2 * wanted, abs=1e-5)


def test_only_solved_counts():
    problem = LmiProblem()
    x = problem.number()
    problem.blocks(1, 1, -1.0).scalar(x, np.eye(1))
    problem.blocks(1, 1, -1.0).scalar(x, -np.eye(1))
    with pytest.raises(InfeasibleError, match="PrimalInfeasible"):
        problem.feasible("a contradiction")
    problem = LmiProblem()
    x = problem.number()
    problem.blocks(1, 1).scalar(x, np.eye(1))
    with pytest.raises(SolverError, match="DualInfeasible"):
        problem.minimize({x: -1.0}, "no bound")


def test_too_many_coefficients_are_counted_before_they_are_made():
    problem = LmiProblem()
    unknown = problem.symmetric(1, 50)
    blocks = problem.blocks(2_000, 50)
    with pytest.raises(TooLargeError):
        blocks.congruence(unknown, np.zeros(2_000, dtype=int), np.eye(50))


@pytest.mark.parametrize("rate", [0.6, 0.75, 0.85])
def test_feasibility_is_what_cvxpy_says(rate):
    graph, maps = random_graph(12, 7)
    unknown = [cp.Variable((2, 2), symmetric=True) for _ in range(graph.nodes)]
    identity = np.eye(2)
    limits = [item >> identity for item in unknown]
    limits += [
        rate**2 * unknown[u] - maps[k].T @ unknown[v] @ maps[k] >> identity for k, (u, _, v) in enumerate(graph.edges)
    ]
    referee = cp.Problem(cp.Minimize(0), limits)
    referee.solve(solver=cp.CLARABEL)
    if referee.status == "optimal":
        found = stability.feasible(graph, maps, rate)
        for k, (u, _, v) in enumerate(graph.edges):
            assert np.linalg.eigvalsh(rate**2 * found[u] - maps[k].T @ found[v] @ maps[k])[0] > 0.99
    else:
        assert referee.status == "infeasible"
        with pytest.raises(InfeasibleError):
            stability.feasible(graph, maps, rate)
