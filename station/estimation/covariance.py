"""From one second to the next the covariance of a filter is moved from both sides: by rows, turned, by rows again."""

from __future__ import annotations

import numpy as np

from station.compiled import inlined


@inlined
def drift_on(source: np.ndarray, target: np.ndarray, drift: np.ndarray, size: int) -> None:
    """Write the source with `drift` times it added to its first rows, of which `drift` has few entries.

    Parameters
    ----------
    source, target
        (size or more, the same).
    drift
        (rows, size or more) slopes of what a second adds.
    size
        How many states are estimated.
    """
    for i in range(size):
        for j in range(size):
            target[i, j] = source[i, j]
    for r in range(drift.shape[0]):
        for c in range(size):
            slope = drift[r, c]
            if slope != 0.0:
                for j in range(size):
                    target[r, j] += slope * source[c, j]


@inlined
def turn(matrix: np.ndarray, size: int) -> None:
    """Let the first rows of a square matrix be its columns."""
    for i in range(size):
        for j in range(i):
            matrix[i, j], matrix[j, i] = matrix[j, i], matrix[i, j]
