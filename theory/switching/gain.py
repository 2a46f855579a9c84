"""The l2 gain under every admissible signal: Theorem 3.2 above, periodic words below."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from theory.arrays import Array
from theory.checker import Label
from theory.errors import IllPosedError, InfeasibleError, NotCertifiedError, SolverError
from theory.solvers.lmi import LmiProblem, SymmetricVariable
from theory.switching import periodic
from theory.switching.certificate import Certificate, Claim, round_and_verify
from theory.switching.coordinates import NEAR, Coordinates, geometric_mean, gramian, root
from theory.switching.counterexamples import counterexample, slow_word_certificate, slowest_word
from theory.switching.graph import Graph
from theory.switching.language import Language
from theory.switching.lift_search import BUDGET_S, GAP, SearchBudget, check_gap, lifts
from theory.switching.loops import check_covers, check_fit, coordinates_of, edge_indices, labels_of
from theory.switching.periodic import Pieces
from theory.switching.representation import Representation
from theory.switching.system import Gains, SwitchedSystem, closed_by, mode_of, rounded_up

SLACKS = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3)
"""Relative excesses of gamma^2 over the optimum while the margin is maximised; the first that passes is kept."""

SQUARE_MIN = 1e-6
"""Smallest gamma^2 that is certified, in units of the problem's own: a smaller one would leave no margin."""

SQUARE_MAX = 1e12
"""Largest gamma^2 that is searched, in the same units."""

PASSES = 3
"""Changes of coordinates by Gramians, and by the matrices found."""

STRETCH_MAX = 1e3
"""Largest stretching of x beside w, for poles next to the unit circle."""


def certify(
    system: SwitchedSystem,
    language: Language,
    *,
    gains: Gains | None = None,
    representation: Representation | None = None,
    gap: float = GAP,
    budget: float = BUDGET_S,
    progress: Callable[[str], None] | None = None,
) -> Certificate:
    """The smallest l2 gain from w to y that can be certified (Theorem 3.2), and that of a periodic word beside it.

    Without a lift given, it is raised until both meet or the time is over; with one, the gain is that lift's.

    Parameters
    ----------
    system
        With C and E (F and D are zero where left out).
    language
        Signals for which the gain is claimed.
    gains
        Of the closed loop (3.15), for letters with a gain and a clock.
    representation
        Graph and lift.
    gap
        Relative distance of the bounds that is small enough.
    budget
        Seconds after which the lift is raised no more.
    progress
        Receives the bounds of the gain in words.

    Raises
    ------
    NotCertifiedError
        No gain is finite at this lift; its `counterexample` may be an unstable word or multipliers.
    SolverError
        The solver failed: nothing is said of the gain.
    """
    system = closed_by(system, gains)
    check_fit(system, language, gains)
    system.need("CEF", "an l2 gain")
    check_gap(gap, budget)
    representation, clock = representation or Representation(), SearchBudget(budget, progress)
    slow = slowest_word(system, language, gains=gains)
    unstable = slow_word_certificate(system, language, Fraction(1), gains, slow)
    if unstable is not None:
        raise NotCertifiedError(f"no l2 gain is finite: {unstable.verdict.claim}", unstable)
    problem = _Problem.of(system, language, gains, slow[0])
    low = 0.0 if problem.claim.at_least is None else float(problem.claim.at_least.value)
    best: tuple[float, Representation, Graph, list[Coordinates]] | None = None
    failure: SolverError | None = None
    for chosen, graph in lifts(representation, language, clock):
        check_covers(graph, language)
        try:
            square, turns = problem.optimum(graph)
        except SolverError as error:
            failure, last = error, graph
            continue
        problem = replace(problem, turn=turns[-1])  # the next lift's matrices will be like these
        if best is None or square < best[0] * (1 - gap):
            best = square, chosen, graph, turns
        high = problem.unit * float(np.sqrt(max(best[0], SQUARE_MIN)))
        clock.tell(f"l2 gain between {low:.7g} and {high:.7g}")
        if high <= low * (1 + gap):
            break
    if best is None:
        if isinstance(failure, InfeasibleError):
            found = counterexample(system, language, Fraction(1), gains, last)
            raise NotCertifiedError(f"no finite l2 gain at this lift: {failure}", found) from failure
        raise failure or NotCertifiedError("no graph")
    return problem.certificate(*best, clock)


