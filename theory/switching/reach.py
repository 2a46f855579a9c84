"""Reachable sets under bounded peak disturbances: Lemma 4.1, Theorems 4.3 and 4.4, and the tube of Theorem 4.5."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any

import numpy as np

from theory.arrays import Array
from theory.errors import IllPosedError, InfeasibleError, NotCertifiedError, SolverError
from theory.solvers.lmi import LmiProblem, MatrixVariable, SymmetricVariable
from theory.switching.alpha import Alpha, rounded_alpha, search_alpha
from theory.switching.certificate import Certificate, Claim, round_and_verify
from theory.switching.coordinates import Coordinates, geometric_mean, gramian, root
from theory.switching.counterexamples import counterexample, slow_word_certificate, slowest_word
from theory.switching.far_words import farthest, proved_radius
from theory.switching.graph import Graph
from theory.switching.language import Language
from theory.switching.lift_search import SearchBudget
from theory.switching.loops import check_covers, check_fit, closed_loops, coordinates_of, edge_indices, labels_of
from theory.switching.periodic import Word
from theory.switching.representation import Representation
from theory.switching.synthesis import Design, Feedback, GainSchedule, add_jump_inequalities, read_gains, with_clock
from theory.switching.system import Gains, SwitchedSystem, closed_by, exact_number, mode_of, rounded_up

SLACKS = (1e-6, 1e-5, 1e-4, 1e-3)
"""Relative excesses of radius^2 over the optimum while the margin is maximised."""

ETA_MIN = 1e-6
"""Smallest 1 / radius^2, in units of the ball expected: balls larger than a thousand times that are a solver's zero."""

NOTHING = "is zero in every mode: nothing but 0 is reached"

PASSES = 2
"""Changes of coordinates by Gramians."""

BALLWARD = 0.75
"""Share of the way from what a ball needs to what is reached, at which the coordinates are taken."""


def certify(
    system: SwitchedSystem,
    language: Language,
    *,
    peak: Any = 1,
    gains: Gains | None = None,
    alpha: Alpha | Sequence[float] = "mode",
    representation: Representation | None = None,
    progress: Callable[[str], None] | None = None,
) -> Certificate:
    """A certificate of the smallest ball, and the tube in it, that hold e+ = G e + E w from e = 0 (Theorem 4.3).

    Parameters
    ----------
    system
        With E.
    language
        Signals for which the ball is claimed.
    peak
        Bound of |w(k)|, in the units of w.
    gains
        Of the closed loop, for letters with a gain and a clock.
    alpha
        How the contraction of Lemma 4.1 is searched, or one given number a mode.
    representation
        Graph and lift.
    progress
        Receives the search's state in words.

    Raises
    ------
    NotCertifiedError
        No bounded set at this lift.
    """
    system = closed_by(system, gains)
    check_fit(system, language, gains)
    system.need("E", "a reachable set")
    bound = _peak(peak)
    representation, clock = representation or Representation(), SearchBudget(0.0, progress)
    graph = representation.graph(language)
    check_covers(graph, language)
    slow = slowest_word(system, language, gains=gains)
    unstable = slow_word_certificate(system, language, Fraction(1), gains, slow)
    if unstable is not None:
        raise NotCertifiedError(f"no set is bounded: {unstable.verdict.claim}", unstable)
    problem = _Problem.of(Claim("reach", Fraction(1), system, language, gains, bound), graph, slow)
    best, chosen = search_alpha(problem.square, system.modes, alpha, progress, problem.unit)
    if not math.isfinite(best):
        if problem.failures:
            raise problem.failures[-1]
        found = counterexample(system, language, Fraction(1), gains, graph)
        raise NotCertifiedError("no bounded reachable set was found at this lift; a larger one may do", found)
    return problem.certificate(chosen, representation, clock)


