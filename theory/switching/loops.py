"""Closed loops along a graph: whether system, language and gains fit, maps of the edges, coordinates."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import linalg

from theory.arrays import Array
from theory.errors import IllPosedError
from theory.switching.graph import Graph
from theory.switching.language import Language
from theory.switching.system import Gains, SwitchedSystem


def check_fit(system: SwitchedSystem, language: Language, gains: Gains | None) -> None:
    """Raise unless language, modes and gains belong together."""
    if language.modes != system.modes:
        raise IllPosedError("modes", f"the constraint has {language.modes}, the system {system.modes}")
    if gains is not None:
        system.need("B", "a gain")
        inputs = (len(system.exact[0]["B"][0]), system.size)
        for (mode, clock), rows in gains.exact.items():
            if (len(rows), len(rows[0])) != inputs:
                sizes = f"is {len(rows)} x {len(rows[0])}, has to be {inputs[0]} x {inputs[1]}"
                raise IllPosedError(f"K of mode {mode}, clock {clock}", sizes)
    for label in {label: None for leaving in language.automaton.transitions for label in leaving}:
        if isinstance(label, int) and gains is not None:
            raise IllPosedError("gains", "letters of the constraint tell no clock; use language.clocked(...)")
        if isinstance(label, tuple) and (gains is None or label[1:] not in gains.exact):
            raise IllPosedError("gains", f"no gain for mode {label[1]} at clock {label[2]}")


def closed_loops(system: SwitchedSystem, graph: Graph, gains: Gains | None, names: str = "AB") -> Array:
    """The closed loop of every edge: edges x rows x n."""
    made = {label: system.loop(label, gains, names) for label in graph.labels}
    return np.array([made[label] for _, label, _ in graph.edges])


def edge_indices(graph: Graph) -> tuple[Any, Any, Any, Any]:
    """Sources and targets of the edges, sources and targets of the jumps, as arrays."""
    edges = np.array([(u, v) for u, _, v in graph.edges]).reshape(-1, 2)
    jumps = np.array(graph.jumps, dtype=int).reshape(-1, 2)
    return edges[:, 0], edges[:, 1], jumps[:, 0], jumps[:, 1]


def coordinates(matrices: Array) -> Array:
    """T_u for each node with T' L T = I: in x = T z, a second solution is well conditioned.

    Parameters
    ----------
    matrices
        N x n x n, symmetric, positive definite: a Lyapunov matrix L a node.

    Returns
    -------
    Array
        N x n x n.
    """
    matrices = matrices / np.trace(matrices, axis1=1, axis2=2)[:, None, None]
    values, vectors = np.linalg.eigh(matrices)
    return vectors / np.sqrt(np.maximum(values, 1e-9))[:, None, :]


def balanced(maps: Array) -> tuple[Array, Array]:
    """Maps in coordinates x = T z whose entries are of like size, and T: diagonal, powers of two.

    Parameters
    ----------
    maps
        k x n x n.

    Returns
    -------
    tuple
        Balanced maps, k x n x n, and T, n x n.
    """
    _, (scale, _) = linalg.matrix_balance(np.abs(maps).sum(axis=0), permute=False, separate=True)
    turn = np.diag(scale)
    return np.linalg.inv(turn) @ maps @ turn, turn
