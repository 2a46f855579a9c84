"""The inequalities of Theorems 3.1 and 4.1: whether matrices prove a rate along a graph, and which have most margin."""

from __future__ import annotations

from typing import Any

import numpy as np

from theory.arrays import Array
from theory.errors import InfeasibleError, NotCertifiedError, SolverError
from theory.solvers.lmi import LmiProblem
from theory.switching import components
from theory.switching.graph import Graph
from theory.switching.loops import edge_indices

TERMS = 80
"""Lengths of paths that are summed up before a program decides."""

SMALL = 1e-3
"""Size of the last terms, beside I, at which the sum counts as converged; the margin is computed from what it is."""

SLOW = 0.9
"""Ratio of successive terms beyond which the sum converges too slowly, or not."""

POWER = 4.0
"""Of the means: a larger one is nearer to the largest matrix, and takes more terms."""

MEANS = 120
"""Terms of the means, at most."""

LOOKED = 10
"""Terms after which the margin is looked at, whatever their growth."""

ROOM = 0.5
"""Size of a term, beside I, below which the margin is looked at."""

TRANSIENT = 4
"""Terms whose ratio tells nothing."""

BOUND = 1e9
"""Entries beside a margin of 1 beyond which matrices found prove nothing: rates approached without bound are none."""

LARGE = 600
"""Products of conjugate gradients in the time of one program of Clarabel, from which on they are tried first."""


def feasible(graph: Graph, maps: Array, rate: float = 1.0) -> Array:
    """Matrices that prove a rate with some room, not with the most: one cheap solve that decides whether any do.

    As the inequalities scale, I on their right-hand side will do: L_u > I, r^2 L_u - G' L_v G > I, L_u - L_v > I. Where
    the sum over all paths converges, or means in its place, they prove the rate without any program. Large ones are
    decided without a matrix of the unknowns, small ones by Clarabel.

    Parameters
    ----------
    graph
        Edges and jumps of the inequalities.
    maps
        The map of every edge, edges x n x n.
    rate
        Decay a sample.

    Raises
    ------
    SolverError
        There are none (`InfeasibleError`), or the solver does not decide.
    """
    summed = over_paths(graph, maps, rate)
    if summed is not None:
        return summed
    found, proved = _repeated_means(graph, maps, rate)
    if not proved:
        found, proved = _of_components(graph, maps, rate, found)
    if proved:
        return found
    problem, unknown = _inequalities(graph, maps, rate, np.eye(maps.shape[-1]))
    solved: Array = unknown.of(problem.feasible("stability").values)
    return solved


def over_paths(graph: Graph, maps: Array, rate: float) -> Array | None:
    """L_u = I + sum of G' L_v G / r^2 over the edges from u, where that sum over all paths is finite; else None.

    It exceeds every one of its terms, so that it proves the rate along each edge. It is not finite for every rate that
    can be proved, and is none for jumps, which take no time.

    Parameters
    ----------
    graph, maps, rate
        As for `feasible`.

    Returns
    -------
    Array
        N x n x n, or None.
    """
    if graph.jumps or not graph.edges:
        return None
    source, target, _, _ = edge_indices(graph)
    scaled, turned = maps / rate, np.swapaxes(maps, 1, 2) / rate
    identity = np.broadcast_to(np.eye(maps.shape[-1]), (graph.nodes, *maps.shape[1:]))
    found, before = identity.copy(), np.inf
    for length in range(TERMS):
        moved = identity.copy()
        np.add.at(moved, source, turned @ found[target] @ scaled)
        step = float(np.abs(moved - found).max())
        found = moved
        if step <= SMALL:
            found = (found + np.swapaxes(found, 1, 2)) / 2
            margin = margin_of(graph, scaled, found, 1.0) * min(1.0, rate**2)
            return found / margin if margin > 0 else None
        if length > TRANSIENT and step > SLOW * before:
            return None
        before = step
    return None


def over_means(graph: Graph, maps: Array, rate: float) -> Array | None:
    """L_u = I + (sum of (G' L_v G / r^2)^p over the edges from u)^(1 / p), where repeating that ends; else None.

    The p-th root keeps the order of matrices (Loewner and Heinz), so that L_u exceeds each of the terms by I, and for
    p > 1 by less than their sum does. Eigenvalues of single matrices take the place of a program.

    Parameters
    ----------
    graph, maps, rate
        As for `feasible`.

    Returns
    -------
    Array
        N x n x n, or None.
    """
    found, proved = _repeated_means(graph, maps, rate)
    return found if proved else None