@dataclass(frozen=True)
class _Problem:
    """A gain asked for, in coordinates and units in which it is near 1 and the matrices near I."""

    claim: Claim
    turn: Coordinates
    scale: float
    """A power of two: disturbances and outputs are measured in it."""
    stretch: float

    @property
    def unit(self) -> float:
        """The unit of the gain."""
        return self.scale**2

    @classmethod
    def of(cls, system: SwitchedSystem, language: Language, gains: Gains | None, slowest: float) -> _Problem:
        """Gramians balanced, the gain of a word for unit."""
        turn = coordinates_of(system, language, gains)
        labels, size = labels_of(language), 0.0
        for _ in range(PASSES):
            pieces = pieces_of(system, labels, gains, turn)
            maps, drives, outs = (np.array([pieces[label][k] for label in labels]) for k in range(3))
            reached = gramian(maps, (drives @ np.swapaxes(drives, 1, 2)).mean(axis=0))
            seen = gramian(np.swapaxes(maps, 1, 2), (np.swapaxes(outs, 1, 2) @ outs).mean(axis=0))
            size = float(np.sqrt(max(np.abs(np.linalg.eigvals(reached @ seen)).max(), 0.0)))
            if not (np.trace(reached) > 0 and np.trace(seen) > 0):
                break
            shape = geometric_mean(seen, np.asarray(np.linalg.inv(reached), float))
            turn = turn.followed_by(root(shape))
        pieces = pieces_of(system, labels, gains, turn)
        found = periodic.largest_gain(pieces, language)
        below = periodic.proved_gain(system, language, gains, pieces, found)
        direct = max(float(np.linalg.norm(piece[3], 2)) for piece in pieces.values())
        expected = float(below.value) if below is not None else size + direct or 1.0
        claim = Claim("gain", Fraction(1), system, language, gains, at_least=below)
        scale = 2.0 ** round(np.log2(expected) / 2)
        stretch = min(STRETCH_MAX, max(1.0, 2.0 ** round(-np.log2(max(1 - slowest**2, 1e-12)) / 2)))
        return cls(claim, turn, scale, stretch)

    def optimum(self, graph: Graph) -> tuple[float, list[Coordinates]]:
        """The smallest gamma^2 in units, and coordinates to try: those of the problem and of the matrices found.

        Some infima are approached only by matrices that grow without bound, others by ones nearly singular.
        """
        turns = [self.turn]
        problem, unknown, gamma = self._inequalities(graph, None, self.turn)
        try:
            solution = problem.minimize({gamma: 1.0}, "l2 gain")
        except InfeasibleError:
            raise
        except SolverError:
            return self._bisected(graph), turns
        value = float(solution.values[gamma])
        for _ in range(PASSES - 1):
            found = unknown.of(solution.values)
            mean = found.mean(axis=0) / np.linalg.norm(found.mean(axis=0), 2)
            if graph.nodes > 1 and np.linalg.cond(mean) < NEAR:
                break
            turns.append(turns[-1].followed_by(root(mean)))
            problem, unknown, gamma = self._inequalities(graph, None, turns[-1])
            before = value
            with suppress(SolverError):
                solution = problem.minimize({gamma: 1.0}, "l2 gain")
                value = min(value, float(solution.values[gamma]))
            if value > before * (1 - 1e-7):
                break
        return value, turns

    def certificate(
        self, square: float, chosen: Representation, graph: Graph, turns: list[Coordinates], clock: SearchBudget
    ) -> Certificate:
        """The certificate next to the smallest gain found."""
        failure: Exception = NotCertifiedError("the l2 gain is zero")
        optimum = max(square, SQUARE_MIN)
        for slack, turn in itertools.product(SLACKS, turns):
            gamma = rounded_up(self.unit * float(np.sqrt(optimum * (1 + slack))))
            try:
                matrices, margin = self._margin(graph, (float(gamma) / self.unit) ** 2, turn)
                about = {"theorem": "3.2", **chosen.as_document(graph),
                         "optimum": self.unit * float(np.sqrt(optimum)), "solve_s": clock.spent}  # fmt: skip
                return round_and_verify(
                    replace(self.claim, value=gamma), graph, matrices, margin, about, turn=turn.scaled(self.scale)
                )
            except (SolverError, NotCertifiedError) as error:
                failure = error
        raise NotCertifiedError(f"l2 gain {self.unit * np.sqrt(optimum):.7g}: {failure}") from failure

    def _inequalities(
        self, graph: Graph, square: float | None, turn: Coordinates
    ) -> tuple[LmiProblem, SymmetricVariable, int]:
        """L_u > 0, diag(L_u, g^2 I) - [G E]' L_v [G E] - [H F]' [H F] > 0, L_u - L_v > 0; g^2 unknown unless given.

        Written in z, in units of `scale`, the inequalities of edges for `stretch` z.
        """
        pieces = pieces_of(self.claim.system, graph.labels, self.claim.gains, turn)
        a, e, c, f = (np.array([pieces[label][k] for _, label, _ in graph.edges]) for k in range(4))
        e, c, f = e / self.scale, c / self.scale, f / self.unit
        source, target, leave, enter = edge_indices(graph)
        loop = np.concatenate([a * self.stretch, e], axis=2)
        out = np.concatenate([c * self.stretch, f], axis=2)
        n, width = turn.size, loop.shape[-1]
        on_state, on_noise = self.stretch * np.eye(width)[:n], np.diag([0.0] * n + [1.0] * (width - n))
        problem = LmiProblem()
        unknown, gamma = problem.symmetric(graph.nodes, n), problem.number()
        problem.blocks(graph.nodes, n).congruence(unknown, np.arange(graph.nodes), np.eye(n))
        edges = problem.blocks(
            len(source), width, (on_noise * square if square else 0.0) - np.swapaxes(out, 1, 2) @ out
        )
        edges.congruence(unknown, source, on_state).congruence(unknown, target, loop, -1.0)
        if square is None:
            edges.scalar(gamma, on_noise)
        if len(leave):
            jumps = problem.blocks(len(leave), n).congruence(unknown, leave, np.eye(n))
            jumps.congruence(unknown, enter, np.eye(n), -1.0)
        return problem, unknown, gamma

    def _bisected(self, graph: Graph) -> float:
        """The smallest gamma^2 that leaves a margin, where the solver does not reach the infimum itself."""
        failure: SolverError | None = None

        def holds(square: float) -> bool:
            nonlocal failure
            try:
                return self._margin(graph, square, self.turn)[1] > 0
            except SolverError as error:
                failure = error
                return False

        low, high = 0.0, 1.0
        while not holds(high):
            low, high = high, 4 * high
            if high > SQUARE_MAX:
                raise failure or InfeasibleError("no margin", f"l2 gain below {self.unit * np.sqrt(SQUARE_MAX):g}")
        while high - low > 1e-5 * high:
            middle = (low + high) / 2
            low, high = (low, middle) if holds(middle) else (middle, high)
        return high

    def _margin(self, graph: Graph, square: float, turn: Coordinates) -> tuple[Array, float]:
        """Matrices of the largest margin at a fixed gamma^2, and a lower bound of that margin in z and w."""
        problem, unknown, margin = self._inequalities(graph, square, turn)
        for blocks in problem.every:
            blocks.scalar(margin, -np.eye(blocks.size))
        solution = problem.minimize({margin: -1.0}, "l2 gain")
        kept = min(1.0, self.unit**2) / self.stretch**2
        return unknown.of(solution.values), float(solution.values[margin]) * kept