@dataclass(frozen=True)
class _Problem:
    """A ball asked for, in coordinates and units in which it is near 1 and the matrices near I."""

    claim: Claim
    graph: Graph
    turn: Coordinates
    unit: float
    """The radius expected."""
    slow: tuple[float, Word]
    """The slowest word: where alpha does not exceed its decay squared, on the mean along it, there is no ball."""
    failures: list[SolverError] = field(default_factory=list)

    @classmethod
    def of(cls, claim: Claim, graph: Graph, slow: tuple[float, Word]) -> _Problem:
        """Coordinates between what is reached and what a ball needs, at the alpha that a slow word suggests."""
        system, gains, peak = claim.system, claim.gains, float(claim.peak)
        turn, labels = coordinates_of(system, claim.language, gains), labels_of(claim.language)
        drives = [system.exact_drive(label, gains) for label in labels]
        if not any(item for drive in drives for row in drive for item in row):
            raise IllPosedError("E", NOTHING)
        share = min(max(slow[0], 0.1), 1 - 1e-9)
        unit = 1.0
        for _ in range(PASSES):
            maps = np.array([turn.loop(system.exact_loop(label, gains)) for label in labels])
            pushed = np.array([turn.drive(drive) for drive in drives]) * peak
            reached = gramian(maps, (pushed @ np.swapaxes(pushed, 1, 2)).mean(axis=0) / (1 - share), share)
            unit = float(np.sqrt(np.linalg.norm(turn.back @ reached @ turn.back.T, 2)))
            ball = turn.back.T @ turn.back / unit**2
            needed = gramian(np.swapaxes(maps, 1, 2), ball, share)
            shape = geometric_mean(needed, np.asarray(np.linalg.inv(reached), float), BALLWARD)
            turn = turn.followed_by(root(shape))
        pieces = {label: (turn.loop(system.exact_loop(label, gains)), turn.drive(drive) * peak / unit)
                  for label, drive in zip(labels, drives, strict=True)}  # fmt: skip
        far = farthest(pieces, turn.back, claim.language)
        below = proved_radius(system, claim.language, gains, claim.peak, (far[0] * unit / peak, *far[1:]))
        return cls(replace(claim, at_least=below), graph, turn, unit, slow)

    def square(self, alpha: Array) -> float:
        """The smallest radius^2 = 1 / eta, in units, with O_u > eta I at given alpha; infinite if there is none."""
        rate, word = self.slow
        if word and rate**2 >= np.exp(np.mean(np.log([alpha[mode_of(label) - 1] for label in word]))):
            return math.inf
        problem, unknown, eta = self._inequalities(alpha)
        ball = self.turn.back.T @ self.turn.back / self.unit**2
        every = problem.blocks(self.graph.nodes, self.turn.size)
        every.congruence(unknown, np.arange(self.graph.nodes), np.eye(self.turn.size)).scalar(eta, -ball)
        try:
            value = float(problem.minimize({eta: -1.0}, "reachable set").values[eta])
        except InfeasibleError:
            return math.inf
        except SolverError as error:
            self.failures.append(error)
            return math.inf
        return 1 / value if value > ETA_MIN else math.inf

    def certificate(self, chosen: Array, representation: Representation, clock: SearchBudget) -> Certificate:
        """The certificate next to the smallest ball at an alpha."""
        best = math.inf
        for digits in (6, 4, 3, 2):
            exact = rounded_alpha(chosen, digits)
            best = self.square(np.array([float(value) for value in exact]))
            if math.isfinite(best):
                break
        failure: Exception = NotCertifiedError("the rounded alpha gives no set")
        about = {"theorem": "4.3", **representation.as_document(self.graph), "solve_s": clock.spent}
        for slack in SLACKS if math.isfinite(best) else ():
            radius = rounded_up(self.unit * math.sqrt(best * (1 + slack)))
            try:
                matrices, margin = self._margin(exact, float(radius))
                claim = replace(self.claim, value=radius, alpha=exact)
                return round_and_verify(claim, self.graph, matrices, margin, about, turn=self.turn)
            except (SolverError, NotCertifiedError) as error:
                failure = error
        raise NotCertifiedError(f"radius {self.unit * math.sqrt(best):.7g}: {failure}") from failure

    def _inequalities(self, alpha: Array) -> tuple[LmiProblem, SymmetricVariable, int]:
        """-(4.39) by a Schur complement: [a O_u, 0; 0, (1-a) I] - [G E]' O_v [G E] > 0, over 1 - a, and (4.40).

        The disturbance is measured in its peak.
        """
        system, gains, graph = self.claim.system, self.claim.gains, self.graph
        maps = closed_loops(system, graph, gains, self.turn)
        modes = [mode_of(label) for _, label, _ in graph.edges]
        pushed = {label: self.turn.drive(system.exact_drive(label, gains)) for label in graph.labels}
        drive = np.array([pushed[label] for _, label, _ in graph.edges]) * float(self.claim.peak)
        n, width = system.size, system.size + drive.shape[-1]
        share = alpha[np.array(modes) - 1]
        source, target, leave, enter = edge_indices(graph)
        problem = LmiProblem()
        unknown, number = problem.symmetric(graph.nodes, n), problem.number()
        edges = problem.blocks(len(source), width, np.diag([0.0] * n + [1.0] * (width - n)))
        edges.congruence(unknown, source, np.eye(width)[:n], share / (1 - share))
        edges.congruence(unknown, target, np.concatenate([maps, drive], axis=2), -1.0 / (1 - share))
        if len(leave):
            jumps = problem.blocks(len(leave), n).congruence(unknown, leave, np.eye(n))
            jumps.congruence(unknown, enter, np.eye(n), -1.0)
        return problem, unknown, number

    def _margin(self, alpha: Sequence[Fraction], radius: float) -> tuple[Array, float]:
        """Matrices of the largest margin at a fixed radius, and a lower bound of that margin in z and w."""
        values = np.array([float(item) for item in alpha])
        problem, unknown, margin = self._inequalities(values)
        ball = self.turn.back.T @ self.turn.back / radius**2
        problem.blocks(self.graph.nodes, self.turn.size, -ball).congruence(
            unknown, np.arange(self.graph.nodes), np.eye(self.turn.size)
        )
        for blocks in problem.every:
            blocks.scalar(margin, -np.eye(blocks.size))
        solution = problem.minimize({margin: -1.0}, "reachable set")
        kept = float((1 - values).min()) * min(1.0, float(self.claim.peak) ** -2)
        return unknown.of(solution.values), float(solution.values[margin]) * kept


