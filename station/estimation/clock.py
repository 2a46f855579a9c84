"""Clock skew: of each source the shift at which its readings fit the others best."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from station.estimation.clock_shift import SKEW_MAX
from station.estimation.filter import ROBUST, follow
from station.estimation.interface import CAP
from station.estimation.noise import LOUD
from station.estimation.resting import held_for
from station.frames import Frames, frames_of
from station.measurement import Samples, TagMap
from station.parameters import Station
from station.sensor_names import ANALOG

LONGEST = 6 * 3600
"""So much of a record is looked at [s]."""

INTERVAL_MAX = 1.5
"""Readings that lie further apart, in the median, tell no second of a clock [s]."""

SOFT = ROBUST._replace(mass=5.0, temperature=0.1, factor=0.01, gate=1e9)
LEAST = 1e-3  # of a channel without noise


def skew_of(
    samples: list[Samples],
    tags: TagMap,
    station: Station,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> dict[str, float]:
    """By how many seconds the clock of each source is fast, against the one that tells the valves.

    The filter is soft here, so that parameters that are a tenth wrong do not move the best shift. Of a source whose
    readings are more than INTERVAL_MAX apart nothing is told: 0.
    """
    reference, *others = tags.sources
    found = {reference: 0.0}
    if _interval(samples, reference) > INTERVAL_MAX:
        return dict.fromkeys(tags.sources, 0.0)
    shifts = sorted(range(-SKEW_MAX, SKEW_MAX + 1), key=abs)
    for turn, source in enumerate(others):
        if _interval(samples, source) > INTERVAL_MAX:
            found[source] = 0.0
            continue
        heard = [each for each in samples if each.tag.source in (*found, source)]
        misfits = []
        for k, shift in enumerate(shifts):
            misfits.append(_misfits(frames_of(heard, {**found, source: float(shift)}), station))
            progress(turn * len(shifts) + k + 1, len(others) * len(shifts))
        found[source] = _best(shifts, np.array(misfits))
    return found


def _interval(samples: list[Samples], source: str) -> float:
    """The median time between readings of the sensor of a source that reads most often [s]; infinite without one.

    Readings of an analogue sensor that the source tells again are none; one told when it changes is known each second.
    """
    gaps = [
        1.0
        if each.tag.on_change
        else np.median(np.diff(each.time)) * (held_for(each.value) if each.tag.sensor in ANALOG else 1.0)
        for each in samples
        if each.tag.source == source and len(each.time) > 1
    ]
    return float(min(gaps, default=np.inf))


def _misfits(frames: Frames, station: Station) -> NDArray[np.float64]:
    """Mean square of each channel's innovations, an outlier's capped, and how many there are, (2, channels)."""
    cut = frames.part(SKEW_MAX, min(len(frames), LONGEST))
    z = follow(cut, station, SOFT).innovations
    read = np.isfinite(z).sum(0)
    return np.stack((np.nansum(np.minimum(z * z, CAP), 0) / np.maximum(read, 1), read))


def _best(shifts: list[int], misfits: NDArray[np.float64]) -> float:
    """The shift with the least misfit, of `_misfits` at each, (shifts, 2, channels); 0 where none is told.

    A sum of logarithms, as of a likelihood whose variances are estimated. A meter that is noisier than its tag says
    whatever the shift tells nothing of clocks.
    """
    squares, counts = misfits[:, 0], misfits[:, 1]
    telling = (counts.min(0) > 0) & (squares.min(0) <= LOUD**2)
    if not telling.any():
        return 0.0
    weight = counts[:, telling] / counts[:, telling].sum(1, keepdims=True)
    return float(shifts[int(np.argmin((weight * np.log(squares[:, telling] + LEAST)).sum(1)))])
