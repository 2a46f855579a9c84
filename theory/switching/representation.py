"""The graph that a theorem is written on: the automaton looked ahead, or the thesis's words lifted."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from theory.errors import IllPosedError
from theory.switching.graph import Graph
from theory.switching.language import Language


@dataclass(frozen=True)
class Representation:
    """The choice of a graph for a language, and its lift."""

    kind: str = "automaton"
    """`automaton`, or `words` for the thesis's words."""
    lift: int | None = None
    """Letters looked ahead (from 0), or the thesis's W or L (from 1); the smallest by default."""
    share_matrices: bool = False
    """Whether the two copies of a word with clocks share their matrices, as printed; of no effect on an automaton."""

    @property
    def first(self) -> int:
        """The lift, where one is given; else the smallest."""
        return (1 if self.kind == "words" else 0) if self.lift is None else self.lift

    @property
    def fixed(self) -> Representation:
        """The same with its lift given."""
        return replace(self, lift=self.first)

    def graph(self, language: Language) -> Graph:
        """The graph of a language."""
        if self.kind == "words":
            return language.words(self.first, share_matrices=self.share_matrices).graph()
        if self.kind != "automaton":
            raise IllPosedError("representation", f"{self.kind!r} is neither 'automaton' nor 'words'")
        return language.graph(self.first)

    def as_document(self, graph: Graph) -> dict[str, Any]:
        """Representation, lift and size of the graph, as a certificate's `about` holds them."""
        return {
            "representation": self.kind,
            "lift": self.first,
            "nodes": graph.nodes,
            "inequalities": graph.inequalities,
        }
