"""How often a scenario decision may be wrong: what can be proved before and after the samples are seen.

With a single convex program Theorem 6.1's 2/(1+S) holds for two inputs (Schildbach, Fagiano, Frei and Morari,
Automatica 50, 2014). The choice of the best among J programs is another program, and not convex. Every path brings its
own support scenarios, so J times as much is what their count proves. The union over the paths of the tail of the
violation (Campi and Garatti, SIAM J. Optim. 19, 2008; with removal J. Optim. Theory Appl. 148, 2011) grows with the
logarithm of J only. After the fact the scenarios that decide can be counted, which needs no convexity (Campi, Garatti
and Ramponi, IEEE Trans. Autom. Control 63, 2018).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import betaln, gammaln
from scipy.stats import binom

from theory.errors import IllPosedError


@dataclass(frozen=True)
class Bound:
    """An upper bound of the probability that the next state breaks its limits, and in which sense it holds."""

    value: float
    kind: Literal["count", "tail", "judged"]
    statement: str


def by_count(paths: float, scenarios: int, rank: int) -> Bound:
    """On the mean over the samples at most rank J / (1 + S), known beforehand; the rank: inputs of one step."""
    _check(paths, scenarios, rank, 0)
    value = min(1.0, rank * paths / (1 + scenarios))
    return Bound(
        value, "count", f"on the mean at most {rank} J/(1+S) = {value:.3g} with J = {paths:g}, S = {scenarios}"
    )


def by_tail(paths: float, scenarios: int, rank: int, removed: int = 0) -> Bound:
    """On the mean over the samples, by the union over the paths of the tail of the violation; R scenarios removed."""
    _check(paths, scenarios, rank, removed)
    support = removed + rank - 1
    choices = math.log(paths) - betaln(rank, removed + 1) - np.log(removed + rank)  # J times C(R + rank - 1, R)

    def excess(level: float) -> float:
        return float(choices + binom.logcdf(support, scenarios, level))

    if support >= scenarios or excess(1 - 1e-12) > 0:
        value = 1.0
    else:
        level = float(brentq(excess, 1e-12, 1 - 1e-12)) if excess(1e-12) > 0 else 0.0
        rest = quad(lambda at: np.exp(min(excess(at), 0.0)), level, 1.0, limit=200)[0]
        value = min(1.0, level + float(rest))
    return Bound(
        value, "tail", f"on the mean at most {value:.3g}, union over J = {paths:g} paths of the tail, S = {scenarios}"
        + (f", {removed} removed" if removed else ""),
    )  # fmt: skip


def judged(support: int, scenarios: int, doubt: float = 0.05) -> Bound:
    """After the fact: `support` scenarios determine the decision; holds but for samples of probability `doubt`."""
    if not 0 < doubt < 1:
        raise IllPosedError("doubt", f"must lie between 0 and 1, given {doubt}")
    if not 0 <= support <= scenarios:
        raise IllPosedError("support", f"must be 0 to {scenarios}, given {support}")
    if support == scenarios:
        value = 1.0
    else:
        chosen = gammaln(scenarios + 1) - gammaln(support + 1) - gammaln(scenarios - support + 1)
        value = float(-np.expm1((np.log(doubt) - np.log(scenarios) - chosen) / (scenarios - support)))
    return Bound(
        value, "judged", f"at most {value:.3g} with confidence {1 - doubt:g}: {support} of {scenarios} scenarios decide"
    )


def _check(paths: float, scenarios: int, rank: int, removed: int) -> None:
    if not (paths >= 1 and scenarios >= 1 and rank >= 1):
        raise IllPosedError("paths, scenarios, rank", f"must be at least 1, given {paths:g}, {scenarios}, {rank}")
    if not 0 <= removed < scenarios:
        raise IllPosedError("removed", f"must be 0 to {scenarios - 1}, given {removed}")
