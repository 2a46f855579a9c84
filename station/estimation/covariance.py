"""From one second to the next the covariance of a filter is moved from both sides: by rows, turned, by rows again."""

from __future__ import annotations

import numpy as np

from station.compiled import inlined


@inlined
def _add_rows(target: np.ndarray, source: np.ndarray, factors: np.ndarray, size: int) -> None:
    """Add `factors`, which has few entries, times the source to the target."""
    for r in range(min(factors.shape[0], size)):
        for c in range(size):
            factor = factors[r, c]
            if factor != 0.0:
                for j in range(size):
                    target[r, j] += factor * source[c, j]


@inlined
def drift_on(source: np.ndarray, target: np.ndarray, drift: np.ndarray, size: int) -> None:
    """Write the source with `drift` times it added to its first rows.

    Parameters
    ----------
    source, target
        (size or more, the same).
    drift
        (rows, size or more) slopes of what a second adds; most are 0.
    size
        How many states are estimated.
    """
    for i in range(size):
        for j in range(size):
            target[i, j] = source[i, j]
    _add_rows(target, source, drift, size)


@inlined
def times(transition: np.ndarray, source: np.ndarray, target: np.ndarray, size: int) -> None:
    """Write the product of a transition, of which most entries are 0, and a source; all (size or more, the same)."""
    for i in range(size):
        for j in range(size):
            target[i, j] = 0.0
    _add_rows(target, source, transition, size)


@inlined
def turn(matrix: np.ndarray, size: int) -> None:
    """Let the first rows of a square matrix be its columns."""
    for i in range(size):
        for j in range(i):
            matrix[i, j], matrix[j, i] = matrix[j, i], matrix[i, j]
