"""The smallest decay rate along a graph, from above: matrices that prove ever smaller ones.

In coordinates in which the last matrices are I, those of the largest margin at the rate proved prove the next one:
Dinkelbach's method for ratios (doi 10.1287/mnsc.13.7.492). Near the limit rates fall faster than by any fixed factor,
where halving an interval takes as many programs as it has binary digits.
"""

from __future__ import annotations

import numpy as np

from theory.arrays import Array
from theory.errors import SolverError
from theory.solvers.inequalities import Inequalities, factors, inverses, turned
from theory.solvers.margins import positive_margin
from theory.switching.graph import Graph
from theory.switching.loops import edge_indices

ROUNDS = 30
"""Rates, at most."""

SHARE = 0.4
"""Part of the largest margin at a rate with which the next one is tried."""

CONDITION = 1e6
"""Condition of a matrix beyond which the limit counts as approached by matrices without bound."""


def descended(graph: Graph, maps: Array, near: float) -> tuple[float, Array] | None:
    """The smallest rate found, and the matrices that prove it; None where it is approached by matrices without bound.

    Parameters
    ----------
    graph
        Edges of the inequalities, along which every node is reached from every other; no jumps.
    maps
        The map of every edge, edges x n x n.
    near
        Relative distance to the limit at which it is near enough.

    Returns
    -------
    tuple
        Rate and matrices, N x n x n, or None.
    """
    source, target, _, _ = edge_indices(graph)
    found: Array = np.broadcast_to(np.eye(maps.shape[-1]), (graph.nodes, *maps.shape[1:]))
    rate = _proved(Inequalities(graph.nodes, source, target, maps), found)
    for _ in range(ROUNDS):
        if rate <= 0:
            return None
        problem = Inequalities(graph.nodes, source, target, maps / rate)
        try:
            margin = positive_margin(problem, found, "decay rate", share=SHARE)
            share = _proved(problem, margin.matrices)
        except (SolverError, np.linalg.LinAlgError):  # none is smaller, as far as floating point tells
            break
        if np.linalg.cond(margin.matrices).max() > CONDITION:
            return None
        if not share < 1:
            break
        size = float(np.trace(margin.matrices, axis1=1, axis2=2).mean()) / maps.shape[-1]
        rate, found = rate * share, margin.matrices / size
        if margin.bound <= near or share > 1 - near / 4:
            break
    return rate, found


def _proved(problem: Inequalities, matrices: Array) -> float:
    """The smallest rate that matrices prove."""
    back = inverses(factors(matrices))[problem.source]
    moved = back @ problem.turned @ matrices[problem.target] @ problem.maps @ turned(back)
    return float(np.sqrt(max(float(np.linalg.eigvalsh(moved).max()), 0.0)))
