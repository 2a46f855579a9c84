"""A compressor's meter that all at once reads something else: the pressures of its banks say whether it is right.

A compressor trips or begins again between two readings, and then what is left of it is not known. A meter that fails,
or a telegram that is lost, looks the same for some seconds.
"""

from __future__ import annotations

import numpy as np

from station.compiled import inlined

NOTHING = 1e-3
"""No less is left of a compressor [1]: what gives nothing at all would tell nothing of what it gives."""

STANDS = 0.02
"""A compressor of which so little is left stands [1]: it warms no buffer, and its meter has no noise."""

DOUBT = 3
"""Entries of a doubt: doubted readings in a row, and before them what was left of the compressor and how well it was
known [1]."""

_CHANGED = 1.0  # how little is known of what is left once a reading is doubted, as a standard deviation [1]
_JUMP = 0.36  # of what a healthy compressor gives: a reading so far off is doubted
_BACK = 0.1  # and one that is so near to what it was is not any more
_APART = 6.0  # deviations of what the pressures say that tell what a meter reads from what it was
_PATIENCE = 60.0  # readings after which a meter is believed where pressures say nothing


@inlined
def is_doubted(
    doubt: np.ndarray, factor: float, cov: np.ndarray, place: int, size: int, read: float, healthy: float, spread: float
) -> tuple[bool, float]:
    """Whether a reading of a compressor's meter may be wrong, and what is left of the compressor [1].

    A reading that is doubted is not used until the pressures say the same, and nothing is known meanwhile of what is
    left. Where the meter reads again what it did before, so is what was left, and how well it was known.

    Parameters
    ----------
    doubt
        (DOUBT,) counted on here.
    factor
        What is left of the compressor as estimated [1].
    cov
        (size or more, the same) the covariance, in which the compressor's variance is changed.
    place
        Where the compressor stands in it.
    size
        How many states are estimated.
    read
        The reading [g/s].
    healthy
        What a compressor would give that does all that it should [g/s]; positive.
    spread
        By how much a reading may well be off [g/s].
    """
    deviation = np.sqrt(cov[place, place])
    if doubt[0] == 0.0:
        doubt[1], doubt[2] = factor, deviation
    jump = abs(read / healthy - doubt[1])
    if jump <= max(spread / healthy, _BACK if doubt[0] > 0.0 else _JUMP):
        if doubt[0] > 0.0:
            for j in range(size):
                cov[place, j] = cov[j, place] = 0.0
            doubt[0], factor, cov[place, place] = 0.0, doubt[1], doubt[2] ** 2
        return False, factor
    agrees = abs(read / healthy - factor) < 0.5 * jump if _APART * deviation < jump else doubt[0] >= _PATIENCE
    if doubt[0] > 0.0 and agrees:
        doubt[0] = 0.0
        return False, factor
    if doubt[0] == 0.0:
        cov[place, place] += _CHANGED**2
    doubt[0] += 1.0
    return True, factor