def _repeated_means(graph: Graph, maps: Array, rate: float) -> tuple[Array, bool]:
    """The matrices at which the means end, and whether they prove the rate."""
    if graph.jumps or not graph.edges:
        return np.broadcast_to(np.eye(maps.shape[-1]), (graph.nodes, *maps.shape[1:])), False
    source, target, _, _ = edge_indices(graph)
    scaled, turned = maps / rate, np.swapaxes(maps, 1, 2) / rate
    largest = float(np.linalg.norm(scaled, 2, axis=(1, 2)).max()) ** 2
    identity = np.broadcast_to(np.eye(maps.shape[-1]), (graph.nodes, *maps.shape[1:]))
    found, before = identity.copy(), np.inf
    for length in range(1, MEANS):
        values, vectors = np.linalg.eigh(turned @ found[target] @ scaled)
        unit = max(float(values.max()), 1e-300)
        powers = (np.maximum(values, 0.0) / unit) ** POWER
        total = np.zeros(found.shape)
        np.add.at(total, source, (vectors * powers[:, None, :]) @ np.swapaxes(vectors, 1, 2))
        values, vectors = np.linalg.eigh(total)
        roots = unit * np.maximum(values, 0.0) ** (1 / POWER)
        moved = identity + (vectors * roots[:, None, :]) @ np.swapaxes(vectors, 1, 2)
        step = float(np.linalg.norm(moved - found, 2, axis=(1, 2)).max())
        found = (moved + np.swapaxes(moved, 1, 2)) / 2
        if step * largest <= ROOM or length % LOOKED == 0:
            margin = margin_of(graph, scaled, found, 1.0) * min(1.0, rate**2)
            if margin > SMALL:
                return found / margin, True
        if length > LOOKED and step > before:
            break
        before = step
    return found, False


def _of_components(graph: Graph, maps: Array, rate: float, start: Array) -> tuple[Array, bool]:
    """Matrices found a strongly connected component at a time, and whether they prove the rate.

    Small inequalities are left to Clarabel, and those that are not decided in the time that it takes for them.

    Raises
    ------
    InfeasibleError
        No matrices do.
    """
    work = _work(graph, maps)
    if work < LARGE:
        return start, False
    try:
        found = components.solved(graph, maps / rate, start, work)
    except InfeasibleError:
        raise
    except SolverError:
        return start, False
    margin = margin_of(graph, maps / rate, found, 1.0) * min(1.0, rate**2)
    return (found / margin, True) if margin * BOUND > np.abs(found).max() else (start, False)


def descends(graph: Graph, maps: Array) -> bool:
    """Whether the smallest rate is found sooner by descent (`theory.switching.descent`) than by halving an interval.

    Parameters
    ----------
    graph, maps
        As for `feasible`.
    """
    return not graph.jumps and _work(graph, maps) >= LARGE and components.connected(graph)


def _work(graph: Graph, maps: Array) -> float:
    """Products of conjugate gradients in the time that Clarabel takes for a program, as measured for n from 3 to 26."""
    return float(maps.shape[-1] ** 2.5 * (2 * graph.inequalities) ** 0.5)


def largest_margin(graph: Graph, maps: Array, rate: float) -> tuple[Array, float]:
    """Matrices of the largest margin, and the margin: L_u - t I, r^2 L_u - G' L_v G - t I, L_u - L_v - t I >= 0.

    Parameters
    ----------
    graph, maps, rate
        As for `feasible`.

    Raises
    ------
    NotCertifiedError
        The largest margin is zero.
    SolverError
        The solver does not find it.
    """
    problem, unknown = _inequalities(graph, maps, rate)
    margin = problem.number()
    identity = np.eye(maps.shape[-1])
    for blocks in problem.every:
        blocks.scalar(margin, -identity)
    problem.blocks(1, 1, float(graph.nodes * maps.shape[-1])).trace(unknown, -1.0)
    solution = problem.minimize({margin: -1.0}, "stability")
    if solution.values[margin] < 1e-12:
        raise NotCertifiedError("the largest margin is zero")
    return unknown.of(solution.values), float(solution.values[margin])


def decides(graph: Graph, maps: Array, rate: float) -> tuple[bool, Array | None]:
    """Whether matrices prove a rate, and some that do where they were found.

    Parameters
    ----------
    graph, maps, rate
        As for `feasible`.

    Raises
    ------
    SolverError
        The solver does not decide.
    """
    try:
        return True, feasible(graph, maps, rate)
    except InfeasibleError:
        return False, None
    except SolverError:  # undecided; the largest margin decides
        try:
            return True, largest_margin(graph, maps, rate)[0]
        except (InfeasibleError, NotCertifiedError):
            return False, None


def margin_of(graph: Graph, maps: Array, matrices: Array, rate: float) -> float:
    """The smallest eigenvalue of all inequalities for given matrices.

    Parameters
    ----------
    graph, maps
        As for `feasible`.
    matrices
        N x n x n.
    rate
        Decay a sample.
    """
    source, target, leave, enter = edge_indices(graph)
    moved = np.swapaxes(maps, 1, 2) @ matrices[target] @ maps
    every = [matrices, rate**2 * matrices[source] - moved, matrices[leave] - matrices[enter]]
    return min(float(np.linalg.eigvalsh(one).min()) for one in every if len(one))


def _inequalities(graph: Graph, maps: Array, rate: float, above: Array | float = 0.0) -> tuple[LmiProblem, Any]:
    size, identity = maps.shape[-1], np.eye(maps.shape[-1])
    source, target, leave, enter = edge_indices(graph)
    problem = LmiProblem()
    unknown = problem.symmetric(graph.nodes, size)
    problem.blocks(graph.nodes, size, -above).congruence(unknown, np.arange(graph.nodes), identity)
    edges = problem.blocks(len(source), size, -above).congruence(unknown, source, identity, rate**2)
    edges.congruence(unknown, target, maps, -1.0)
    if len(leave):
        jumps = problem.blocks(len(leave), size, -above).congruence(unknown, leave, identity)
        jumps.congruence(unknown, enter, identity, -1.0)
    return problem, unknown
