"""Gains that stabilise, and that minimise the l2 gain: Theorem 3.3, Corollary 3.1 and Theorem 4.2."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

import numpy as np

from theory.arrays import Array
from theory.checker import Label
from theory.errors import IllPosedError, InfeasibleError, NotCertifiedError, SolverError
from theory.solvers.lmi import Blocks, Indices, LmiProblem, MatrixVariable, SymmetricVariable
from theory.switching import gain, stability
from theory.switching.certificate import Certificate
from theory.switching.graph import Graph
from theory.switching.language import Language
from theory.switching.loops import edge_indices
from theory.switching.representation import Representation
from theory.switching.system import Gains, SwitchedSystem, mode_of

GainSchedule = Literal["clock", "mode", "common"]
"""Arguments of a gain: mode and clock (3.2), the mode alone, or none (Remark 3.7)."""

SLACKS = (1e-7, 1e-5, 1e-3)
"""Relative excess of gamma^2 over the optimum while the gains are read off, so that X is well conditioned."""

LARGES = (1e4, 1e2, 1e3, 10.0)
"""Bounds of X and U that are tried where some gain can be anything and the solver looks for infinity."""


@dataclass(frozen=True)
class Design:
    """Gains, the figure of the synthesis inequalities, and the certificate of the loop they close.

    `bound` is the figure of the synthesis theorem (in floating point); `certificate` is the analysis of the loop, which
    proves the same or less.
    """

    gains: Gains
    bound: float
    certificate: Certificate
    seconds: float


def with_clock(language: Language, clock: int | None = None) -> Language:
    """A language whose letters name acting gain and clock; the clock counts up to tau by default."""
    if language.constraint["kind"] in {"asynchronous", "clocked"}:
        return language
    return language.clocked(math.ceil(Fraction(language.constraint.get("tau", 1))) if clock is None else clock)


def stabilize(
    system: SwitchedSystem,
    language: Language,
    *,
    schedule: GainSchedule = "clock",
    symmetric: bool = False,
    representation: Representation | None = None,
    tolerance: float = 1e-3,
    progress: Callable[[str], None] | None = None,
) -> Design:
    """Gains with the fastest decay that the inequalities of Corollary 3.1 / Theorem 4.2 give, by bisection.

    Parameters
    ----------
    system
        With B.
    language
        With clocks (`with_clock` makes them) or asynchronous.
    schedule
        The arguments of a gain.
    symmetric
        X_m(clock) symmetric, which proves less.
    representation
        Graph and lift.
    tolerance
        Of the decay rate; re-analysis then bisects to 1e-6.
    progress
        Receives the bounds of the rate in words.

    Raises
    ------
    NotCertifiedError
        No gains make every admissible signal stable by these inequalities.
    """
    system.need("B", "a synthesis")
    if not 1e-6 <= tolerance < 1:
        raise IllPosedError("tolerance", f"{tolerance!r} is not within 1e-6..1")
    language = with_clock(language)
    representation = representation or Representation()
    started = time.perf_counter()
    graph = representation.graph(language)
    best = _stabilizing(system, graph, 1.0, schedule, symmetric=symmetric)
    if best is None:
        raise NotCertifiedError("no stabilising gains by these inequalities at this lift; a larger one may do")
    low, high = 0.0, 1.0
    while high - low > tolerance:
        middle = (low + high) / 2
        found = _stabilizing(system, graph, middle, schedule, symmetric=symmetric)
        if found is None:
            low = middle
        else:
            high, best = middle, found
        if progress:
            progress(f"decay rate between {low:.4f} and {high:.4f}")
    certificate = stability.decay_rate(system, language, gains=best, representation=representation.fixed)
    return Design(best, high, certificate, time.perf_counter() - started)


def minimize_gain(
    system: SwitchedSystem,
    language: Language,
    *,
    schedule: GainSchedule = "clock",
    symmetric: bool = False,
    representation: Representation | None = None,
) -> Design:
    """Gains with the smallest l2 gain by Theorem 3.3, then Theorem 3.2 on the loop they close.

    Parameters as in `stabilize`; the system needs B, C and E.

    Raises
    ------
    NotCertifiedError
        The inequalities have no solution, or the loop of the gains found could not be certified.
    """
    system.need("BCDEF", "a synthesis for the l2 gain")
    language = with_clock(language)
    representation = representation or Representation()
    started = time.perf_counter()
    graph = representation.graph(language)
    try:
        square = _smallest_square(system, graph, schedule, symmetric=symmetric)
    except InfeasibleError as error:
        raise NotCertifiedError("no gains by these inequalities at this lift; a larger one may do") from error
    gains = _gain_design(system, graph, schedule, symmetric=symmetric, square=square)
    certificate = gain.certify(system, language, gains=gains, representation=representation.fixed)
    return Design(gains, math.sqrt(square), certificate, time.perf_counter() - started)


def _smallest_square(system: SwitchedSystem, graph: Graph, schedule: GainSchedule, *, symmetric: bool) -> float:
    """The smallest gamma^2; where the infimum is out of the solver's reach, the smallest with X and U bounded."""
    failure: SolverError | None = None
    for large in (None, *LARGES):
        problem, slacks, inputs, gamma = _gain_inequalities(system, graph, schedule, symmetric=symmetric, square=None)
        if large is not None:
            Feedback(graph, schedule).bound(problem, inputs, slacks, large)
        try:
            return float(problem.minimize({gamma: 1.0}, "synthesis for the l2 gain").values[gamma])
        except InfeasibleError:
            if large is None:
                raise
        except SolverError as error:
            failure = error
    raise failure or SolverError("infeasible", "synthesis for the l2 gain")


