"""Proofs against a claim: a periodic word that does not decay so fast, or multipliers that contradict a graph."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from theory.checker import Label, Refused, verify
from theory.errors import NotCertifiedError, SolverError
from theory.solvers.lmi import LmiProblem
from theory.switching import periodic
from theory.switching.certificate import Certificate, Claim, round_and_verify
from theory.switching.coordinates import Coordinates
from theory.switching.graph import Graph
from theory.switching.language import Language
from theory.switching.loops import closed_loops, coordinates_of, labels_of
from theory.switching.system import Gains, SwitchedSystem, closed_by


def slowest_word(
    system: SwitchedSystem, language: Language, *, gains: Gains | None = None, longest: int | None = None
) -> tuple[float, tuple[Label, ...]]:
    """The slowest decay among periodic words: a lower bound of every certified rate, and its word.

    Parameters
    ----------
    system
        The modes' matrices.
    language
        Signals whose periodic words are tried.
    gains
        For letters with a gain and a clock.
    longest
        Length up to which every word is tried, and no longer one; by default as many as take a moment, and longer ones
        among products that have decayed little.
    """
    system = closed_by(system, gains)
    turn = coordinates_of(system, language, gains)
    maps = {label: turn.loop(system.exact_loop(label, gains)) for label in labels_of(language)}
    return periodic.slowest(maps, language, longest)


def slow_word_certificate(
    system: SwitchedSystem,
    language: Language,
    rate: Fraction,
    gains: Gains | None,
    found: tuple[float, tuple[Label, ...]],
) -> Certificate | None:
    """The proof that a word does not decay faster than a rate; None where it does.

    Parameters
    ----------
    system, language
        The modes' matrices, and the signals.
    rate
        Decay a sample.
    gains
        For letters with a gain and a clock.
    found
        Decay and word, as `slowest_word` gives them.
    """
    slowest, word = found
    if not word or slowest < float(rate) * (1 - 1e-9):
        return None
    claim = Claim("unstable", rate, system, language, gains, word=word)
    document = claim.document({"nodes": 1, "edges": [], "jumps": [], "denominator": 1}, {"rate": slowest})
    try:
        return Certificate(document, verify(document))
    except Refused:  # the word's rate is below by less than floating point tells
        return None


def counterexample(
    system: SwitchedSystem, language: Language, rate: Fraction, gains: Gains | None, graph: Graph
) -> Certificate | None:
    """An exact proof against a rate: a periodic word that does not decay so fast, else multipliers that show the
    inequalities of this graph contradictory, else None.
    """  # noqa: D205
    slow = slow_word_certificate(system, language, rate, gains, slowest_word(system, language, gains=gains))
    if slow is not None:
        return slow
    try:
        return infeasibility_certificate(system, language, rate, gains, graph)
    except (SolverError, NotCertifiedError):
        return None


def infeasibility_certificate(
    system: SwitchedSystem, language: Language, rate: Fraction, gains: Gains | None, graph: Graph
) -> Certificate:
    """Exact multipliers that contradict the inequalities of a graph (Farkas): no matrices prove the rate along it."""
    turn = coordinates_of(system, language, gains)
    maps, n = closed_loops(system, graph, gains, turn), system.size
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
        turn=Coordinates(turn.back.T),
    )  # fmt: skip
