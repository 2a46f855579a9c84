"""A sensor of a buffer that is off all at once and stays so: what it is off is taken off until it jumps back. Kernels.

Readings beyond the gate are not used, and of a buffer whose pressure is not read less and less is known, until the gate
is so wide that the wrong readings pass it. A jump is known by readings that fitted just before and are all off by the
same just after: gas that nobody counted makes a pressure move for longer.
"""

from __future__ import annotations

import numpy as np

from station.compiled import inlined
from station.geometry import TANKS
from station.sensor_names import ANALOG

JUMP = 7
"""Entries of a channel: what is taken off its readings; how many in a row were refused, the sum of their errors and of
the squares, the first, the sum of the errors times the number of each; how far the last that were used were off in the
mean, in standard deviations."""

SURE = 40
"""So many readings in a row that are off by the same tell a jump."""

SUSPECT, ALIKE = 5.0, 0.4
"""The first is so many standard deviations off, and the others by so large a part of the mean, or beyond the gate."""

RIGHT = 2.5
"""A sensor that is off by less, once it has jumped back, is right: how far it was off is not known much better [1]."""

CALM = 1.5
"""So far readings are off at most, in the mean, before one [1]; those of a healthy sensor are by 0.8."""

FIRST, STEADY, SURELY = 3.5, 2.0, 4.0
"""Where readings are off by the same the first is so far from their mean at most; and all spread by STEADY at most, and
rise or fall by as much, or by SURELY times what noise makes of it; in standard deviations of the noise [1]."""

WIDER = 2.0
"""Where there was no jump gas went that nobody counted: the gate is so many times as wide until readings fit [1]."""

_RECENT, _RESTLESS = 5.0, 10.0  # readings that are averaged, and how far off they count where no jump was found [1]
_BEYOND = 1.001  # what is read by a sensor that is off lies beyond the gate, by so little at least [1]
TAKEN, _RUN, _SUM, _SQUARES, _FIRST, _MOMENT, _OFF = range(JUMP)


def jumps_of_nothing() -> np.ndarray:
    """Of channels that have read nothing, (len(ANALOG), JUMP)."""
    return np.zeros((len(ANALOG), JUMP))


@inlined
def forget_jumps(jumps: np.ndarray, bank: int) -> None:
    """Begin anew with the sensors of a buffer: that they seemed to be off was none of their fault, perhaps."""
    for entry in range(JUMP):
        jumps[bank, entry] = jumps[len(TANKS) + bank, entry] = 0.0


@inlined
def nearer_gate(jumps: np.ndarray, channel: int, noise: float, gate: float) -> float:
    """From where on the next reading of a channel is an outlier [1]: nearer than the filter's gate if it may jump."""
    if jumps[channel, _OFF] > CALM:
        return WIDER * gate if jumps[channel, _OFF] > gate else gate
    if jumps[channel, _RUN] == 0.0:
        return min(SUSPECT, gate)
    return min(ALIKE * abs(jumps[channel, _SUM]) / (jumps[channel, _RUN] * noise), gate)


@inlined
def _is_steady(jump: np.ndarray, noise: float, sure: bool) -> bool:
    """Whether readings in a row are off by the same; `sure`: and by much enough, and spread as noise does."""
    count = jump[_RUN]
    mean = jump[_SUM] / count
    rise = 12.0 * (jump[_MOMENT] - 0.5 * (count + 1.0) * jump[_SUM]) / max(count * count - 1.0, 1.0)
    steady = abs(rise) <= max(STEADY, SURELY * np.sqrt(12.0 / count)) * noise
    spread = np.sqrt(max(jump[_SQUARES] / count - mean * mean, 0.0))
    enough = not sure or (spread <= STEADY * noise and abs(mean) >= SUSPECT * noise)
    return bool(steady and enough and abs(jump[_FIRST] - mean) <= FIRST * noise)


@inlined
def note_jump(
    jumps: np.ndarray, channel: int, normal: float, error: float, noise: float, nearer: float, gate: float
) -> float:
    """Take a reading that was used, or refused; its innovation as it was read, in standard deviations.

    That of a sensor which is off lies beyond the gate.

    Parameters
    ----------
    jumps
        (len(ANALOG), JUMP), counted on here.
    channel
        The sensor's.
    normal, error
        The innovation in standard deviations and in the sensor's unit, with what the sensor is off taken off.
    noise
        Its standard deviation, in its unit.
    nearer
        The gate that the reading had to pass, in standard deviations.
    gate
        The filter's.
    """
    jump = jumps[channel]
    as_read = normal
    if jump[TAKEN] != 0.0 and error != 0.0:
        as_read = normal * (error + jump[TAKEN]) / error
        as_read = np.copysign(max(abs(as_read), _BEYOND * gate), jump[TAKEN]) if abs(normal) <= nearer else as_read
    if abs(normal) <= nearer:
        jump[_RUN] = 0.0
        jump[_OFF] += (abs(normal) - jump[_OFF]) / _RECENT
        return float(as_read)
    if jump[_RUN] == 0.0:
        jump[_SUM], jump[_SQUARES], jump[_FIRST], jump[_MOMENT] = 0.0, 0.0, error, 0.0
    jump[_RUN] += 1.0
    jump[_SUM] += error
    jump[_SQUARES] += error * error
    jump[_MOMENT] += error * jump[_RUN]
    calm, sure = jump[_OFF] <= CALM, jump[_RUN] >= SURE
    if calm and not _is_steady(jump, noise, sure):
        jump[_RUN], jump[_OFF] = 0.0, _RESTLESS
    elif calm and sure:
        jump[TAKEN] += jump[_SUM] / jump[_RUN]
        jump[_RUN] = 0.0
        if abs(jump[TAKEN]) < RIGHT * noise:
            jump[TAKEN] = 0.0
    return float(as_read)


@inlined
def unless_jump(jumps: np.ndarray, channel: int, normal: float) -> float:
    """The innovation that a reading had once it was noted, or NaN while it may be that its sensor has jumped."""
    return np.nan if jumps[channel, _RUN] > 0.0 and jumps[channel, _OFF] <= CALM else normal