def _gain_design(
    system: SwitchedSystem, graph: Graph, schedule: GainSchedule, *, symmetric: bool, square: float
) -> Gains:
    failure: SolverError | None = None
    for slack, large in itertools.product(SLACKS, (None, *LARGES)):
        problem, slacks, inputs, margin = _gain_inequalities(
            system, graph, schedule, symmetric=symmetric, square=square * (1 + slack)
        )
        for blocks in problem.every:
            blocks.scalar(margin, -np.eye(blocks.size))
        if large is not None:
            Feedback(graph, schedule).bound(problem, inputs, slacks, large)
        try:
            solution = problem.minimize({margin: -1.0}, "synthesis for the l2 gain")
        except SolverError as error:
            failure = error
            continue
        return read_gains(graph, schedule, slacks.of(solution.values), inputs.of(solution.values))
    raise failure or SolverError("infeasible", "synthesis for the l2 gain")


def _gain_inequalities(
    system: SwitchedSystem, graph: Graph, schedule: GainSchedule, *, symmetric: bool, square: float | None,
    decay: float = 1.0, growth: float = 1.0,
) -> tuple[LmiProblem, SymmetricVariable | MatrixVariable, MatrixVariable, int]:  # fmt: skip
    """-(3.21) and -(3.22); the last unknown is gamma^2, or free for a margin where gamma^2 is given.

    The blocks' order is x+, y, x, w: [M_v, 0, -(A X + B U), -E; ., I, -(C X + D U), -F; ., ., X + X' - M_u, 0; g^2 I].
    With `decay` and `growth`, V decreases to decay V along edges and grows to growth V at most along jumps.
    """
    n, outputs, noises = system.size, len(system.floats[0]["C"]), system.floats[0]["E"].shape[1]
    size = 2 * n + outputs + noises
    select = np.eye(size)
    ahead, seen, here, noise = np.split(select, np.cumsum([n, outputs, n]))
    problem, feedback = LmiProblem(), Feedback(graph, schedule)
    unknown = problem.symmetric(graph.nodes, n)
    slacks, inputs, last = feedback.unknowns(problem, system, symmetric=symmetric)
    source, target, leave, enter = edge_indices(graph)
    modes = [system.floats[mode_of(label) - 1] for _, label, _ in graph.edges]
    constant = np.array([
        seen.T @ seen - ahead.T @ mode["E"] @ noise - (ahead.T @ mode["E"] @ noise).T - seen.T @ mode["F"] @ noise
        - (seen.T @ mode["F"] @ noise).T + (0.0 if square is None else square) * noise.T @ noise
        for mode in modes
    ])  # fmt: skip
    edges = problem.blocks(len(source), size, constant)
    edges.congruence(unknown, target, ahead).congruence(unknown, source, here, -decay)
    through = [decay * here.T - ahead.T @ mode["A"] - seen.T @ mode["C"] for mode in modes]
    feedback.close(edges, slacks, inputs, here, through, [-ahead.T @ mode["B"] - seen.T @ mode["D"] for mode in modes])
    if square is None:
        edges.scalar(last, noise.T @ noise)
    add_jump_inequalities(problem, unknown, leave, enter, growth)
    return problem, slacks, inputs, last


