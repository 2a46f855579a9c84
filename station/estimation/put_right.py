"""A flow meter that was off and is put right while gas flows: from then on it is read as it is. Kernels.

What a meter is off by is known from when nothing flowed, and is taken off what it reads
(`station.estimation.valves.meters`). Once it is put right what is left is off by just as much the other way, at once,
and what it reads itself is what the model expects. Both are compared by a cumulative sum of the logarithm of their
likelihoods (Page 1954, doi:10.1093/biomet/41.1-2.100).
"""

from __future__ import annotations

import numpy as np

from station.compiled import inlined
from station.estimation.valves.memory import SEEN_OTHER, SEEN_RIGHT
from station.sensor_names import ANALOG

PUT = 3
"""Entries of a meter: 1 once it is put right, until it is seen at rest; the cumulative sum of what says that; how many
more readings fitted before, with what is taken off, than did not."""

SURE, MOST = 15.0, 5.0
"""The sum that tells it surely, and the most that a reading adds to it: one that was lost is none."""

OFTEN = 60.0
"""So many readings must have fitted since it was found by how much a meter is off: until then the model has learnt what
was read."""

DOUBT = 2.0
"""From such a sum on readings are not used [1]."""

FITS = 4.0
"""What a meter reads itself lies within so many standard deviations of what the model expects, once it is right [1]."""

WORTH = 0.5
"""A meter that is off by less, in standard deviations of a reading, tells nothing [1]."""

_NEAR = 3.0  # standard deviations within which a reading fits, and how many others one counts that does not [1]
_SIDES, _METERS = 2, ANALOG.index("flow_compressor")
_RIGHT, _SUM, _FITTED = range(PUT)


@inlined
def use_raw(put: np.ndarray, row: int, raw: np.ndarray, read: np.ndarray) -> None:
    """Let meters that were put right be read as they are; at rest it is seen what one is off by, and that counts.

    Parameters
    ----------
    put
        (2, PUT) of the compressors' and the dispenser's meter.
    row
        The second.
    raw
        `Frames.raw`.
    read
        (len(SENSORS),) its readings, with what meters are off by taken off; changed here.
    """
    for side in range(_SIDES):
        value = read[_METERS + side]
        known = raw[row, _SIDES + side] if row < len(raw) else SEEN_RIGHT
        if known >= SEEN_OTHER or (known >= SEEN_RIGHT and put[side, _RIGHT] > 0.0):
            put[side, _FITTED] = 0.0
        if known in (SEEN_RIGHT, SEEN_RIGHT + SEEN_OTHER):
            put[side, _RIGHT], put[side, _SUM] = 0.0, 0.0
        if is_as_read(row, side, raw, value):
            put[side, _FITTED] = put[side, _FITTED] if np.isnan(value) else 0.0
        elif put[side, _RIGHT] > 0.0:
            read[_METERS + side] = raw[row, side]


@inlined
def is_as_read(row: int, side: int, raw: np.ndarray, read: float) -> bool:
    """Whether nothing is taken off what a meter reads, or it was not read."""
    return row >= len(raw) or np.isnan(read) or np.isnan(raw[row, side]) or raw[row, side] == read


@inlined
def judged_reading(put: np.ndarray, side: int, raw: float, read: float, expected: float, spread: float) -> float:
    """The reading of a meter from which something is taken off; NaN while it may have been put right.

    Parameters
    ----------
    put
        (2, PUT), counted on here.
    side
        The meter.
    raw, read
        What it reads itself, and less what it is off by [g/s].
    expected
        What the model expects [g/s].
    spread
        The standard deviation of the reading's error [g/s]; positive.
    """
    if abs(raw - read) < WORTH * spread:
        return read
    off, right = (read - expected) / spread, (raw - expected) / spread
    gain = 0.5 * (off * off - right * right)
    if put[side, _FITTED] < OFTEN:
        put[side, _FITTED] = max(put[side, _FITTED] + (1.0 if abs(off) <= _NEAR else -_NEAR), 0.0)
        return read
    put[side, _SUM] = max(put[side, _SUM] + min(gain, MOST), 0.0) if abs(right) <= FITS else 0.0
    if put[side, _SUM] >= SURE:
        put[side, _RIGHT] = 1.0
        return raw
    return np.nan if put[side, _SUM] >= DOUBT else read
