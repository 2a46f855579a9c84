"""Observers of switched systems whose error is bounded: Theorem 4.4 by duality, with Theorem 4.3 as the proof.

The system is x+ = A x + b + E w, y = C x + F w with |w| <= peak and known b. The observer x^+ = A x^ + b + L (y - C x^)
has the error e+ = (A - L C) e + (E - L F) w. It begins, and may begin again at any sample, with an estimate whose error
is `first` w. The certificate is about this error system itself, its matrices computed in fractions: `theory.checker`
proves its reachable set like any other, and `Observer.of_document` that the gains close exactly this loop.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np

from theory.arrays import Array
from theory.checker import Refused, multiply, verify
from theory.errors import IllPosedError, NotCertifiedError, SolverError
from theory.solvers.lmi import LmiProblem, MatrixVariable
from theory.switching import reach
from theory.switching.certificate import Certificate
from theory.switching.graph import Graph
from theory.switching.language import LabelledGraph, Language, language_of
from theory.switching.synthesis import with_clock
from theory.switching.system import SwitchedSystem, decimal, exact_matrix

FORMAT, VERSION = "hrs-observer", 1

ALPHA_FIRST = Fraction(1, 1000)
"""Contraction of a beginning, which forgets the error before: the first estimate's set grows by 1/2000."""