def weighted_gain(system: SwitchedSystem, graph: Graph, *, decay: float, growth: float) -> float:
    """The smallest g of Theorem 3.3's inequalities with a decrease `decay` along edges and a growth along jumps."""
    problem, _, _, gamma = _gain_inequalities(
        system, graph, "clock", symmetric=False, square=None, decay=decay, growth=growth
    )
    return math.sqrt(float(problem.minimize({gamma: 1.0}, "weighted l2 gain").values[gamma]))


def _stabilizing(
    system: SwitchedSystem, graph: Graph, rate: float, schedule: GainSchedule, *, symmetric: bool
) -> Gains | None:
    """Gains from (4.29)-(4.30) at a decay rate, or None: blocks [M_v, -(A X + B U); ., r^2 (X + X' - M_u)]."""
    n = system.size
    ahead, here = np.eye(2 * n)[:n], np.eye(2 * n)[n:]
    problem, feedback = LmiProblem(), Feedback(graph, schedule)
    unknown = problem.symmetric(graph.nodes, n)
    slacks, inputs, margin = feedback.unknowns(problem, system, symmetric=symmetric)
    source, target, leave, enter = edge_indices(graph)
    modes = [system.floats[mode_of(label) - 1] for _, label, _ in graph.edges]
    edges = problem.blocks(len(source), 2 * n)
    edges.congruence(unknown, target, ahead).congruence(unknown, source, here, -(rate**2))
    feedback.close(edges, slacks, inputs, here, [rate**2 * here.T - ahead.T @ mode["A"] for mode in modes],
                   [-ahead.T @ mode["B"] for mode in modes])  # fmt: skip
    add_jump_inequalities(problem, unknown, leave, enter)
    for blocks in problem.every:
        blocks.scalar(margin, -np.eye(blocks.size))
    problem.blocks(1, 1, float(graph.nodes * n)).trace(unknown, -1.0)
    try:
        solution = problem.minimize({margin: -1.0}, "stabilising gains")
    except InfeasibleError:
        return None
    except SolverError:
        feedback.bound(problem, inputs, slacks, LARGES[0])
        try:
            solution = problem.minimize({margin: -1.0}, "stabilising gains")
        except SolverError:
            return None
    if solution.values[margin] < 1e-9:
        return None
    return read_gains(graph, schedule, slacks.of(solution.values), inputs.of(solution.values))


def add_jump_inequalities(
    problem: LmiProblem, unknown: SymmetricVariable, leave: Indices, enter: Indices, growth: float = 1.0
) -> None:
    """M_u > 0 at every node, and growth M_v - M_u > 0 along every jump from u to v ((3.22), (4.30), (4.44))."""
    identity = np.eye(unknown.size)
    problem.blocks(unknown.count, unknown.size).congruence(unknown, np.arange(unknown.count), identity)
    if len(leave):
        jumps = problem.blocks(len(leave), unknown.size).congruence(unknown, enter, identity, growth)
        jumps.congruence(unknown, leave, identity, -1.0)


