"""Lifts raised one after the other until a bound is near enough to the one from below, or the time is over."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace

from theory.errors import IllPosedError, TooLargeError
from theory.switching.graph import LIFT_MAX, Graph
from theory.switching.language import Language
from theory.switching.representation import Representation

GAP = 1e-6
"""Relative distance of the bounds that is small enough unless said."""

BUDGET_S = 10.0
"""Seconds in which lifts are raised unless said."""

BUDGET_MAX_S = 86_400.0

GROWTH = 1.3
"""Time grows as this power of the number of inequalities, at least: what a larger lift will take is foreseen."""


FINISH = 3.0
"""What a look at a lift takes, with the search for its value after it, in units of the look."""


class SearchBudget:
    """The time since a question was asked, its limit, and who is told about the search."""

    def __init__(self, budget: float, progress: Callable[[str], None] | None = None) -> None:
        self._started, self._budget, self._progress = time.perf_counter(), budget, progress

    @property
    def spent(self) -> float:
        """Seconds so far."""
        return round(time.perf_counter() - self._started, 4)

    @property
    def left(self) -> float:
        """Seconds left, at least 0."""
        return max(0.0, self._budget - (time.perf_counter() - self._started))

    def tell(self, words: str) -> None:
        """Pass the state of the search on."""
        if self._progress is not None:
            self._progress(words)


def check_gap(gap: float, budget: float) -> None:
    """Raise `IllPosedError` unless a gap and a budget lie within their limits."""
    if not 1e-9 <= gap < 1:
        raise IllPosedError("gap", f"{gap!r} is not within 1e-9..1")
    if not 0 <= budget <= BUDGET_MAX_S:
        raise IllPosedError("budget", f"{budget!r} is not within 0..{BUDGET_MAX_S:g} s")


def lifts(
    representation: Representation, language: Language, clock: SearchBudget
) -> Iterator[tuple[Representation, Graph]]:
    """The given lift alone or, where none is given, every lift from the smallest on for which there will be time.

    Parameters
    ----------
    representation
        The kind of graph, and its lift if one is wanted.
    language
        The signals.
    clock
        Whose time is spent.

    Yields
    ------
    tuple
        The representation with its lift, and the graph.

    Raises
    ------
    TooLargeError
        Even the first graph is too large.
    """
    first = representation.first
    graph = replace(representation, lift=first).graph(language)
    began = clock.spent
    yield replace(representation, lift=first), graph
    if representation.lift is not None:
        return
    for lift in range(first + 1, LIFT_MAX + 1):
        chosen, before = replace(representation, lift=lift), graph
        took = clock.spent - began
        try:
            graph = chosen.graph(language)
        except TooLargeError:
            return
        share = graph.inequalities / before.inequalities
        if share <= 1 or took * share**GROWTH * FINISH >= clock.left:
            return
        clock.tell(f"lift {lift}")
        began = clock.spent
        yield chosen, graph
