"""Readings that rest on one value, as those of a sensor with noise do not: its sensor is stuck. Kernels for all.

A sensor that reads in coarse steps, or without noise, says one value for long where nothing changes. It is known by its
readings before: most of their runs were long, or its innovations hardly spread.
"""

from __future__ import annotations

import numpy as np

from station.compiled import inlined
from station.sensor_names import ANALOG

RESTING = 10
"""So many equal readings in a row say nothing more: the sensor may be stuck."""

NOISELESS = 0.1
"""A sensor whose innovations spread no more has no noise [1]: at rest it says one value all the time."""

_FEWEST = 10  # readings before anything is said of a sensor's noise
_FIRST_FLOW = ANALOG.index("flow_compressor")

# Entries of a channel: its last reading, how often in a row, runs before of at most two readings and of more; how many
# innovations lay within the gate, their mean, and the sum of the squares of their deviations from it.
_VALUE, RUN, _SHORT, _LONG, _WITHIN, _MEAN, _SQUARE = range(7)
ENTRIES = 7


def runs_of_nothing(channels: int) -> np.ndarray:
    """Of channels that have read nothing, (channels, ENTRIES)."""
    runs = np.zeros((channels, ENTRIES))
    runs[:, _VALUE] = np.nan
    return runs


@inlined
def note_reading(runs: np.ndarray, c: int, value: float) -> bool:
    """Note a channel's reading of a second, NaN for none; whether it is another than the one before.

    A flow of nothing is no reading.
    """
    if np.isnan(value) or (c >= _FIRST_FLOW and value == 0.0):
        return False
    if value == runs[c, _VALUE]:
        runs[c, RUN] += 1.0
        return False
    if runs[c, RUN] > 2.0:
        runs[c, _LONG] += 1.0
    elif runs[c, RUN] > 0.0:
        runs[c, _SHORT] += 1.0
    runs[c, _VALUE], runs[c, RUN] = value, 1.0
    return True


@inlined
def note_innovation(runs: np.ndarray, c: int, normal: float, gate: float) -> None:
    """Note what a channel's reading was off [standard deviations]; NaN for no reading."""
    if abs(normal) <= gate:
        runs[c, _WITHIN] += 1.0
        off = normal - runs[c, _MEAN]
        runs[c, _MEAN] += off / runs[c, _WITHIN]
        runs[c, _SQUARE] += off * (normal - runs[c, _MEAN])


@inlined
def has_rest(runs: np.ndarray, c: int) -> bool:
    """Whether a channel may say one value for long while its sensor works."""
    coarse = runs[c, _SHORT] == 0.0 or runs[c, _LONG] > runs[c, _SHORT]
    noiseless = runs[c, _WITHIN] < _FEWEST or runs[c, _SQUARE] <= NOISELESS**2 * runs[c, _WITHIN]
    return bool(coarse or noiseless)


@inlined
def is_resting(runs: np.ndarray, c: int) -> bool:
    """Whether a channel's readings rest on one value, and its sensor has no rest."""
    return bool(runs[c, RUN] >= RESTING and not has_rest(runs, c))


@inlined
def hear(runs: np.ndarray, values: np.ndarray, heard: np.ndarray) -> None:
    """Write into `heard` what the sensors of a second tell: of those that are stuck nothing."""
    for k in range(heard.shape[0]):
        heard[k] = values[k]
    for c in range(runs.shape[0]):
        note_reading(runs, c, values[c])
        if is_resting(runs, c):
            heard[c] = np.nan
