"""Sensors that are noisier than their tags say: what they read counts for less. Kernels for all.

How much is told by the changes from one innovation to the next (von Neumann 1941, doi:10.1214/aoms/1177731677), which
neither an offset nor a drift, a leak or a wrong parameter makes large. Innovations are told as by the noise of the tag,
so that whoever judges sensor or model sees what the filter saw through.
"""

from __future__ import annotations

import numpy as np

from station.compiled import inlined

HEARING = 60.0
"""Readings over which the changes of a channel are averaged."""

LOUD = 1.5
"""A channel counts for less if its innovations vary so much from one to the next, as a standard deviation [1]."""

# Entries of a channel: its last innovation [standard deviations], NaN for none; half the mean square of its changes.
_LAST, _CHANGE = range(2)
ENTRIES = 2


def usual_noise(channels: int) -> np.ndarray:
    """Of channels that are as noisy as their tags say, (channels, ENTRIES)."""
    noise = np.zeros((channels, ENTRIES))
    noise[:, _LAST], noise[:, _CHANGE] = np.nan, 1.0
    return noise


@inlined
def _loudness(loud: np.ndarray, c: int) -> float:
    """How many times as noisy as its tag says a channel seems to be; 1 unless it is LOUD."""
    return float(np.sqrt(loud[c, _CHANGE])) if loud[c, _CHANGE] > LOUD**2 else 1.0


@inlined
def _note_change(loud: np.ndarray, c: int, normal: float, error: float, deviation: float, gate: float) -> float:
    """Note an innovation, and tell it by the noise of its tag, the standard deviation `deviation`."""
    times = _loudness(loud, c)
    if times > 1.0 and normal != 0.0:
        own = deviation * deviation
        spread = (error / normal) ** 2 - (times * times - 1.0) * own
        normal = error / np.sqrt(max(spread, own))
    change = 0.5 * (normal - loud[c, _LAST]) ** 2
    if not np.isnan(change):
        most = gate * gate * max(loud[c, _CHANGE], 1.0)
        loud[c, _CHANGE] += (min(change, most) - loud[c, _CHANGE]) / HEARING
    loud[c, _LAST] = normal
    return normal


@inlined
def take_noise(
    loud: np.ndarray, noise: np.ndarray, relative: np.ndarray, taken: np.ndarray, taken_relative: np.ndarray
) -> None:
    """Write the noise with which a second's readings are taken, from that of their tags; all (channels,)."""
    for c in range(loud.shape[0]):
        times = _loudness(loud, c)
        taken[c], taken_relative[c] = times * noise[c], times * relative[c]


@inlined
def note_changes(
    loud: np.ndarray, normal: np.ndarray, error: np.ndarray, noise: np.ndarray, relative: np.ndarray,
    read: np.ndarray, gate: float,
) -> None:  # fmt: skip
    """Note a second's innovations, and write into `normal` what they are by the noise of the tags.

    Parameters
    ----------
    loud
        (channels, ENTRIES).
    normal
        (channels,) innovations as the filter saw them [standard deviations]; NaN for no reading.
    error
        (channels,) the same in the sensors' units.
    noise, relative
        (channels,) of the tags: in the sensors' units, and the relative part.
    read
        (channels or more,) the readings.
    gate
        A change counts at most as one at the gate, in standard deviations of the noise there seems to be: single
        outliers are no noise.
    """
    for c in range(loud.shape[0]):
        deviation = np.sqrt(noise[c] ** 2 + (relative[c] * (read[c] - error[c])) ** 2)
        normal[c] = _note_change(loud, c, normal[c], error[c], deviation, gate)
