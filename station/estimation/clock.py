"""Clock skew: of each source the shift at which its readings fit the others best."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from station.estimation.filter import ROBUST, follow
from station.frames import Frames, frames_of
from station.measurement import Samples, TagMap
from station.parameters import Station

SKEW_MAX = 6
"""Largest skew that is looked for [s], in whole seconds."""

LONGEST = 6 * 3600
"""So much of a record is looked at [s]."""

_SOFT = ROBUST._replace(mass=5.0, temperature=0.1, factor=0.01, gate=1e9)
_CAP = 25.0  # what an outlier counts at most


def skew_of(
    samples: list[Samples],
    tags: TagMap,
    station: Station,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> dict[str, float]:
    """By how many seconds the clock of each source is fast, against the one that tells the valves.

    The filter is soft here, so that parameters that are a tenth wrong do not move the best shift.
    """
    reference, *others = tags.sources
    found = {reference: 0.0}
    shifts = sorted(range(-SKEW_MAX, SKEW_MAX + 1), key=abs)
    for turn, source in enumerate(others):
        heard = [each for each in samples if each.tag.source in (*found, source)]
        misfits = []
        for k, shift in enumerate(shifts):
            misfits.append(_misfit(frames_of(heard, {**found, source: float(shift)}), station))
            progress(turn * len(shifts) + k + 1, len(others) * len(shifts))
        found[source] = float(shifts[int(np.argmin(misfits))])
    return found


def _misfit(frames: Frames, station: Station) -> float:
    """Mean square of the innovations, an outlier's capped."""
    cut = frames.part(SKEW_MAX, min(len(frames), LONGEST))
    z = follow(cut, station, _SOFT).innovations
    return float(np.nanmean(np.minimum(z * z, _CAP))) if np.isfinite(z).any() else np.inf
