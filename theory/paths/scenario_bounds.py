"""Bounds on the violation probability of scenario decisions, proved before or after the samples are seen.

*range*: where the input acts without randomness, a fresh state leaves a box only beyond the extremes of the samples,
whatever was chosen and how. That bound knows neither paths nor cost and has no condition.

*count*: Theorem 6.1's 2/(1+S) is that of one convex program with two inputs a step (Schildbach, Fagiano, Frei and
Morari, Automatica 50, 2014). For that the scenarios of the first step must not decide anything else: neither the cost
nor the later steps, which therefore have futures of their own; given those, the program is one in the inputs of the
first step. Almost all samples must allow a solution; else the rank is the number of all unknowns plus one (Calafiore,
SIAM J. Optim. 20, 2010). And it does not survive the choice of the best among J programs: every path brings its own
support scenarios, and their count proves J times as much.

*tail*: under the same conditions, the union over the paths of the tail of the violation (Campi and Garatti, SIAM J.
Optim. 19, 2008; with removal J. Optim. Theory Appl. 148, 2011). It grows with the logarithm of J only.

*choice*: where J candidates are fixed before the S scenarios are drawn, and one that breaks no limit in any of them is
taken, nothing is fitted to the scenarios but the choice. If w_j is the chance that candidate j is taken and p_j that it
breaks a limit in a fresh scenario, then w_j <= (1 - p_j)^S, so the chance of both is at most the sum of
w_j (1 - w_j^(1/S)). That is concave in w, and greatest where all w_j are the same and add up to
s = min(1, J (S/(1+S))^S): s (1 - (s/J)^(1/S)), which is 1 - J^(-1/S) from three candidates on. It needs no convexity
and grows with log J.

*judged*: after the fact the scenarios that decide can be counted, which needs no convexity (Campi, Garatti and Ramponi,
IEEE Trans. Autom. Control 63, 2018).

All bounds on the mean are of the product of the violation and of whether the decision carries the bound: a decision
without one, because it was softened, counts as kept.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import bdtr, betaln, gammaln, logsumexp

from theory.errors import IllPosedError

_WHERE = "if almost all samples allow a path"


@dataclass(frozen=True)
class ViolationBound:
    """An upper bound of the probability that the next state breaks its limits, and in which sense it holds."""

    value: float
    kind: Literal["range", "count", "tail", "choice", "judged"]
    statement: str


def by_range(sides: int, scenarios: int) -> ViolationBound:
    """On the mean over the samples: a random coordinate passes the extreme of S samples with chance 1/(S+1) a side."""
    if sides < 0 or scenarios < 1:
        raise IllPosedError("sides, scenarios", f"must be at least 0 and 1, given {sides}, {scenarios}")
    value = min(1.0, sides / (1 + scenarios))
    return ViolationBound(
        value, "range", f"on the mean at most F/(1+S) = {value:.3g} with F = {sides} sides, S = {scenarios}"
    )


def by_count(paths: float, scenarios: int, rank: int) -> ViolationBound:
    """On the mean over the samples at most rank J / (1 + S), known beforehand; the rank: inputs of one step.

    Parameters
    ----------
    paths
        J.
    scenarios
        S.
    rank
        Inputs of one step.
    """
    _check(paths, scenarios, rank, 0)
    value = min(1.0, rank * paths / (1 + scenarios))
    where = f"with J = {paths:g}, S = {scenarios}, {_WHERE}"
    return ViolationBound(value, "count", f"on the mean at most {rank} J/(1+S) = {value:.3g} {where}")


def by_tail(paths: float, scenarios: int, rank: int, removed: int = 0) -> ViolationBound:
    """On the mean over the samples, by the union over the paths of the tail of the violation.

    Up to `removed` scenarios may have been given up, if the decision breaks the limits of each: then also the union
    over their number.

    Parameters
    ----------
    paths
        J.
    scenarios
        S.
    rank
        Inputs of one step.
    removed
        R, the largest number of scenarios given up.
    """
    from scipy.optimize import brentq  # a quarter of a second

    _check(paths, scenarios, rank, removed)
    # J times C(r + rank - 1, r) ways to give up r scenarios, each with the tail of r + rank - 1 violations allowed.
    weights = [math.log(paths) - betaln(rank, r + 1) - math.log(r + rank) for r in range(removed + 1)]
    allowed = [r + rank - 1 for r in range(removed + 1)]

    def excess(level: float) -> float:
        with np.errstate(divide="ignore"):
            tails = weights + np.log(bdtr(allowed, scenarios, level))
        return float(logsumexp(tails))

    if allowed[-1] >= scenarios or excess(1 - 1e-12) > 0:
        value = 1.0
    else:
        level = float(brentq(excess, 1e-15, 1 - 1e-12, xtol=1e-15)) if excess(1e-15) > 0 else 0.0
        # P(Bin(S, e) <= k) integrated over e from level to 1 is the sum of P(Bin(S + 1, level) <= i), i <= k, by S + 1.
        rests = [
            math.exp(weight + math.log(bdtr(range(k + 1), scenarios + 1, level).sum() / (scenarios + 1)))
            for weight, k in zip(weights, allowed, strict=True)
        ]
        value = min(1.0, level + sum(rests))
    given_up = f", up to {removed} given up" if removed else ""
    return ViolationBound(
        value,
        "tail",
        f"on the mean at most {value:.3g} by the tail over J = {paths:g} paths{given_up}, {_WHERE}",
    )


def by_choice(candidates: int, scenarios: int) -> ViolationBound:
    """On the mean over the samples, for the choice among candidates that were fixed before the samples were drawn.

    Of the chance that the candidate taken broke no limit in any sample and breaks one in a fresh one.
    """
    _check(candidates, scenarios, 1, 0)
    taken = min(1.0, candidates * (scenarios / (1 + scenarios)) ** scenarios)
    value = taken * -math.expm1(math.log(taken / candidates) / scenarios)
    return ViolationBound(
        value, "choice", f"on the mean at most {value:.3g} for J = {candidates} candidates fixed before S = {scenarios}"
    )


def by_support(support: int, scenarios: int, doubt: float = 0.05) -> ViolationBound:
    """After the fact: `support` scenarios determine the decision; holds but for samples of probability `doubt`.

    Parameters
    ----------
    support
        Number of scenarios that determine the decision.
    scenarios
        S.
    doubt
        Probability of samples for which the bound need not hold.
    """
    if not 0 < doubt < 1:
        raise IllPosedError("doubt", f"must lie between 0 and 1, given {doubt}")
    if scenarios < 1 or not 0 <= support <= scenarios:
        raise IllPosedError("support", f"must be 0 to {scenarios}, of at least 1 scenario, given {support}")
    if support == scenarios:
        value = 1.0
    else:
        chosen = gammaln(scenarios + 1) - gammaln(support + 1) - gammaln(scenarios - support + 1)
        value = float(-np.expm1((np.log(doubt) - np.log(scenarios) - chosen) / (scenarios - support)))
    return ViolationBound(
        value, "judged", f"at most {value:.3g} with confidence {1 - doubt:g}: {support} of {scenarios} scenarios decide"
    )


def _check(paths: float, scenarios: int, rank: int, removed: int) -> None:
    if not (paths >= 1 and scenarios >= 1 and rank >= 1):
        raise IllPosedError("paths, scenarios, rank", f"must be at least 1, given {paths:g}, {scenarios}, {rank}")
    if not 0 <= removed < scenarios:
        raise IllPosedError("removed", f"must be 0 to {scenarios - 1}, given {removed}")
