"""Closed loops along a graph: whether system, language, gains and graph fit, maps of the edges, coordinates."""

from __future__ import annotations

from typing import Any

import numpy as np

from theory.arrays import Array
from theory.checker import Label, Refused, covered, rules
from theory.errors import IllPosedError, NotCertifiedError
from theory.switching.coordinates import Coordinates, of_maps
from theory.switching.graph import Graph
from theory.switching.language import Language
from theory.switching.system import Gains, SwitchedSystem


def check_fit(system: SwitchedSystem, language: Language, gains: Gains | None) -> None:
    """Raise unless language, modes and gains belong together."""
    if language.modes != system.modes:
        raise IllPosedError("modes", f"the constraint has {language.modes}, the system {system.modes}")
    if gains is not None:
        system.need("B", "a gain")
        inputs = (len(system.exact[0]["B"][0]), len(system.exact[0]["M"]) if system.has("M") else system.size)
        for (mode, clock), rows in gains.exact.items():
            if (len(rows), len(rows[0])) != inputs:
                sizes = f"is {len(rows)} x {len(rows[0])}, has to be {inputs[0]} x {inputs[1]}"
                raise IllPosedError(f"K of mode {mode}, clock {clock}", sizes)
    for label in labels_of(language):
        if isinstance(label, int) and gains is not None:
            raise IllPosedError("gains", "letters of the constraint tell no clock; use language.clocked(...)")
        if isinstance(label, tuple) and (gains is None or label[1:] not in gains.exact):
            raise IllPosedError("gains", f"no gain for mode {label[1]} at clock {label[2]}")


def closed_loops(system: SwitchedSystem, graph: Graph, gains: Gains | None, turn: Coordinates | None = None) -> Array:
    """The closed loop of every edge, edges x n x n; in coordinates z = S x where some are given."""
    made = {
        label: system.loop(label, gains) if turn is None else turn.loop(system.exact_loop(label, gains))
        for label in graph.labels
    }
    return np.array([made[label] for _, label, _ in graph.edges])


def labels_of(language: Language) -> list[Label]:
    """The letters of a language, each once."""
    return list({label: None for leaving in language.automaton.transitions for label in leaving})


def coordinates_of(system: SwitchedSystem, language: Language, gains: Gains | None) -> Coordinates:
    """Coordinates in which the closed loops of all letters are near contractions of their common growth."""
    return of_maps([system.exact_loop(label, gains) for label in labels_of(language)])


def check_covers(graph: Graph, language: Language) -> None:
    """Raise `NotCertifiedError` with the word if an admissible signal is no path of a graph: no matrices would do.

    A moment, where the matrices may take minutes.
    """
    try:
        covered(rules(language.constraint, language.modes), graph.nodes, [*graph.edges, *graph.jumps])
    except Refused as error:
        raise NotCertifiedError(f"the graph proves nothing: {error}") from error


def edge_indices(graph: Graph) -> tuple[Any, Any, Any, Any]:
    """Sources and targets of the edges, sources and targets of the jumps, as arrays."""
    edges = np.array([(u, v) for u, _, v in graph.edges]).reshape(-1, 2)
    jumps = np.array(graph.jumps, dtype=int).reshape(-1, 2)
    return edges[:, 0], edges[:, 1], jumps[:, 0], jumps[:, 1]