def pieces_of(
    system: SwitchedSystem, labels: Sequence[Label], gains: Gains | None, turn: Coordinates | None = None
) -> Pieces:
    """[G, E, H, F] of letters, in coordinates z = S x where some are given."""
    turn = turn or Coordinates(np.eye(system.size))
    return {
        label: (
            turn.loop(system.exact_loop(label, gains)),
            turn.drive(system.exact_drive(label, gains)),
            turn.output(system.exact_loop(label, gains, "CD")),
            np.array([[float(item) for item in row] for row in system.exact_drive(label, gains, "FD")]),
        )
        for label in labels
    }


def word_gain(system: SwitchedSystem, word: tuple[Label, ...], gains: Gains | None = None) -> float:
    """The l2 gain of the signal that repeats a word, from below: the largest singular value over frequencies.

    The loop over one period is time-invariant; the certified gain bounds it from above.

    Parameters
    ----------
    system
        With C and E (F and D are zero where left out).
    word
        The letters of one period.
    gains
        For letters with a gain and a clock.
    """
    system = closed_by(system, gains)
    system.need("CEF", "an l2 gain")
    if not word or not all(1 <= mode_of(label) <= system.modes for label in word):
        raise IllPosedError("word", f"{word!r:.60} needs letters with modes of 1..{system.modes}")
    pieces = pieces_of(system, list(dict.fromkeys(word)), gains)
    return periodic.refined_gain(pieces, word, periodic.coarse_gain(pieces, word))[0]


def largest_gain_word(
    system: SwitchedSystem, language: Language, *, gains: Gains | None = None, longest: int = 8
) -> tuple[float, tuple[Label, ...]]:
    """The largest gain among periodic words up to a length: a lower bound of every certified gain, and its word."""
    system = closed_by(system, gains)
    gain, word, _ = periodic.largest_gain(pieces_of(system, labels_of(language), gains), language, longest)
    return gain, word
