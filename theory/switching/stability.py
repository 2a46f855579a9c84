"""Stability under every admissible signal: Theorems 3.1 and 4.1, decay rates, smallest dwell times, counterexamples."""

from __future__ import annotations

import time
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np

from theory.arrays import Array
from theory.checker import Label, Refused, verify
from theory.errors import IllPosedError, InfeasibleError, NotCertifiedError, SolverError
from theory.solvers.lmi import LmiProblem
from theory.switching.certificate import Certificate, Claim, round_and_verify, rounded_up
from theory.switching.graph import Graph
from theory.switching.language import Language
from theory.switching.loops import balanced, check_fit, closed_loops, edge_indices
from theory.switching.representation import Representation
from theory.switching.system import Gains, SwitchedSystem, exact_number

RATE_MAX = 1000.0
WORD_MAX = 12
"""Longest periodic word that is tried unless said."""
WALKS_MAX = 20_000
"""Lengths with more closed walks than these are not searched for bad words."""


def certify(
    system: SwitchedSystem,
    language: Language,
    *,
    rate: Any = 1,
    gains: Gains | None = None,
    representation: Representation | None = None,
) -> Certificate:
    """A certificate that every admissible signal decays faster than rate^k (Theorems 3.1 and 4.1, (3.6)-(3.7)).

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

    Raises
    ------
    NotCertifiedError
        At this lift; its `counterexample` is a `Certificate` of an unstable periodic word or of the inequalities'
        infeasibility, where one was found.
    """
    value = exact_number(rate, "rate")
    if not 0 < value <= RATE_MAX:
        raise IllPosedError("rate", f"{float(value):g} is not within 0..{RATE_MAX:g}")
    check_fit(system, language, gains)
    representation = representation or Representation()
    started = time.perf_counter()
    graph = representation.graph(language)
    maps = closed_loops(system, graph, gains)
    try:
        matrices, margin = _lyapunov(graph, maps, float(value))
    except (InfeasibleError, NotCertifiedError) as error:
        found = counterexample(system, language, value, gains, graph)
        raise NotCertifiedError(_why(value, representation, found), found) from error
    about = {
        "theorem": "3.1 / 4.1",
        **representation.as_document(graph),
        "solve_s": round(time.perf_counter() - started, 4),
    }
    return round_and_verify(Claim("stability", value, system, language, gains), graph, matrices, margin, about)


def decay_rate(
    system: SwitchedSystem,
    language: Language,
    *,
    gains: Gains | None = None,
    representation: Representation | None = None,
    tolerance: float = 1e-6,
    progress: Callable[[str], None] | None = None,
) -> Certificate:
    """The smallest decay rate that this representation and lift certify, by bisection to `tolerance`.

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
    tolerance
        Of the rate, absolute.
    progress
        Receives the bounds of the rate in words.
    """
    check_fit(system, language, gains)
    if not 1e-12 <= tolerance < 1:
        raise IllPosedError("tolerance", f"{tolerance!r} is not within 1e-12..1")
    representation = representation or Representation()
    graph = representation.graph(language)
    maps, _ = balanced(closed_loops(system, graph, gains))
    high = max(float(np.linalg.norm(maps, 2, axis=(1, 2)).max()), 1e-6) * 1.001
    low = 0.0
    while high - low > tolerance / 4:
        middle = (low + high) / 2
        if _decides(graph, maps, middle):
            high = middle
        else:
            low = middle
        if progress:
            progress(f"decay rate between {low:.7f} and {high:.7f}")
    for step in (1, 2, 4, 16, 64, 256, 1024, 4096, 16_384, 65_536):  # next to the limit no margin is left to round
        value = rounded_up(high + step * tolerance / 4)
        try:
            return certify(system, language, rate=value, gains=gains, representation=representation)
        except (NotCertifiedError, SolverError) as error:
            last = error
    raise last


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


def slowest_word(
    system: SwitchedSystem, language: Language, *, gains: Gains | None = None, longest: int = WORD_MAX
) -> tuple[float, tuple[Label, ...]]:
    """The slowest decay among periodic words up to a length: a lower bound of every certified rate, and its word.

    Parameters
    ----------
    system
        The modes' matrices.
    language
        Signals whose periodic words are tried.
    gains
        For letters with a gain and a clock.
    longest
        Largest length of a word, letters.
    """
    maps = {label: system.loop(label, gains) for leaving in language.automaton.transitions for label in leaving}
    best: tuple[float, tuple[Label, ...]] = (0.0, ())
    for word in language.periodic_words(longest, most=WALKS_MAX):
        product = np.eye(system.size)
        for label in word:
            product = maps[label] @ product
        rate = float(np.abs(np.linalg.eigvals(product)).max()) ** (1 / len(word))
        if rate > best[0] * (1 + 1e-12):
            best = (rate, word)
    return best


def counterexample(
    system: SwitchedSystem, language: Language, rate: Fraction, gains: Gains | None, graph: Graph
) -> Certificate | None:
    """An exact proof against a rate: a periodic word that does not decay so fast, else multipliers that show the
    inequalities of this graph contradictory, else None.
    """  # noqa: D205
    slowest, word = slowest_word(system, language, gains=gains)
    if slowest >= float(rate) * (1 - 1e-9):
        claim = Claim("unstable", rate, system, language, gains, word=word)
        document = claim.document({"nodes": 1, "edges": [], "jumps": [], "denominator": 1}, {"rate": slowest})
        try:
            return Certificate(document, verify(document))
        except Refused:  # the word's rate may round to the wrong side; multipliers may still do
            pass
    try:
        return infeasibility_certificate(system, language, rate, gains, graph)
    except (SolverError, NotCertifiedError):
        return None