def minimize(
    system: SwitchedSystem,
    language: Language,
    *,
    peak: Any = 1,
    schedule: GainSchedule = "clock",
    symmetric: bool = False,
    alpha: Alpha | Sequence[float] = "mode",
    representation: Representation | None = None,
    progress: Callable[[str], None] | None = None,
) -> Design:
    """Gains of the smallest ball around the reachable set (Theorem 4.4 with (4.50)-(4.51)), then Theorem 4.3 on it.

    Parameters as in `certify` and `synthesis.stabilize`; `Design.bound` is the radius sqrt(eps) of (4.51).

    Raises
    ------
    NotCertifiedError
        No gains by these inequalities at this lift.
    """
    system.need("BE", "a synthesis of a reachable set")
    bound = float(_peak(peak))
    language = with_clock(language)
    representation = representation or Representation()
    started = time.perf_counter()
    graph = representation.graph(language)

    def square(values: Array) -> float:
        problem, _, _, size = _ball_inequalities(system, graph, schedule, bound, values, symmetric=symmetric)
        try:
            return float(problem.minimize({size: 1.0}, "reachable set").values[size])
        except SolverError:
            return math.inf

    unit = one_step_reach(system, bound)
    best, chosen = search_alpha(square, system.modes, alpha, progress, unit)
    if not math.isfinite(best):
        raise NotCertifiedError("no gains by these inequalities at this lift; a larger one may do")
    gains = _gains(system, graph, schedule, bound, chosen, best, symmetric=symmetric)
    certificate = certify(system, language, peak=peak, gains=gains, representation=representation, progress=progress,
                          alpha=alpha if isinstance(alpha, str) else "mode")  # fmt: skip
    return Design(gains, unit * math.sqrt(best), certificate, time.perf_counter() - started)