class Feedback:
    """The unknowns X and U of every gain, and where they enter the edges' inequalities."""

    def __init__(self, graph: Graph, schedule: GainSchedule) -> None:
        self.keys = gain_keys(graph, schedule)
        numbers = {key: number for number, key in enumerate(dict.fromkeys(self.keys.values()))}
        self._count = len(numbers)
        self._which = np.array([numbers[self.keys[label]] for _, label, _ in graph.edges])

    def unknowns(
        self, problem: LmiProblem, system: SwitchedSystem, *, symmetric: bool
    ) -> tuple[SymmetricVariable | MatrixVariable, MatrixVariable, int]:
        """X (n x n) and U (m x n) for every gain, and one number more."""
        n, m = system.size, system.floats[0]["B"].shape[1]
        slacks: SymmetricVariable | MatrixVariable = (
            problem.symmetric(self._count, n) if symmetric else problem.full(self._count, n, n)
        )
        return slacks, problem.full(self._count, m, n), problem.number()

    def close(
        self,
        edges: Blocks,
        slacks: SymmetricVariable | MatrixVariable,
        inputs: MatrixVariable,
        here: Array,
        through: list[Array],
        driven: list[Array],
    ) -> None:
        """Add T X S + (T X S)' + V U S + (V U S)'.

        Parameters
        ----------
        edges
            Inequalities, one an edge.
        slacks, inputs
            X and U of every gain, as `unknowns` makes them.
        here
            S.
        through, driven
            T and V of each edge.
        """
        left, drive = np.array([item.T for item in through]), np.array([item.T for item in driven])
        if isinstance(slacks, MatrixVariable):
            edges.product(slacks, self._which, left, here)
        else:  # T X S + S' X T' = ((T' + S)' X (T' + S) - (T' - S)' X (T' - S)) / 2
            edges.congruence(slacks, self._which, left + here, 0.5).congruence(slacks, self._which, left - here, -0.5)
        edges.product(inputs, self._which, drive, here)

    def bound(
        self, problem: LmiProblem, inputs: MatrixVariable, slacks: SymmetricVariable | MatrixVariable, large: float
    ) -> None:
        """Keep |U|, and |X| if it is free, below a number."""
        for unknown, rows, columns in (
            (inputs, inputs.rows, inputs.columns),
            (slacks, slacks.rows, slacks.columns) if isinstance(slacks, MatrixVariable) else (None, 0, 0),
        ):
            if unknown is not None:
                select = np.eye(rows + columns)
                blocks = problem.blocks(unknown.count, rows + columns, large * select)
                blocks.product(unknown, np.arange(unknown.count), select[:rows], select[rows:])


def gain_keys(graph: Graph, schedule: GainSchedule) -> dict[Label, tuple[int, int]]:
    """The gain that acts at each label, by its (mode, clock), with 0 where it does not depend on them."""
    if schedule not in {"clock", "mode", "common"}:
        raise IllPosedError("schedule", f"{schedule!r} is none of 'clock', 'mode', 'common'")
    keys: dict[Label, tuple[int, int]] = {}
    for label in graph.labels:
        if isinstance(label, int):
            raise IllPosedError("constraint", "its letters tell no gain; a clock is needed")
        keys[label] = {"clock": label[1:], "mode": (label[1], 0), "common": (0, 0)}[schedule]
    return keys


def read_gains(graph: Graph, schedule: GainSchedule, slacks: Array, inputs: Array) -> Gains:
    """K = U X^-1 ((3.23), (4.31), (4.46)) for every mode and clock, rounded as they will be certified.

    Parameters
    ----------
    graph
        The graph of the synthesis, whose labels name the gains.
    schedule
        The arguments of a gain.
    slacks, inputs
        X, gains x n x n, and U, gains x m x n.
    """
    keys = gain_keys(graph, schedule)
    numbers = {key: number for number, key in enumerate(dict.fromkeys(keys.values()))}
    try:
        made = [np.linalg.solve(slack.T, drive.T).T for slack, drive in zip(slacks, inputs, strict=True)]
    except np.linalg.LinAlgError as error:
        raise NotCertifiedError("the gains cannot be read off: X is singular") from error
    return Gains.rounded({label[1:]: made[numbers[key]] for label, key in keys.items() if isinstance(label, tuple)})
