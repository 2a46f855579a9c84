"""When an event began, and between which times: an estimate takes time to show what happened, and machines rest."""

from __future__ import annotations

import math
from typing import NamedTuple

from station.estimation.detection_memory import (
    DRIFTS,
    FREEZES,
    LEAK_NOTHING,
    LINE,
    METER_DRIFTS,
    NOISES,
    PRECOOLER,
    SEATS,
    STICKS,
)
from station.estimation.valves.meters import SHOWS
from station.geometry import BUFFERS

LAG, POWER = 180.0, 0.6
"""The estimate of a leak exceeds what counts as nothing LAG seconds behind its begin, times the part of the leak that
this is to the power: 45 s of 0.3 g/s, 30 s of 0.5 g/s, 14 s of 2 g/s, as measured."""

RISES = 1.5
"""Noise of a sensor began so many times as long before it shows as it took from there until it was told at most [1]."""

DRIFTED, EARLIEST, LATEST = 0.4, 1.5, 0.25
"""Drift of a bank's sensor began so many times as long before it shows as it took from there until it was told: about,
at most, and behind that at most, since what it was off before hides it [1]."""

LOST = 3.0
"""A sample may be lost, and the one behind it [s]."""


class Began(NamedTuple):
    """When something began [s]."""

    about: float
    low: float | None  # it was not there before
    high: float | None  # it was there then


def began(signal: int, shown: float, found: float, right: float, size: float, scale: float) -> Began:
    """When an event began.

    Parameters
    ----------
    signal : int
        Its place among DETECTABLE.
    shown : float
        Since when it shows [s].
    found : float
        When it was found [s].
    right : float
        When it was last seen that there was nothing of it [s]; -inf where it never was.
    size : float
        How large it is, as far as is known.
    scale : float
        `EstimationModel.scale_of` of the station.
    """
    if signal < len(BUFFERS) and not math.isinf(right):  # of one that has grown
        return Began(shown, right - LOST, found)
    if signal < len(BUFFERS):
        part = scale * LEAK_NOTHING / size if size > 0.0 else 1.0
        lag = LAG * min(part, 1.0) ** POWER
        return Began(shown - lag, shown - 2.0 * lag - LOST, shown + LOST)
    if NOISES <= signal < FREEZES:  # the mean over a window has risen since
        return Began(shown, shown - RISES * (found - shown) - LOST, shown + LOST)
    if signal == LINE:  # it shows with the second bank that gives
        return Began(shown, None if math.isinf(right) else min(right, shown) - LOST, found)
    if METER_DRIFTS <= signal < SEATS:  # it had drifted before it was looked at for SHOWS
        low, high = min(right, shown) - LOST, found - SHOWS + LOST
        return Began(min(shown, high), None if math.isinf(right) else low, high)
    if DRIFTS <= signal < STICKS:  # it was off by a part of the limit since
        rose = found - shown
        return Began(shown - DRIFTED * rose, shown - EARLIEST * rose - LOST, shown + LATEST * rose)
    last = None if math.isinf(right) else min(right, shown) - LOST
    if SEATS <= signal < PRECOOLER or (STICKS <= signal < LINE and size > 0.0):  # while gas was weighed, it may be
        return Began(shown, last, found)
    return Began(shown, last, shown + LOST)