def infeasibility_certificate(
    system: SwitchedSystem, language: Language, rate: Fraction, gains: Gains | None, graph: Graph
) -> Certificate:
    """Exact multipliers that contradict the inequalities of a graph (Farkas): no matrices prove the rate along it."""
    maps, n = closed_loops(system, graph, gains), system.size
    edges, jumps, identity = len(graph.edges), len(graph.jumps), np.eye(n)
    problem = LmiProblem()
    flows = problem.symmetric(edges + jumps, n)
    margin = problem.number()
    every = np.arange(edges + jumps)
    source = np.array([u for u, *_ in (*graph.edges, *graph.jumps)])
    target = np.array([pair[-1] for pair in (*graph.edges, *graph.jumps)])
    through = np.concatenate([np.swapaxes(maps, 1, 2), np.broadcast_to(identity, (jumps, n, n))])
    leaving = np.concatenate([np.full(edges, float(rate) ** 2), np.ones(jumps)])
    balance = problem.blocks(graph.nodes, n)
    balance.congruence(flows, every, through, into=target)
    balance.congruence(flows, every, identity, -leaving, into=source).scalar(margin, -identity)
    problem.blocks(edges + jumps, n).congruence(flows, every, identity).scalar(margin, -identity)
    problem.blocks(1, 1, float(n * (edges + jumps))).trace(flows, -1.0)
    solution = problem.minimize({margin: -1.0}, "multipliers")
    if solution.values[margin] < 1e-7:
        raise NotCertifiedError("the inequalities may have a solution: no multipliers contradict them with a margin")
    return round_and_verify(
        Claim("infeasible", rate, system, language, gains), graph, flows.of(solution.values),
        float(solution.values[margin]), {"nodes": graph.nodes, "inequalities": graph.inequalities}, name="multipliers",
    )  # fmt: skip


def _lyapunov(graph: Graph, maps: Array, rate: float) -> tuple[Array, float]:
    """Matrices of the largest margin, and the margin: L_u - t I, r^2 L_u - G' L_v G - t I, L_u - L_v - t I >= 0.

    Solved in balanced coordinates; the margin returned is that in x.
    """
    maps, turn = balanced(maps)
    problem, unknown = _inequalities(graph, maps, rate)
    margin = problem.number()
    identity = np.eye(maps.shape[-1])
    for blocks in problem.every:
        blocks.scalar(margin, -identity)
    problem.blocks(1, 1, float(graph.nodes * maps.shape[-1])).trace(unknown, -1.0)
    solution = problem.minimize({margin: -1.0}, "stability")
    if solution.values[margin] < 1e-12:
        raise NotCertifiedError("the largest margin is zero")
    back = np.linalg.inv(turn)
    return back.T @ unknown.of(solution.values) @ back, float(solution.values[margin]) / float(turn.max()) ** 2


def feasible(graph: Graph, maps: Array, rate: float = 1.0) -> Array:
    """Matrices that prove a rate with some room, not with the most: one cheap solve that decides whether any do.

    As the inequalities scale, I on their right-hand side will do: L_u > I, r^2 L_u - G' L_v G > I, L_u - L_v > I.

    Parameters
    ----------
    graph
        Edges and jumps of the inequalities.
    maps
        The map of every edge, edges x n x n.
    rate
        Decay a sample.

    Raises
    ------
    SolverError
        There are none (`InfeasibleError`), or the solver does not decide.
    """
    problem, unknown = _inequalities(graph, maps, rate, np.eye(maps.shape[-1]))
    found: Array = unknown.of(problem.feasible("stability").values)
    return found


def _decides(graph: Graph, maps: Array, rate: float) -> bool:
    try:
        feasible(graph, maps, rate)
    except InfeasibleError:
        return False
    except SolverError:  # undecided; the largest margin decides
        try:
            return _lyapunov(graph, maps, rate)[1] > 0
        except (SolverError, NotCertifiedError):
            return False
    return True


def _inequalities(graph: Graph, maps: Array, rate: float, above: Array | float = 0.0) -> tuple[LmiProblem, Any]:
    size, identity = maps.shape[-1], np.eye(maps.shape[-1])
    source, target, leave, enter = edge_indices(graph)
    problem = LmiProblem()
    unknown = problem.symmetric(graph.nodes, size)
    problem.blocks(graph.nodes, size, -above).congruence(unknown, np.arange(graph.nodes), identity)
    edges = problem.blocks(len(source), size, -above).congruence(unknown, source, identity, rate**2)
    edges.congruence(unknown, target, maps, -1.0)
    if len(leave):
        jumps = problem.blocks(len(leave), size, -above).congruence(unknown, leave, identity)
        jumps.congruence(unknown, enter, identity, -1.0)
    return problem, unknown


def _why(rate: Fraction, representation: Representation, found: Certificate | None) -> str:
    name = "stability" if rate == 1 else f"a decay rate of {float(rate):g}"
    lift = "as small as can be" if representation.lift is None else representation.lift
    lift = f"{representation.kind}, lift {lift}"
    if found is None:
        return f"{name} is not certified at this lift ({lift}); a larger one may do"
    if found.kind == "unstable":
        return f"{name} does not hold: {found.verdict.claim}"
    return f"{name} is not certified at this lift ({lift}), and cannot be: {found.verdict.claim}; a larger one may do"
