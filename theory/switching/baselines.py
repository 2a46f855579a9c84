"""Rival methods from the literature, as far as their inequalities are public, for comparison in figures.

Mode-dependent: one matrix and one gain a mode, any switching (the usual multiple Lyapunov functions).
Quasi-time-dependent: matrices and gains by clock, a decrease `alpha` within a mode and a growth of at most `mu` at each
switch, so that two numbers have to be tuned and the inequalities are bilinear in them. References [140] and [162] of
the thesis print them for their own settings; the versions here are derived from that description, with the bounds that
follow from it. The virtual-clock controller [144] and the dwell-time-dependent controller [139] are not public
enough to be written down faithfully and are left out.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

from theory.errors import NotCertifiedError, SolverError
from theory.switching import reach, synthesis
from theory.switching.graph import Graph
from theory.switching.language import ArbitrarySwitching
from theory.switching.representation import Representation
from theory.switching.synthesis import Design
from theory.switching.system import SwitchedSystem


@dataclass(frozen=True)
class Tuned:
    """A rival's best figure and the numbers that gave it."""

    value: float
    alpha: float
    mu: float


def mode_dependent_ball(system: SwitchedSystem, *, peak: float = 1.0) -> Design:
    """Gains and matrices by mode, arbitrary switching, alpha a mode: the method that Fig. 4.4 calls MD ([168])."""
    language = ArbitrarySwitching(modes=system.modes).clocked(0)
    return reach.minimize(system, language, peak=peak, schedule="mode", representation=Representation(lift=1))


def mode_dependent_gain(system: SwitchedSystem, *, common: bool = False) -> Design:
    """The l2 gain with a gain a mode, or one for all, under arbitrary switching (Remark 3.7)."""
    language = ArbitrarySwitching(modes=system.modes).clocked(0)
    return synthesis.minimize_gain(
        system, language, schedule="common" if common else "mode", representation=Representation(lift=1)
    )


def quasi_time_dependent_gain(system: SwitchedSystem, tau: int, alphas: Sequence[float], mus: Sequence[float]) -> Tuned:
    """The non-weighted l2 gain under synchronous dwell time by V+ <= alpha V - y'y + g^2 w'w and V_j <= mu V_i.

    With at most 1 + k / tau switches in k samples, summing the weights gives the gain
    g sqrt(mu (1 - alpha) / (1 - alpha mu^(1 / tau))), which needs alpha mu^(1 / tau) < 1.

    Parameters
    ----------
    system
        With C and E.
    tau
        Dwell time, samples.
    alphas, mus
        The grid of alpha and mu.
    """
    best = Tuned(math.inf, math.nan, math.nan)
    graph = clock_graph(system.modes, tau)
    for alpha, mu in itertools.product(alphas, mus):
        if alpha * mu ** (1 / tau) >= 1:
            continue
        try:
            weighted = synthesis.weighted_gain(system, graph, decay=alpha, growth=mu)
        except SolverError:
            continue
        value = weighted * math.sqrt(mu * (1 - alpha) / (1 - alpha * mu ** (1 / tau)))
        if value < best.value:
            best = Tuned(value, alpha, mu)
    return best


def quasi_time_dependent_ball(
    system: SwitchedSystem, tau: int, period: int, alphas: Sequence[float], mus: Sequence[float], *, peak: float = 1.0
) -> Tuned:
    """The ball under persistent dwell time by V+ <= alpha V + (1 - alpha) |w|^2 / peak^2 and V_j <= mu V_i.

    The largest V is that of the slowest stage: `tau` samples in one mode, then `period` samples with a switch before
    each, over and over; it is finite if alpha^(tau + period) mu^(period + 1) < 1, and scales the ball.

    Parameters
    ----------
    system
        With E.
    tau, period
        Of the persistent dwell time, samples.
    alphas, mus
        The grid of alpha and mu.
    peak
        Bound of |w(k)|.
    """
    best = Tuned(math.inf, math.nan, math.nan)
    graph = clock_graph(system.modes, tau, free=True)
    for alpha, mu in itertools.product(alphas, mus):
        level = largest_level(alpha, mu, tau, period)
        if not math.isfinite(level):
            continue
        try:
            square = reach.weighted_ball(system, graph, alpha=alpha, growth=mu, peak=peak)
        except SolverError:
            continue
        value = math.sqrt(level * square)
        if value < best.value:
            best = Tuned(value, alpha, mu)
    if not math.isfinite(best.value):
        raise NotCertifiedError("no pair of the numbers tried gives a ball")
    return best


def largest_level(alpha: float, mu: float, tau: int, period: int) -> float:
    """The largest V over the slowest stage repeated infinitely, with |w| at its peak; infinite if it grows."""
    slope, offset, steps = 1.0, 0.0, [True] + [False] * (tau - 1) + [True] * period
    for switched in steps:
        factor = mu if switched else 1.0
        slope, offset = alpha * factor * slope, alpha * factor * offset + 1 - alpha
    if slope >= 1:
        return math.inf
    value = offset / (1 - slope)
    highest = 0.0
    for switched in steps:
        value *= mu if switched else 1.0
        highest = max(highest, value)
        value = alpha * value + 1 - alpha
    return max(highest, value)


def clock_graph(modes: int, tau: int, *, free: bool = False) -> Graph:
    """A node a mode and clock; jumps are switches: after `tau` samples, or from any clock if `free`."""
    every = range(1, modes + 1)
    nodes = {(mode, clock): number for number, (mode, clock) in enumerate(itertools.product(every, range(tau + 1)))}
    edges = tuple((number, (m, m, c), nodes[m, min(c + 1, tau)]) for (m, c), number in nodes.items())
    jumps = tuple(
        (number, nodes[other, 0])
        for (m, c), number in nodes.items()
        for other in every
        if other != m and (c == tau or (free and c > 0))
    )
    return Graph(len(nodes), edges, jumps, tuple(f"mode {m}, clock {c}" for m, c in nodes))
