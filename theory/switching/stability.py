"""Stability under every admissible signal: Theorems 3.1 and 4.1, decay rates from both sides, smallest dwell times."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np

from theory.arrays import Array
from theory.errors import IllPosedError, InfeasibleError, NotCertifiedError, SolverError
from theory.switching.certificate import Certificate, Claim, round_and_verify
from theory.switching.coordinates import Coordinates, root
from theory.switching.counterexamples import counterexample, slow_word_certificate, slowest_word
from theory.switching.descent import descended
from theory.switching.graph import Graph
from theory.switching.language import Language
from theory.switching.lift_search import BUDGET_S, GAP, SearchBudget, check_gap, lifts
from theory.switching.loops import check_covers, check_fit, closed_loops, coordinates_of
from theory.switching.lyapunov import decides, descends, feasible, largest_margin, margin_of
from theory.switching.periodic import proved_rate
from theory.switching.representation import Representation
from theory.switching.system import Gains, SwitchedSystem, closed_by, exact_number, rounded_up

__all__ = ["certify", "counterexample", "decay_rate", "feasible", "slowest_word", "smallest"]

RATE_MAX = 1000.0

ROOMS = (0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 16.0, 64.0, 256.0, 1024.0, 4096.0, 16_384.0)
"""Distances of a claim above the limit found, in gaps: next to the limit no margin is left to round."""

CLOSE_ROOMS = (0.05, 0.1, 0.2, 0.4)
"""The same above a word's rate, where the limit is known to be near it."""

LOOK = 3
"""Halvings of the interval at a lift before a larger one is tried."""

HALVINGS = 80
"""Halvings of the interval at the last lift, at most."""

NOTHING = 1e-9
"""A rate below this part of the maps' size counts as none: it would be proved by matrices without bound alone."""

SKEWED = 1e4
"""Condition of the matrices found beyond which the coordinates are changed."""


def certify(
    system: SwitchedSystem,
    language: Language,
    *,
    rate: Any = 1,
    gains: Gains | None = None,
    representation: Representation | None = None,
    budget: float = 0.0,
) -> Certificate:
    """A certificate that every admissible signal decays faster than rate^k (Theorems 3.1 and 4.1, (3.6)-(3.7)).

    A periodic word that does not decay is looked for first: it costs nothing beside a semidefinite program.

    Parameters
    ----------
    system
        The modes' matrices.
    language
        Signals whose decay is claimed.
    rate
        Decay a sample; 1 asks for stability (GUES).
    gains
        For letters with a gain and a clock.
    representation
        Graph and lift.
    budget
        Seconds in which larger lifts are tried, if no lift is given.

    Raises
    ------
    NotCertifiedError
        Not at these lifts; its `counterexample` is a `Certificate` of an unstable periodic word or of the inequalities'
        infeasibility, where one was found.
    SolverError
        The solver failed: nothing is said of the claim.
    """
    value = exact_number(rate, "rate")
    if not 0 < value <= RATE_MAX:
        raise IllPosedError("rate", f"{float(value):g} is not within 0..{RATE_MAX:g}")
    system = closed_by(system, gains)
    check_fit(system, language, gains)
    representation, clock = representation or Representation(), SearchBudget(budget)
    slow = slow_word_certificate(system, language, value, gains, slowest_word(system, language, gains=gains))
    if slow is not None:
        raise NotCertifiedError(f"{_claim(value)} does not hold: {slow.verdict.claim}", slow)
    turn, claim = coordinates_of(system, language, gains), Claim("stability", value, system, language, gains)
    failure: Exception | None = None
    for chosen, graph in lifts(representation, language, clock):
        check_covers(graph, language)
        try:
            return _certified(claim, chosen, graph, turn, clock)
        except (SolverError, NotCertifiedError) as error:
            failure, last = error, (chosen, graph)
    found = counterexample(system, language, value, gains, last[1])
    if found is None and isinstance(failure, SolverError) and not isinstance(failure, InfeasibleError):
        raise failure
    raise NotCertifiedError(_why(value, last[0], found), found) from failure


