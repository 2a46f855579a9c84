"""Plants whose matrices depend on parameters within bounds and rates, and functions that depend on them as well.

A(p) = A + sum of p_i A_i and likewise all others, with |p_i(k + 1) - p_i(k)| bounded. With L_u(p) linear as well and a
slack matrix X an edge, [r^2 L_u(p), G(p)' X'; ., X + X' - L_v(q)] > 0 is linear in (p, q): it holds for all parameters
p, and all q that they may become, if it holds at the corners of both (after J. Daafouz and J. Bernussou,
doi:10.1016/S0167-6911(01)00118-9).
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import numpy as np

from theory.arrays import Array
from theory.checker import Refused, checksum, parameters, verify
from theory.errors import IllPosedError, InfeasibleError, NotCertifiedError, SolverError, TooLargeError
from theory.solvers.lmi import LmiProblem, MatrixVariable, SymmetricVariable
from theory.switching.certificate import Certificate, Claim, plain, triangles
from theory.switching.graph import Graph
from theory.switching.language import Language
from theory.switching.lift_search import BUDGET_S, GAP, SearchBudget, check_gap, lifts
from theory.switching.loops import check_covers, edge_indices
from theory.switching.periodic import LowerBound
from theory.switching.representation import Representation
from theory.switching.system import Gains, exact_number, rounded_up
from theory.switching.varying_loop import VaryingLoop
from theory.switching.varying_system import VaryingSystem

CORNERS_MAX = 40_000
"""Edges times corners: each is an inequality of twice the states, and more for a gain."""

SLACK_MAX = 10.0
"""Bound of the slack matrices beside matrices of norm 1."""

ROOMS = (0.25, 0.5, 1.0, 2.0, 8.0, 64.0, 1024.0)
"""Distances of a claim above the limit found, in gaps."""

DIGITS_MAX = 60
"""Decimals of the matrices that are tried, at most."""

MARGIN_MIN = 1e-9
"""Smallest margin that counts."""


def certify(system: VaryingSystem, language: Language, *, rate: Any = 1, gains: Gains | None = None,
            representation: Representation | None = None) -> Certificate:  # fmt: skip
    """A certificate that the state decays faster than rate^k for every admissible signal and all courses of parameters.

    Parameters
    ----------
    system, language
        The plant and its signals.
    rate
        Decay a sample; 1 asks for stability.
    gains
        For letters with a gain and a clock.
    representation
        Graph and lift; the smallest where none is given.

    Raises
    ------
    NotCertifiedError
        Not at this lift.
    """
    value = exact_number(rate, "rate")
    if not value > 0:
        raise IllPosedError("rate", f"{float(value):g} is not positive")
    chosen, clock = (representation or Representation()).fixed, SearchBudget(0.0)
    problem = _Problem(system, language, gains, "stability")
    return problem.decaying(value, chosen, problem.graph(chosen), None, clock)


def decay_rate(
    system: VaryingSystem,
    language: Language,
    *,
    gains: Gains | None = None,
    representation: Representation | None = None,
    gap: float = GAP,
    budget: float = BUDGET_S,
) -> Certificate:
    """The smallest decay rate that is certified for all parameters, and that of a signal with a course of parameters.

    Parameters
    ----------
    system, language
        The plant and its signals.
    gains
        For letters with a gain and a clock.
    representation
        Graph and lift; without a lift it is raised while there is time.
    gap
        Relative distance of the bounds that is small enough.
    budget
        Seconds after which the lift is raised no more.

    Raises
    ------
    NotCertifiedError
        No rounding passes the exact check.
    """
    check_gap(gap, budget)
    clock = SearchBudget(budget)
    problem = _Problem(system, language, gains, "stability")
    below = problem.slowest()
    low = 0.0 if below is None else float(below.value)
    high, best = math.inf, None
    for chosen, graph in lifts(representation or Representation(), language, clock):
        found = problem.smallest_rate(problem.checked(graph), low, high, gap)
        if best is None or found < high * (1 - gap):
            high, best = found, (chosen, graph)
        if high <= low * (1 + gap):
            break
    if best is None:
        raise IllPosedError("representation", "has no graph")
    failure: Exception | None = None
    for room in ROOMS:
        try:
            return problem.decaying(rounded_up(max(high, low) * (1 + room * gap)), *best, below, clock)
        except (SolverError, NotCertifiedError) as error:
            failure = error
    raise NotCertifiedError(f"decay rate {high:.7g}: {failure}") from failure


def gain(
    system: VaryingSystem,
    language: Language,
    *,
    gains: Gains | None = None,
    representation: Representation | None = None,
    gap: float = GAP,
    budget: float = BUDGET_S,
) -> Certificate:
    """The smallest l2 gain that is certified for all parameters, and that of a signal with a course of parameters.

    Parameters as in `decay_rate`; the plant needs C and E.

    Raises
    ------
    NotCertifiedError
        No gain is finite at these lifts, or no rounding passes the exact check.
    """
    check_gap(gap, budget)
    system.base.need("CEF", "an l2 gain")
    clock = SearchBudget(budget)
    problem = _Problem(system, language, gains, "gain")
    below = problem.largest()
    low = 0.0 if below is None else float(below.value)
    high, best, failure = math.inf, None, None
    for chosen, graph in lifts(representation or Representation(), language, clock):
        try:
            found = problem.smallest_gain(problem.checked(graph))
        except SolverError as error:
            failure = error
            continue
        if best is None or found < high * (1 - gap):
            high, best = found, (chosen, graph)
        if high <= low * (1 + gap):
            break
    if best is None:
        raise NotCertifiedError(f"no finite l2 gain at these lifts: {failure}") from failure
    refused: Exception | None = None
    for room in ROOMS:
        try:
            return problem.bounded(rounded_up(max(high, low) * (1 + room * gap)), *best, below, clock)
        except (SolverError, NotCertifiedError) as error:
            refused = error
    raise NotCertifiedError(f"l2 gain {high:.7g}: {refused}") from refused


class _Problem(VaryingLoop):
    """A question about a plant with parameters: its inequalities at all corners, and its certificates."""

    def graph(self, chosen: Representation) -> Graph:
        """The graph of a representation, which covers the language and is not too large."""
        return self.checked(chosen.graph(self.language))

    def checked(self, graph: Graph) -> Graph:
        """The graph itself, unless it is too large or misses a signal."""
        check_covers(graph, self.language)
        if len(graph.edges) * len(self.corners) > CORNERS_MAX:
            raise TooLargeError("edges times corners", len(graph.edges) * len(self.corners), CORNERS_MAX)
        return graph

    def _inequalities(
        self, graph: Graph, rate: float, square: float | None
    ) -> tuple[LmiProblem, SymmetricVariable, MatrixVariable, int]:
        """[L_u(p), 0, G' X', H'; ., g^2 I, E' X', F'; ., ., X + X' - L_v(q), 0; ., ., ., I] > 0, G over the rate."""
        count, parts = len(self.corners), len(self.system.ranges) + 1
        made = {
            (label, k): self.pieces(label, self.shares(p))
            for label in graph.labels
            for k, (p, _) in enumerate(self.corners)
        }
        rows = [made[label, k] for _, label, _ in graph.edges for k in range(count)]
        loop = np.array([np.hstack([a, e]) for a, e, _, _ in rows]) / rate
        out = np.array([np.hstack([c, f]) for _, _, c, f in rows])
        n, both, seen = self.turn.size, loop.shape[2], out.shape[1]
        select = np.eye(both + n + seen)
        before, ahead, after = select[:both], select[both : both + n], select[both + n :]
        problem = LmiProblem()
        unknown = problem.symmetric(graph.nodes * parts, n)
        slack, last = problem.full(len(graph.edges), n, n), problem.number()
        cross = after.T @ out @ before
        noise = before[n:].T @ before[n:]
        edges = problem.blocks(
            len(rows), len(select), cross + np.swapaxes(cross, 1, 2) + after.T @ after + (square or 0.0) * noise
        )
        source, target, leave, enter = edge_indices(graph)
        here, there = (np.array([self.shares(pair[k]) for pair in self.corners]) for k in (0, 1))
        for i in range(parts):
            edges.congruence(
                unknown, np.repeat(source, count) * parts + i, before[:n], np.tile(here[:, i], len(source))
            )
            edges.congruence(unknown, np.repeat(target, count) * parts + i, ahead, -np.tile(there[:, i], len(source)))
        edges.product(slack, np.repeat(np.arange(len(source)), count), ahead, ahead + loop @ before)
        if self.kind == "gain" and square is None:
            edges.scalar(last, noise)
        self._on_nodes(problem, unknown, np.arange(graph.nodes), None, 1.0)
        if len(leave):
            self._on_nodes(problem, unknown, leave, enter, 1.0)
        return problem, unknown, slack, last

    def _on_nodes(self, problem: LmiProblem, unknown: SymmetricVariable, plus: Any, minus: Any, sign: float,
                  constant: float = 0.0) -> None:  # fmt: skip
        """Have constant I + sign (L_u - L_v) > 0 at every corner of the parameters, L_v for jumps alone."""
        points = np.array([self.shares(point) for point in parameters.box(self.system.ranges)])
        count, n = len(points), self.turn.size
        blocks = problem.blocks(len(plus) * count, n, constant * np.eye(n))
        for i in range(points.shape[1]):
            weight = sign * np.tile(points[:, i], len(plus))
            blocks.congruence(unknown, np.repeat(plus, count) * points.shape[1] + i, np.eye(n), weight)
            if minus is not None:
                blocks.congruence(unknown, np.repeat(minus, count) * points.shape[1] + i, np.eye(n), -weight)

    def _margin(self, graph: Graph, rate: float, square: float | None) -> tuple[Array, Array, float]:
        """Matrices and slacks of the largest margin, and the margin; with norms of at most 1 where they scale."""
        problem, unknown, slack, last = self._inequalities(graph, rate, square)
        for blocks in problem.every:
            blocks.scalar(last, -np.eye(blocks.size))
        if square is None:
            self._on_nodes(problem, unknown, np.arange(graph.nodes), None, -1.0, 1.0)
            select = np.eye(2 * self.turn.size)
            bound = problem.blocks(slack.count, len(select), SLACK_MAX * select)
            bound.product(slack, np.arange(slack.count), select[: self.turn.size], select[self.turn.size :])
        values = problem.minimize({last: -1.0}, "parameters").values
        return unknown.of(values), slack.of(values), float(values[last])

    def smallest_rate(self, graph: Graph, low: float, high: float, gap: float) -> float:
        """The smallest rate that matrices prove on a graph, to a fraction of the gap; at least `low`."""

        def proves(rate: float) -> bool:
            try:
                return self._margin(graph, rate, None)[2] > MARGIN_MIN
            except SolverError:
                return False

        norms = [
            np.linalg.norm(self.pieces(label, self.shares(p))[0], 2) for label in graph.labels for p, _ in self.corners
        ]
        high = min(high, 1.0000001 * max(float(max(norms)), 1e-30))
        target = low * (1 + gap / 2)
        if target >= high or (target > 0 and proves(target)):
            return min(target, high)
        refused = max(target, 1e-9 * high)
        while high - refused > gap / 4 * high:
            middle = math.sqrt(refused * high) if refused > high / 100 else high / 10
            refused, high = (refused, middle) if proves(middle) else (middle, high)
        return high

    def smallest_gain(self, graph: Graph) -> float:
        """The smallest gain of a graph."""
        problem, _, _, last = self._inequalities(graph, 1.0, None)
        return math.sqrt(max(float(problem.minimize({last: 1.0}, "parameters").values[last]), 1e-12))

    def decaying(self, value: Fraction, chosen: Representation, graph: Graph, below: LowerBound | None,
                 clock: SearchBudget) -> Certificate:  # fmt: skip
        """The certificate of a rate."""
        try:
            matrices, slacks, margin = self._margin(graph, float(value), None)
        except InfeasibleError as error:
            raise NotCertifiedError(f"a decay rate of {float(value):g} is not certified at this lift") from error
        return self._rounded(value, chosen, graph, matrices, slacks, margin * min(1.0, float(value) ** 2), below, clock)

    def bounded(self, value: Fraction, chosen: Representation, graph: Graph, below: LowerBound | None,
                clock: SearchBudget) -> Certificate:  # fmt: skip
        """The certificate of a gain."""
        matrices, slacks, margin = self._margin(graph, 1.0, float(value) ** 2)
        return self._rounded(value, chosen, graph, matrices, slacks, margin, below, clock)

    def _rounded(
        self, value: Fraction, chosen: Representation, graph: Graph, matrices: Array, slacks: Array, margin: float,
        below: LowerBound | None, clock: SearchBudget,
    ) -> Certificate:  # fmt: skip
        """The certificate of matrices and slacks, rounded as coarsely as passes the exact check."""
        what = f"{self.kind} {float(value):.9g}"
        if not margin > MARGIN_MIN:
            raise NotCertifiedError(f"no margin is left at {what} and this lift; a larger one may do")
        system, kept = self.system, margin * min(1.0, self.turn.smallest) ** 2
        exact, loose = self.turn.matrices(matrices), self.turn.matrices(slacks)
        points, edges = 2 ** len(system.ranges), [[u, plain(x), v] for u, x, v in graph.edges]
        about = {"theorem": "parameters", **chosen.as_document(graph), "margin": float(f"{kept:.3g}"),
                 "inequalities": len(edges) * len(self.corners) + (graph.nodes + len(graph.jumps)) * points,
                 "solve_s": clock.spent}  # fmt: skip
        proof = {"nodes": graph.nodes, "edges": edges, "jumps": [list(jump) for jump in graph.jumps]}
        claim = Claim(self.kind, value, system.base, self.language, self.gains, at_least=below)
        reason: Refused | None = None
        for digits in range(max(2, math.ceil(-math.log10(kept))), DIGITS_MAX, 2):
            unit = 10**digits
            proof |= {"denominator": unit, "matrices": triangles(exact, unit),
                      "slacks": [[round(x * unit) for row in rows for x in row] for rows in loose]}  # fmt: skip
            document = claim.document(proof, {**about, "digits": digits})
            varied = [one.as_document() for one in system.parameters]
            document["problem"] |= {"modes": system.as_document(), "parameters": varied}
            document["checksum"] = checksum(document)
            try:
                return Certificate(document, verify(document))
            except Refused as error:
                reason = error
        raise NotCertifiedError(f"{what}: the rounded matrices fail the exact check: {reason}")