GRID = (0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
"""Values of alpha tried where none is given; small ones come close to estimates that are the newest reading."""

SHRINK = 1e-3
"""Relative distance of eta below its optimum while gains are read off with the largest margin."""

SEARCHED = 3
"""Largest number of gains for which the certificate's alpha is searched again for the gains found."""

DIGITS = 9
"""Decimals of a gain; the rounded gain is certified."""

ExactMatrix = list[list[Fraction]]
ModeClock = tuple[int, int]


@dataclass(frozen=True)
class Observer:
    """Gains by (mode, clock), and the certificate of the error they leave."""

    system: SwitchedSystem
    language: Language  # letters (mode, mode, clock)
    first: ExactMatrix
    gains: Mapping[ModeClock, ExactMatrix]
    certificate: Certificate

    @cached_property
    def _floats(self) -> dict[ModeClock, Array]:
        return {key: np.array([[float(item) for item in row] for row in rows]) for key, rows in self.gains.items()}

    def gain(self, mode: int, clock: int) -> Array:
        """L of a mode (from 1) and the samples since it was entered, n x p."""
        return self._floats[mode, min(clock, self.language.constraint["clock"])]

    @cached_property
    def half_widths(self) -> Array:
        """The largest error of each state over all ellipsoids of the tube, (n,)."""
        inverses = np.linalg.inv(self.certificate.matrices)
        found: Array = np.sqrt(np.diagonal(inverses, axis1=1, axis2=2).max(axis=0)) * (1 + 1e-9)
        return found

    def level(self, error: Array) -> float:
        """The smallest e' O e over the ellipsoids of the tube: at most 1 inside.

        Parameters
        ----------
        error
            e = x - estimate, (n,).

        Returns
        -------
        float
            Without unit.
        """
        return float(np.einsum("i,uij,j->u", error, self.certificate.matrices, error).min())

    def as_document(self) -> dict[str, Any]:
        """System, constraint and gains beside the certificate, whose text `hrs verify` checks by itself."""
        return {
            "format": FORMAT,
            "version": VERSION,
            "system": self.system.as_document(),
            "constraint": dict(self.language.constraint),
            "first": _texts(self.first),
            "gains": [
                {"mode": mode, "clock": clock, "L": _texts(rows)} for (mode, clock), rows in sorted(self.gains.items())
            ],
            "certificate": self.certificate.document,
        }

    @classmethod
    def of_document(cls, document: Mapping[str, Any]) -> Observer:
        """An observer from its document, proved: the gains close the certified loop, and the certificate verifies.

        Raises
        ------
        Refused
            where either is not so, or the document is malformed.
        """
        try:
            if (document["format"], document["version"]) != (FORMAT, VERSION):
                raise Refused(f"not format {FORMAT!r} in version {VERSION}")
            system = SwitchedSystem.of_modes(document["system"])
            inner = language_of(document["constraint"]["of"], system.modes)
            language = inner.clocked(document["constraint"]["clock"])
            first = exact_matrix(document["first"], "first")
            gains = {
                (int(item["mode"]), int(item["clock"])): exact_matrix(item["L"], "L") for item in document["gains"]
            }
            loop, signals, _ = error_system(system, language, first, gains)
            problem = document["certificate"]["problem"]
            expected = {"modes": loop.as_document(), "constraint": json.loads(json.dumps(signals.constraint))}
        except (KeyError, TypeError, ValueError) as error:
            if isinstance(error, Refused):
                raise
            raise Refused(f"malformed document: {type(error).__name__}: {error}") from error
        if {name: problem.get(name) for name in expected} != expected or document["certificate"]["claim"][
            "kind"
        ] != "reach":
            raise Refused("the gains do not close the loop that the certificate is about")
        verdict = verify(document["certificate"])
        return cls(system, language, first, gains, Certificate(document["certificate"], verdict))


def error_system(
    system: SwitchedSystem, language: Language, first: ExactMatrix, gains: Mapping[ModeClock, ExactMatrix]
) -> tuple[SwitchedSystem, Language, list[ModeClock]]:
    """The error system: a mode for each (mode, clock), A - L C and E - L F, and a last one that begins again.

    Its signals are those of `language` after a beginning; a beginning may follow any sample. The keys name the
    modes but the last.

    Parameters
    ----------
    system
        A, C, E and F of each mode.
    language
        Signals of the system.
    first
        n x q or narrower, the first estimate's error as a function of w.
    gains
        L, n x p, of each (mode, clock).

    Returns
    -------
    tuple
        Error system, its language, and the keys of its modes but the last.
    """
    keys = _keys(language)
    loops, drives = [], []
    for key in keys:
        mode = system.exact[key[0] - 1]
        if key not in gains:
            raise IllPosedError("gains", f"none is given for mode {key[0]}, clock {key[1]}")
        loops.append(_less(mode["A"], multiply(gains[key], mode["C"])))
        drives.append(_less(mode["E"], multiply(gains[key], mode["F"])))
    width = len(drives[0][0])
    if len(first) != system.size or any(len(row) > width for row in first):
        raise IllPosedError("first", f"has to be {system.size} x {width} or narrower")
    loops.append([[Fraction(0)] * system.size for _ in range(system.size)])
    drives.append([[*row, *[Fraction(0)] * (width - len(row))] for row in first])
    return SwitchedSystem(A=loops, E=drives), _signals(language, keys), keys


def _keys(language: Language) -> list[ModeClock]:
    """(mode, clock) of every letter that an automaton of `language` reads."""
    letters = {letter for leaving in language.automaton.transitions for letter in leaving}
    return sorted({letter[1:] for letter in letters if isinstance(letter, tuple)})


def _signals(language: Language, keys: Sequence[ModeClock]) -> Language:
    """Signals of the error system as a labelled graph; its last mode is a beginning."""
    number, last = {key: place for place, key in enumerate(keys, 1)}, len(keys) + 1
    edges: list[tuple[int, int, int]] = [(-1, last, 0)]
    for state, leaving in enumerate(language.automaton.transitions):
        edges += [(state, number[letter[1:]], to) for letter, to in leaving.items() if isinstance(letter, tuple)]
        edges.append((state, last, 0))
    return LabelledGraph(edges, [-1], modes=last)


def design(
    system: SwitchedSystem,
    language: Language,
    first: Any,
    *,
    alpha: Sequence[float] | None = None,
    clock: int | None = None,
) -> Observer:
    """Gains with the smallest ball around the errors of an observer, certified.

    Parameters
    ----------
    system
        A, C, E and F of each mode; |w| <= 1.
    language
        Of the modes, with or without clocks.
    first
        n x q, the first estimate's error as a function of w.
    alpha
        The contraction of Lemma 4.1 in each mode; left out, one for all is chosen from a grid. Larger ones give
        smaller gains, which follow the readings less closely, and larger sets.
    clock
        Where the gains' clock stops; left out, the dwell time.

    Raises
    ------
    NotCertifiedError
        No bounded set by these inequalities.
    """
    system.need("ACEF", "an observer")
    language = with_clock(language, clock)
    start = exact_matrix(first, "first")
    zero = {key: [[Fraction(0)] * len(system.exact[0]["C"]) for _ in range(system.size)] for key in _keys(language)}
    _, signals, keys = error_system(system, language, start, zero)
    graph = signals.graph()
    if alpha is not None and (len(alpha) != system.modes or not all(0 < item < 1 for item in alpha)):
        raise IllPosedError("alpha", f"needs {system.modes} numbers between 0 and 1, one a mode")
    tried = [list(alpha)] if alpha is not None else [[value] * system.modes for value in GRID]
    found: Observer | None = None
    for values in tried:
        try:
            gains = _gains(system, graph, keys, start, values)
            made = certified(system, language, start, gains, values)
        except (SolverError, NotCertifiedError):
            continue
        if found is None or made.certificate.value < found.certificate.value:
            found = made
    if found is None:
        raise NotCertifiedError("no observer by these inequalities; other values of alpha may do")
    return _searched(found)


def certified(
    system: SwitchedSystem,
    language: Language,
    first: ExactMatrix,
    gains: Mapping[ModeClock, ExactMatrix],
    alpha: Sequence[float],
) -> Observer:
    """The observer of given gains, its error certified by Theorem 4.3 (parameters as in `design`).

    Parameters
    ----------
    system, language
        A, C, E and F of each mode; the modes' signals.
    first
        n x q or narrower, the first estimate's error as a function of w.
    gains
        L, n x p, of each (mode, clock).
    alpha
        The contraction of Lemma 4.1 in each mode, in (0, 1).

    Returns
    -------
    Observer
        Its certificate is of kind `reach`.
    """
    loop, signals, keys = error_system(system, language, first, gains)
    contraction: Any = [*(alpha[mode - 1] for mode, _ in keys), float(ALPHA_FIRST)]
    return Observer(system, language, first, gains, reach.certify(loop, signals, alpha=contraction))


def _searched(found: Observer) -> Observer:
    """The same gains with the alpha of the smallest certified ball, where the search is short."""
    loop, signals, keys = error_system(found.system, found.language, found.first, found.gains)
    if len(keys) > SEARCHED:
        return found
    certificate = min(found.certificate, reach.certify(loop, signals), key=lambda one: one.value)
    return replace(found, certificate=certificate)


def _gains(
    system: SwitchedSystem, graph: Graph, keys: Sequence[ModeClock], first: ExactMatrix, alpha: Sequence[float]
) -> dict[ModeClock, ExactMatrix]:
    problem, _, _, size = _inequalities(system, graph, keys, first, alpha, None)
    best = float(problem.minimize({size: -1.0}, "observer").values[size])
    if not best > 0:
        raise NotCertifiedError("the errors are not bounded by these inequalities")
    problem, slack, product, margin = _inequalities(system, graph, keys, first, alpha, best * (1 - SHRINK))
    for blocks in problem.every:
        blocks.scalar(margin, -np.eye(blocks.size))
    values = problem.minimize({margin: -1.0}, "observer").values
    pairs = zip(keys, slack.of(values), product.of(values), strict=True)
    return {key: _rounded(np.linalg.solve(one.T, two)) for key, one, two in pairs}


def _inequalities(
    system: SwitchedSystem,
    graph: Graph,
    keys: Sequence[ModeClock],
    first: ExactMatrix,
    alpha: Sequence[float],
    ball: float | None,
) -> tuple[LmiProblem, MatrixVariable, MatrixVariable, int]:
    """The dual of (4.43): [X + X' - O_v, X' A - Y C, X' E - Y F; ., a O_u, 0; ., ., (1 - a) I] > 0, with Y = X' L.

    By X' O_v^-1 X >= X + X' - O_v it implies (4.39) for A - L C and E - L F. A beginning needs first' O_v first <
    (1 - a) I. O_u > eta I for every node; eta is the last unknown, or free for a margin where `ball` fixes it.
    """
    n, width = system.size, system.floats[0]["E"].shape[1]
    outputs = len(system.floats[0]["C"])
    select = np.eye(2 * n + width)
    ahead, here, noise = select[:n], select[n : 2 * n], select[2 * n :]
    problem = LmiProblem()
    shape = problem.symmetric(graph.nodes, n)
    slack, product = problem.full(len(keys), n, n), problem.full(len(keys), n, outputs)
    last = problem.number()
    steps = [(u, int(str(label)) - 1, v) for u, label, v in graph.edges]
    moves = [step for step in steps if step[1] < len(keys)]
    begins = np.array([v for _, label, v in steps if label == len(keys)])
    source, which, target = (np.array(column) for column in zip(*moves, strict=True))
    modes = [system.floats[keys[place][0] - 1] for place in which]
    share = np.array([alpha[keys[place][0] - 1] for place in which])
    edges = problem.blocks(len(moves), len(select), (1 - share)[:, None, None] * (noise.T @ noise))
    edges.congruence(shape, target, ahead, -1.0).congruence(shape, source, here, share)
    through = np.array([ahead + mode["A"] @ here + mode["E"] @ noise for mode in modes])
    seen = np.array([-mode["C"] @ here - mode["F"] @ noise for mode in modes])
    for unknown, left, right in ((slack, through, np.broadcast_to(ahead, through.shape)),
                                 (product, np.broadcast_to(ahead, through.shape), seen)):  # fmt: skip
        edges.product(unknown, which, left, right)
    start = np.zeros((n, width))
    start[:, : len(first[0])] = [[float(item) for item in row] for row in first]
    begin = problem.blocks(len(begins), width, (1 - float(ALPHA_FIRST)) * np.eye(width))
    begin.congruence(shape, begins, start, -1.0)
    within = problem.blocks(graph.nodes, n, 0.0 if ball is None else -ball * np.eye(n))
    within.congruence(shape, np.arange(graph.nodes), np.eye(n))
    if ball is None:
        within.scalar(last, -np.eye(n))
    return problem, slack, product, last


def _less(one: ExactMatrix, two: ExactMatrix) -> ExactMatrix:
    return [[a - b for a, b in zip(*pair, strict=True)] for pair in zip(one, two, strict=True)]


def _rounded(matrix: Array) -> ExactMatrix:
    if not np.isfinite(matrix).all() or math.isinf(float(np.abs(matrix).max())):
        raise NotCertifiedError("the gains cannot be read off: X is singular")
    return [[Fraction(round(float(item) * 10**DIGITS), 10**DIGITS) for item in row] for row in matrix]


def _texts(rows: ExactMatrix) -> list[list[str]]:
    return [[decimal(item) for item in row] for row in rows]
