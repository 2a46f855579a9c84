"""Inequalities a strongly connected component at a time: matrices of one may be as large as those behind it ask for."""

from __future__ import annotations

from graphlib import TopologicalSorter

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from theory.arrays import Array
from theory.solvers.inequalities import Indices, Inequalities, factors, inverses, turned
from theory.solvers.margins import positive_margin
from theory.switching.graph import Graph
from theory.switching.loops import edge_indices


def solved(graph: Graph, maps: Array, start: Array, work: float = np.inf) -> Array:
    """Matrices that satisfy L_u - G' L_v G > 0 along every edge and L_u - L_v > 0 along every jump.

    Only nodes on a cycle ask for a program, those that can reach each other for one of their own. All others follow.

    Parameters
    ----------
    graph, maps
        As for `theory.switching.lyapunov.feasible`.
    start
        Positive definite matrices of the nodes, from which programs begin.
    work
        Products with a linear system's matrix after which it is given up (`theory.solvers.margins`).

    Returns
    -------
    Array
        N x n x n.

    Raises
    ------
    SolverError
        There are none (`InfeasibleError`), or a program does not decide with so little work.
    """
    size = maps.shape[-1]
    source, target, leave, enter = edge_indices(graph)
    source, target = np.concatenate([source, leave]), np.concatenate([target, enter])
    maps = np.concatenate([maps, np.broadcast_to(np.eye(size), (len(leave), size, size))])
    found = np.zeros((graph.nodes, size, size))
    component = _components(graph.nodes, source, target)
    inside = component[source] == component[target]
    for number in _last_first(component[source[~inside]], component[target[~inside]], int(component.max()) + 1):
        nodes = np.flatnonzero(component == number)
        own, on = inside & (component[source] == number), ~inside & (component[source] == number)
        place = np.searchsorted(nodes, source[on])
        asked = np.broadcast_to(np.eye(size), (len(nodes), size, size)).copy()
        np.add.at(asked, place, turned(maps[on]) @ found[target[on]] @ maps[on])
        if not own.any():
            found[nodes] = asked
            continue
        begin = start[nodes] * (len(nodes) * size / np.trace(start[nodes], axis1=1, axis2=2).sum())
        problem = Inequalities(
            len(nodes), np.searchsorted(nodes, source[own]), np.searchsorted(nodes, target[own]), maps[own]
        )
        margin = positive_margin(problem, begin, "stability", work=work)
        work -= margin.work
        found[nodes] = _ratio(asked, margin.matrices) * margin.matrices
    return found


def connected(graph: Graph) -> bool:
    """Whether every node can be reached from every other by edges.

    Parameters
    ----------
    graph
        Of edges and jumps.
    """
    source, target, _, _ = edge_indices(graph)
    return bool(_components(graph.nodes, source, target).max() == 0) and len(source) > 0


def _components(nodes: int, source: Indices, target: Indices) -> Indices:
    """The strongly connected component of every node."""
    links = sparse.csr_matrix((np.ones(len(source)), (source, target)), (nodes, nodes))
    component: Indices = connected_components(links, connection="strong")[1].astype(np.int64)
    return component


def _last_first(source: Indices, target: Indices, count: int) -> list[int]:
    """Components in an order in which each comes after all that it leads to."""
    after: dict[int, set[int]] = {number: set() for number in range(count)}
    for one, two in zip(source.tolist(), target.tolist(), strict=True):
        after[one].add(two)
    return list(TopologicalSorter(after).static_order())


def _ratio(above: Array, matrices: Array) -> float:
    """The smallest factor of the matrices that makes each at least as large as the one it is held against."""
    back = inverses(factors(matrices))
    return float(np.linalg.eigvalsh(back @ above @ turned(back)).max())