def _certified(
    claim: Claim, chosen: Representation, graph: Graph, turn: Coordinates, clock: SearchBudget,
    undecided: SolverError | None = None,
) -> Certificate:  # fmt: skip
    """The certificate of a rate on a graph, with the largest margin there; what the solver left undecided is told."""
    maps, rate = closed_loops(claim.system, graph, claim.gains, turn), float(claim.value)
    about = {"theorem": "3.1 / 4.1", **chosen.as_document(graph)}
    if undecided is not None:
        about["undecided"] = str(undecided)
    plain = np.broadcast_to(np.eye(turn.size), (graph.nodes, turn.size, turn.size))
    margin = margin_of(graph, maps / rate, plain, 1.0)
    if len(graph.labels) > 1 or margin <= 0:  # else I is as good as any
        matrices, margin = largest_margin(graph, maps / rate, 1.0)
    else:
        matrices = plain
    about["solve_s"] = clock.spent
    return round_and_verify(claim, graph, matrices, margin * min(1.0, rate**2), about, turn=turn)


class _Search:
    """The interval of a decay rate: a word's rate below, the smallest rate that matrices prove above."""

    def __init__(self, claim: Claim, low: float, gap: float, clock: SearchBudget) -> None:
        self.claim, self.low, self.gap, self.clock = claim, low, gap, clock
        self.turn = coordinates_of(claim.system, claim.language, claim.gains)
        self.high = self.ground = 0.0
        self.best: tuple[Representation, Graph] | None = None
        self.failure: SolverError | None = None
        self._made: tuple[Graph, Coordinates, Array] | None = None

    def _maps(self, graph: Graph) -> Array:
        """The closed loop of every edge in the coordinates of the search; those of the last look are kept."""
        if self._made is None or self._made[0] is not graph or self._made[1] is not self.turn:
            self._made = graph, self.turn, closed_loops(self.claim.system, graph, self.claim.gains, self.turn)
        return self._made[2]

    @property
    def close(self) -> bool:
        """Whether the bounds are near enough, or there is next to nothing between them and 0."""
        return self.high - self.low <= self.gap * self.high or self.high <= NOTHING * self.ground

    def on(self, chosen: Representation, graph: Graph, halvings: int) -> None:
        """Look at a graph: whether it proves the rate of the word, else how small a rate it proves."""
        maps = self._maps(graph)
        if self.best is None:
            self.high = self.ground = 1.0000001 * max(float(np.linalg.norm(maps, 2, axis=(1, 2)).max()), 1e-30)
            self.best = (chosen, graph)
        target = self.low * (1 + self.gap / 2)
        if self.close or (0 < target < self.high and self._proves(graph, target)):
            self.high, self.best = (self.high, self.best) if self.close else (target, (chosen, graph))
            return
        refused = max(target, NOTHING * self.ground)
        if halvings == HALVINGS and descends(graph, maps):
            refused = self._descend(chosen, graph, refused)
        for _ in range(halvings):
            if self.high - refused <= self.gap / 8 * self.high:
                break
            middle = float(np.sqrt(refused * self.high)) if refused > self.high / 100 else self.high / 10
            if self._proves(graph, middle):
                self.high, self.best = middle, (chosen, graph)
            else:
                refused = middle
            self.clock.tell(f"decay rate between {self.low:.7g} and {self.high:.7g}")

    def _descend(self, chosen: Representation, graph: Graph, refused: float) -> float:
        """Lower the rate by matrices that prove ever smaller ones; a rate next to the last that is not proved.

        It is the one refused before where the limit is approached by matrices without bound.
        """
        found = descended(graph, self._maps(graph), self.gap / 8)
        if found is None:
            return refused
        if found[0] < self.high:
            self.high, self.best = found[0], (chosen, graph)
            self._skewed(found[1])
            self.clock.tell(f"decay rate between {self.low:.7g} and {self.high:.7g}")
        step = self.gap / 9
        while (rate := self.high * (1 - step)) > refused:
            if not self._proves(graph, rate):
                return rate
            self.high, self.best, step = rate, (chosen, graph), min(4 * step, 0.5)
        return refused

    def _proves(self, graph: Graph, rate: float) -> bool:
        """Whether matrices prove a rate; badly conditioned ones give the coordinates of the next look."""
        try:
            yes, found = decides(graph, self._maps(graph) / rate, 1.0)
        except SolverError as error:
            self.failure = error
            return False
        if found is not None:
            self._skewed(found)
        return yes

    def _skewed(self, found: Array) -> None:
        """Change the coordinates where matrices are badly conditioned."""
        mean = (found / np.trace(found, axis1=1, axis2=2)[:, None, None]).mean(axis=0)
        if np.linalg.cond(mean) > SKEWED:
            self.turn = self.turn.followed_by(root(mean / np.linalg.norm(mean, 2)))