def _ball_inequalities(
    system: SwitchedSystem, graph: Graph, schedule: GainSchedule, peak: float, alpha: Array, *, symmetric: bool,
    limit: float | None = None, growth: float = 1.0,
) -> tuple[LmiProblem, SymmetricVariable | MatrixVariable, MatrixVariable, int]:  # fmt: skip
    """-(4.43), -(4.44) and Q < eps I (4.50); the last unknown is eps, or free for a margin where eps is given.

    In units of `one_step_reach`, as `_loop_inequalities`.

    The blocks' order is e+, e, w: [Q_v, -(A W + B U), -E; ., a (W + W' - Q_u), 0; ., ., (1-a)/w^2 I].
    """
    n, noises = system.size, system.floats[0]["E"].shape[1]
    select = np.eye(2 * n + noises)
    ahead, here, noise = select[:n], select[n : 2 * n], select[2 * n :]
    problem, feedback = LmiProblem(), Feedback(graph, schedule)
    unknown = problem.symmetric(graph.nodes, n)
    slacks, inputs, last = feedback.unknowns(problem, system, symmetric=symmetric)
    source, target, leave, enter = edge_indices(graph)
    numbers = [mode_of(label) - 1 for _, label, _ in graph.edges]
    share = alpha[np.array(numbers)]
    modes = [system.floats[number] for number in numbers]
    unit = peak / one_step_reach(system, peak)
    cross = np.array([-ahead.T @ mode["E"] @ noise * unit for mode in modes])
    constant = cross + np.swapaxes(cross, 1, 2) + (1 - share)[:, None, None] * (noise.T @ noise)
    edges = problem.blocks(len(source), len(select), constant)
    edges.congruence(unknown, target, ahead).congruence(unknown, source, here, -share)
    through = [a * here.T - ahead.T @ mode["A"] for a, mode in zip(share, modes, strict=True)]
    feedback.close(edges, slacks, inputs, here, through, [-ahead.T @ mode["B"] for mode in modes])
    add_jump_inequalities(problem, unknown, leave, enter, growth)
    identity = np.eye(n)
    ball = problem.blocks(graph.nodes, n, 0.0 if limit is None else limit * identity)
    ball.congruence(unknown, np.arange(graph.nodes), identity, -1.0)
    if limit is None:
        ball.scalar(last, identity)
    return problem, slacks, inputs, last


def one_step_reach(system: SwitchedSystem, peak: float) -> float:
    """The length that a disturbance at its peak reaches in one step, in whose units sets are computed."""
    length = peak * max(float(np.linalg.norm(mode["E"], 2)) for mode in system.floats)
    if length == 0:
        raise IllPosedError("E", NOTHING)
    return length


def weighted_ball(system: SwitchedSystem, graph: Graph, *, alpha: float, growth: float, peak: float) -> float:
    """The smallest eps of (4.51) with a growth of V along jumps."""
    problem, _, _, size = _ball_inequalities(
        system, graph, "clock", peak, np.full(system.modes, alpha), symmetric=False, growth=growth
    )
    return (
        float(problem.minimize({size: 1.0}, "weighted reachable set").values[size]) * one_step_reach(system, peak) ** 2
    )


def _gains(
    system: SwitchedSystem,
    graph: Graph,
    schedule: GainSchedule,
    peak: float,
    alpha: Array,
    best: float,
    *,
    symmetric: bool,
) -> Gains:
    """Gains at the best alpha, read off where the inequalities have a margin if they have one."""
    problem, slacks, inputs, last = _ball_inequalities(
        system, graph, schedule, peak, alpha, symmetric=symmetric, limit=best * (1 + 1e-7)
    )
    for blocks in problem.every:
        blocks.scalar(last, -np.eye(blocks.size))
    try:
        solution = problem.minimize({last: -1.0}, "reachable set")
    except SolverError:
        problem, slacks, inputs, last = _ball_inequalities(system, graph, schedule, peak, alpha, symmetric=symmetric)
        solution = problem.minimize({last: 1.0}, "reachable set")
    return read_gains(graph, schedule, slacks.of(solution.values), inputs.of(solution.values))


def _peak(peak: Any) -> Fraction:
    value = exact_number(peak, "peak")
    if value <= 0:
        raise IllPosedError("peak", f"{float(value):g} is not positive")
    return value
