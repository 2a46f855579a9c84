"""One reading's update of a filter, scalar by scalar (Bierman 1977)."""

from __future__ import annotations

import numpy as np

from station.compiled import inlined


@inlined
def take_reading(
    state: np.ndarray, cov: np.ndarray, column: np.ndarray, size: int, error: float, spread: float, gate: float,
    bounded: bool,
) -> float:  # fmt: skip
    """Use a reading; the innovation in standard deviations.

    Beyond the gate a reading is not used; where `bounded`, it counts as much as one at the gate (Huber 1964,
    doi:10.1214/aoms/1177703732), so that a weak machine is seen by the meter that says so.

    Parameters
    ----------
    state
        (size or more,) what is estimated.
    cov
        (size or more, the same) its covariance.
    column
        (size or more,) the covariance times the reading's slopes.
    size
        How many states are estimated.
    error
        The reading less its prediction.
    spread
        The variance that this should have.
    gate
        In standard deviations.
    bounded
        Whether a reading beyond the gate counts as one at it.
    """
    normal = error / np.sqrt(spread)
    if bounded and abs(normal) > gate:
        spread = abs(error / gate) * np.sqrt(spread)
    if bounded or abs(normal) <= gate:
        for i in range(size):
            gain = column[i] / spread
            state[i] += gain * error
            for j in range(size):
                cov[i, j] -= gain * column[j]
    return float(normal)
