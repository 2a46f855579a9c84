"""Modes that jump as a Markov chain: the decay of the mean square from both sides, without any program.

x+ = A x with the mode's A, and from mode i the next is j with the probability p_ij. The second moments X_i = E x x' in
mode i go to sum_i p_ij A_i X_i A_i' in mode j; the root of the spectral radius of this map is the rate (O. L. V. Costa,
M. D. Fragoso and R. P. Marques, Discrete-Time Markov Jump Linear Systems, 2005, chapter 3). Matrices L_i > 0 with
r^2 L_i > A_i' (sum_j p_ij L_j) A_i prove a rate above it, moments that grow by s^2 or more in a step one below.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np

from theory.arrays import Array
from theory.checker import Refused, verify
from theory.errors import IllPosedError, NotCertifiedError, TooLargeError
from theory.switching.certificate import Certificate, Claim, triangles
from theory.switching.coordinates import Coordinates, of_maps
from theory.switching.language import ArbitrarySwitching
from theory.switching.lift_search import GAP, SearchBudget, check_gap
from theory.switching.periodic import LowerBound
from theory.switching.system import SwitchedSystem, exact_matrix, rounded_down, rounded_up

ENTRIES_MAX = 4000
"""Modes times squared states: the equations of the moments are solved at once."""

ROOMS = (0.25, 0.5, 1.0, 10.0, 100.0, 1000.0)
"""Distances of the claims from the radius, in gaps."""

DIGITS = range(4, 80, 4)
"""Decimals of the matrices that are tried."""

NEAR = 1e-11
"""Relative distance from the radius at which the moments are computed: there the slowest part outweighs all others."""


def spectral_radius(system: SwitchedSystem, chain: Any) -> float:
    """The root of the spectral radius of the map of second moments: the decay of the mean square's root a sample.

    Parameters
    ----------
    system
        The modes' matrices A.
    chain
        p_ij, rows of numbers that sum up to 1 exactly.
    """
    _, through, _ = _moments(system, exact_chain(chain, system.modes))
    return float(np.sqrt(np.abs(np.linalg.eigvals(through)).max()))


def decay_rate(system: SwitchedSystem, chain: Any, *, gap: float = GAP) -> Certificate:
    """A certificate that the root of E |x(k)|^2 decays faster than a rate, and of moments that decay no faster.

    Parameters
    ----------
    system
        The modes' matrices A.
    chain
        p_ij, rows of numbers that sum up to 1 exactly; 0.1 is the decimal.
    gap
        Relative distance of the bounds that is small enough.

    Raises
    ------
    IllPosedError
        Rows that are no probabilities.
    NotCertifiedError
        No rounding passes the exact check.
    """
    check_gap(gap, 0.0)
    clock, exact = SearchBudget(0.0), exact_chain(chain, system.modes)
    turn, through, count = _moments(system, exact)
    radius = max(float(np.sqrt(np.abs(np.linalg.eigvals(through)).max())), 1e-30)
    claim = Claim("mean-square", Fraction(1), system, ArbitrarySwitching(modes=system.modes), chain=exact)
    below = _grown(through, radius, count)
    for room in ROOMS:
        value = rounded_up(radius * (1 + room * gap))
        proof = {"nodes": system.modes, "edges": [], "jumps": []}
        above = _solved(through.T, float(value), count)
        least = rounded_down(radius * (1 - room * gap), 9)
        bounded = replace(claim, value=value, at_least=LowerBound(least, ()) if below is not None else None)
        for digits in DIGITS:
            unit = 10**digits
            proof |= {"denominator": unit, "matrices": triangles(turn.matrices(above), unit)}
            if below is not None:
                proof["moments"] = triangles(Coordinates(turn.back.T).matrices(below), unit)
            margin = min(1.0, float(value) ** 2) * min(1.0, turn.smallest) ** 2
            about = {"theorem": "second moments", "nodes": system.modes, "inequalities": 2 * system.modes,
                     "margin": float(f"{margin:.3g}"), "digits": digits, "solve_s": clock.spent}  # fmt: skip
            document = bounded.document(proof, about)
            try:
                return Certificate(document, verify(document))
            except Refused as error:
                reason = error
    raise NotCertifiedError(f"mean square {radius:.9g}: the rounded matrices fail the exact check: {reason}")


def exact_chain(chain: Any, modes: int) -> list[list[Fraction]]:
    """The probabilities of a chain; raises `IllPosedError` unless each row has one a mode and sums up to 1 exactly."""
    if chain is None:
        raise IllPosedError("chain", "a mean square needs the probabilities of the jumps, a row a mode")
    exact = exact_matrix(chain, "chain")
    if len(exact) != modes or len(exact[0]) != modes:
        raise IllPosedError("chain", f"is {len(exact)} x {len(exact[0])}, has to be {modes} x {modes}")
    for number, row in enumerate(exact, 1):
        if any(item < 0 for item in row) or sum(row) != 1:
            raise IllPosedError("chain", f"row {number} holds no probabilities that sum up to 1 exactly")
    return exact


def _moments(system: SwitchedSystem, chain: Sequence[Sequence[Fraction]]) -> tuple[Coordinates, Array, int]:
    """Coordinates, the map of the moments of all modes in them, and n."""
    size, modes = system.size, system.modes
    if modes * size**2 > ENTRIES_MAX:
        raise TooLargeError("entries of the second moments", modes * size**2, ENTRIES_MAX)
    maps = [mode["A"] for mode in system.exact]
    turn = of_maps(maps)
    squares = [np.kron(one, one) for one in map(turn.loop, maps)]
    through = np.block([[float(chain[i][j]) * squares[i] for i in range(modes)] for j in range(modes)])
    return turn, through, size


def _solved(through: Array, rate: float, size: int) -> Array:
    """The sum of through^k (I) / rate^2k over k: a matrix a mode."""
    count = len(through) // size**2
    ones = np.tile(np.eye(size).ravel(), count)
    found = np.linalg.solve(np.eye(len(through)) - through / rate**2, ones).reshape(count, size, size)
    return np.asarray((found + np.swapaxes(found, 1, 2)) / 2)


def _grown(through: Array, radius: float, size: int) -> Array | None:
    """Moments that are next to those which grow fastest, all positive definite; None where they are not."""
    found = _solved(through, radius * (1 + NEAR), size)
    found = found / np.abs(found).max()
    found = found if np.trace(found[0]) > 0 else -found
    return found if np.linalg.eigvalsh(found).min() > 1e-9 else None
