"""The l2 gain under every admissible signal: Theorem 3.2, and lower bounds from periodic words."""

from __future__ import annotations

import itertools
import time
from contextlib import suppress

import numpy as np
from scipy import optimize

from theory.arrays import Array
from theory.checker import Label
from theory.errors import IllPosedError, InfeasibleError, NotCertifiedError, SolverError
from theory.solvers.lmi import LmiProblem, SymmetricVariable
from theory.switching.certificate import Certificate, Claim, round_and_verify, rounded_up
from theory.switching.graph import Graph
from theory.switching.language import Language
from theory.switching.loops import balanced, check_fit, closed_loops, coordinates, edge_indices
from theory.switching.representation import Representation
from theory.switching.stability import WALKS_MAX, counterexample
from theory.switching.system import Gains, SwitchedSystem, mode_of

SLACKS = (1e-6, 1e-5, 1e-4, 1e-3)
"""Relative excesses of gamma^2 over the optimum while the margin is maximised; the first that passes is kept."""

FREQUENCIES = 181

SQUARE_MIN = 1e-6
"""Smallest gamma^2 that is certified, in units of `scales`: a smaller one would leave no margin."""

SQUARE_MAX = 1e12
"""Largest gamma^2 that is searched, in units of `scales`."""


def certify(
    system: SwitchedSystem,
    language: Language,
    *,
    gains: Gains | None = None,
    representation: Representation | None = None,
) -> Certificate:
    """A certificate of the smallest l2 gain from w to y that this representation and lift prove (Theorem 3.2).

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

    Raises
    ------
    NotCertifiedError
        No gain is finite at this lift; its `counterexample` may be an unstable word or multipliers.
    """
    check_fit(system, language, gains)
    system.need("CEF", "an l2 gain")
    representation = representation or Representation()
    started = time.perf_counter()
    graph = representation.graph(language)
    try:
        optimum, turns = _optimum(system, graph, gains)
    except InfeasibleError as error:
        found = counterexample(system, language, rounded_up(1.0), gains, graph)
        raise NotCertifiedError(f"no finite l2 gain at this lift: {error}", found) from error
    failure: Exception = NotCertifiedError("the l2 gain is zero")
    drive, seen = scales(system, graph, gains)
    unit, optimum = drive * seen, max(optimum, SQUARE_MIN)
    for slack, turn in itertools.product(SLACKS, turns):
        gamma = rounded_up(unit * float(np.sqrt(optimum * (1 + slack))))
        try:
            matrices, margin = _margin(system, graph, gains, (float(gamma) / unit) ** 2, turn)
            matrices, margin = seen**2 * matrices, seen**2 * min(1.0, drive**2) * margin
            about = {"theorem": "3.2", **representation.as_document(graph), "optimum": unit * float(np.sqrt(optimum)),
                     "solve_s": round(time.perf_counter() - started, 4)}  # fmt: skip
            return round_and_verify(Claim("gain", gamma, system, language, gains), graph, matrices, margin, about)
        except (SolverError, NotCertifiedError) as error:
            failure = error
    raise NotCertifiedError(f"l2 gain {unit * np.sqrt(optimum):.7g}: {failure}") from failure


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
    system.need("CEF", "an l2 gain")
    if not word or not all(1 <= mode_of(label) <= system.modes for label in word):
        raise IllPosedError("word", f"{word!r:.60} needs letters with modes of 1..{system.modes}")
    pieces = [_pieces(system, label, gains) for label in word]
    n, q = system.size, pieces[0][1].shape[1]
    state, drive = np.eye(n), np.zeros((n, 0))
    seen, direct = np.zeros((0, n)), np.zeros((0, 0))
    for a, e, c, f in pieces:
        direct = np.block([[direct, np.zeros((direct.shape[0], q))], [c @ drive, f]])
        seen = np.vstack([seen, c @ state])
        drive, state = np.hstack([a @ drive, e]), a @ state
    if np.abs(np.linalg.eigvals(state)).max() >= 1:
        return float("inf")

    def at(angle: float) -> float:
        inner = np.linalg.solve(np.exp(1j * angle) * np.eye(n) - state, drive)
        return float(np.linalg.norm(seen @ inner + direct, 2))

    angles = np.linspace(0, np.pi, FREQUENCIES)
    values = [at(angle) for angle in angles]
    best = int(np.argmax(values))
    near = (angles[max(best - 1, 0)], angles[min(best + 1, FREQUENCIES - 1)])
    fine = optimize.minimize_scalar(lambda angle: -at(angle), bounds=near, method="bounded", options={"xatol": 1e-7})
    return max(values[best], -float(fine.fun))


def largest_gain_word(
    system: SwitchedSystem, language: Language, *, gains: Gains | None = None, longest: int = 8
) -> tuple[float, tuple[Label, ...]]:
    """The largest gain among periodic words up to a length: a lower bound of every certified gain, and its word."""
    words = language.periodic_words(longest, most=WALKS_MAX)
    return max(((word_gain(system, word, gains), word) for word in words), key=lambda pair: pair[0], default=(0.0, ()))