def decay_rate(
    system: SwitchedSystem,
    language: Language,
    *,
    gains: Gains | None = None,
    representation: Representation | None = None,
    gap: float = GAP,
    budget: float = BUDGET_S,
    progress: Callable[[str], None] | None = None,
) -> Certificate:
    """The smallest decay rate that can be certified, and the rate of a periodic word beside it, which none is below.

    Without a lift given, it is raised until both meet or the time is over; with one, the rate is that lift's.

    Parameters
    ----------
    system
        The modes' matrices.
    language
        Signals whose decay is claimed.
    gains
        For letters with a gain and a clock.
    representation
        Graph and lift.
    gap
        Relative distance of the bounds that is small enough; a lift's rate is found to a fraction of it.
    budget
        Seconds after which the lift is raised no more.
    progress
        Receives the bounds of the rate in words.

    Raises
    ------
    SolverError, NotCertifiedError
        The solver failed, or no rounding of its matrices passes the exact check: nothing is claimed.
    """
    system = closed_by(system, gains)
    check_fit(system, language, gains)
    check_gap(gap, budget)
    representation, clock = representation or Representation(), SearchBudget(budget, progress)
    below = proved_rate(system, language, gains, slowest_word(system, language, gains=gains))
    claim = Claim("stability", Fraction(1), system, language, gains, at_least=below)
    search = _Search(claim, 0.0 if below is None else float(below.value), gap, clock)
    for chosen, graph in lifts(representation, language, clock):
        check_covers(graph, language)
        search.on(chosen, graph, HALVINGS if representation.lift is not None else LOOK)
        if search.close:
            break
    if search.best is None:
        raise IllPosedError("representation", "has no graph")
    if not search.close and representation.lift is None:
        search.on(*search.best, HALVINGS)
    return _at_the_limit(search)


def _at_the_limit(search: _Search) -> Certificate:
    """The certificate next to the smallest rate found."""
    failure: Exception = NotCertifiedError("no rate was certified")
    if search.best is None:
        raise failure
    above_word = [search.low * (1 + room * search.gap) for room in CLOSE_ROOMS] if search.close and search.low else []
    for rate in (*above_word, *(search.high * (1 + room * search.gap) for room in ROOMS)):
        value = rounded_up(rate)
        try:
            undecided = None if search.close else search.failure
            return _certified(replace(search.claim, value=value), *search.best, search.turn, search.clock, undecided)
        except (NotCertifiedError, SolverError) as error:
            failure = error
    raise failure


def smallest(question: Callable[[int], Certificate], *, low: int = 1, high: int = 64) -> tuple[int, Certificate]:
    """The smallest whole number (a dwell time) for which a question is answered by a certificate.

    Doubles until one is found, then bisects: a certificate for a dwell time holds for longer ones too.

    Parameters
    ----------
    question
        The certificate for a number; raises `NotCertifiedError` where there is none.
    low, high
        The range of the search.

    Raises
    ------
    NotCertifiedError
        None up to `high`; the error carries the last counterexample.
    """
    if not 1 <= low <= high:
        raise IllPosedError("low", f"1 <= {low} <= {high} does not hold")
    failed, number, found = low - 1, low, None
    while found is None:
        try:
            found = question(number)
        except NotCertifiedError as error:
            if number >= high:
                raise NotCertifiedError(f"not certified up to {high}: {error}", error.counterexample) from error
            failed, number = number, min(2 * number, high)
    best = number
    while best - failed > 1:
        middle = (failed + best) // 2
        try:
            best, found = middle, question(middle)
        except NotCertifiedError:
            failed = middle
    return best, found


def _claim(rate: Fraction) -> str:
    return "stability" if rate == 1 else f"a decay rate of {float(rate):g}"


def _why(rate: Fraction, representation: Representation, found: Certificate | None) -> str:
    lift = f"{representation.kind}, lift {representation.first}"
    if found is None:
        return f"{_claim(rate)} is not certified at this lift ({lift}); a larger one may do"
    if found.kind == "unstable":
        return f"{_claim(rate)} does not hold: {found.verdict.claim}"
    return (
        f"{_claim(rate)} is not certified at this lift ({lift}), and cannot be: {found.verdict.claim}; "
        "a larger one may do"
    )