def _pieces(system: SwitchedSystem, label: Label, gains: Gains | None) -> tuple[Array, Array, Array, Array]:
    mode = system.floats[mode_of(label) - 1]
    return system.loop(label, gains), mode["E"], system.loop(label, gains, "CD"), mode["F"]


def _inequalities(
    system: SwitchedSystem, graph: Graph, gains: Gains | None, square: float | None, turn: Array
) -> tuple[LmiProblem, SymmetricVariable, int]:
    """L_u > 0, diag(L_u, g^2 I) - [G E]' L_v [G E] - [H F]' [H F] > 0, L_u - L_v > 0; g^2 unknown unless given.

    Written in coordinates x = T_u z of every node (`turn`), in which the unknowns are T' L T, and in units of `scales`.
    """
    pieces = {label: _pieces(system, label, gains) for label in graph.labels}
    a, e, c, f = (np.array([pieces[label][k] for _, label, _ in graph.edges]) for k in range(4))
    drive, seen = scales(system, graph, gains)
    e, c, f = e / drive, c / seen, f / (drive * seen)
    source, target, leave, enter = edge_indices(graph)
    back = np.linalg.inv(turn)
    loop = back[target] @ np.concatenate([a @ turn[source], e], axis=2)
    out = np.concatenate([c @ turn[source], f], axis=2)
    n, width = system.size, loop.shape[-1]
    on_state, on_noise = np.eye(width)[:n], np.diag([0.0] * n + [1.0] * (width - n))
    problem = LmiProblem()
    unknown, gamma = problem.symmetric(graph.nodes, n), problem.number()
    problem.blocks(graph.nodes, n).congruence(unknown, np.arange(graph.nodes), np.eye(n))
    edges = problem.blocks(len(source), width, (on_noise * square if square else 0.0) - np.swapaxes(out, 1, 2) @ out)
    edges.congruence(unknown, source, on_state).congruence(unknown, target, loop, -1.0)
    if square is None:
        edges.scalar(gamma, on_noise)
    if len(leave):
        jumps = problem.blocks(len(leave), n).congruence(unknown, leave, np.eye(n))
        jumps.congruence(unknown, enter, back[enter] @ turn[leave], -1.0)
    return problem, unknown, gamma


def scales(system: SwitchedSystem, graph: Graph, gains: Gains | None) -> tuple[float, float]:
    """Sizes of [E; F] and of [C F]: the inequalities are solved for w and y in units of these, the gain likewise."""
    pieces = [_pieces(system, label, gains) for label in graph.labels]
    drive = max(float(np.linalg.norm(np.vstack([e, f]))) for _, e, _, f in pieces)
    seen = max(float(np.linalg.norm(np.hstack([c, f / (drive or 1.0)]))) for _, _, c, f in pieces)
    return drive or 1.0, seen or 1.0


def _optimum(system: SwitchedSystem, graph: Graph, gains: Gains | None) -> tuple[float, list[Array]]:
    """The smallest gamma^2, and coordinates to try: x itself, and those in which the optimum's matrices are near I.

    Some infima are approached only by matrices that grow without bound, others by ones nearly singular.
    """
    _, turn = balanced(closed_loops(system, graph, gains))
    turns = [np.broadcast_to(turn, (graph.nodes, system.size, system.size))]
    problem, unknown, gamma = _inequalities(system, graph, gains, None, turns[0])
    try:
        solution = problem.minimize({gamma: 1.0}, "l2 gain")
    except InfeasibleError:
        raise
    except SolverError:
        return _bisected(system, graph, gains, turns[0]), turns
    value = float(solution.values[gamma])
    turns.append(turns[0] @ coordinates(unknown.of(solution.values)))
    problem, _, gamma = _inequalities(system, graph, gains, None, turns[1])
    with suppress(SolverError):
        value = min(value, float(problem.minimize({gamma: 1.0}, "l2 gain").values[gamma]))
    return value, turns


def _bisected(system: SwitchedSystem, graph: Graph, gains: Gains | None, turn: Array) -> float:
    """The smallest gamma^2 that leaves a margin, where the solver does not reach the infimum itself."""

    def holds(square: float) -> bool:
        try:
            return _margin(system, graph, gains, square, turn)[1] > 0
        except SolverError:
            return False

    low, high = 0.0, 1.0
    while not holds(high):
        low, high = high, 4 * high
        if high > SQUARE_MAX:
            raise InfeasibleError("no margin", f"l2 gain below {np.sqrt(SQUARE_MAX):g}")
    while high - low > 1e-4 * high:
        middle = (low + high) / 2
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high


def _margin(
    system: SwitchedSystem, graph: Graph, gains: Gains | None, square: float, turn: Array
) -> tuple[Array, float]:
    """Matrices of the largest margin at a fixed gamma^2, and a lower bound of that margin in x."""
    problem, unknown, margin = _inequalities(system, graph, gains, square, turn)
    for blocks in problem.every:
        blocks.scalar(margin, -np.eye(blocks.size))
    solution = problem.minimize({margin: -1.0}, "l2 gain")
    back = np.linalg.inv(turn)
    stretch = min(1.0, float(np.linalg.norm(turn, 2, axis=(1, 2)).max()) ** -2)
    return np.swapaxes(back, 1, 2) @ unknown.of(solution.values) @ back, float(solution.values[margin]) * stretch
