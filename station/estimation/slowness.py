"""Time constants of thermometers whose tags do not tell them: those at which the record fits best."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from station.estimation.clock import SOFT, skew_of
from station.estimation.filter import follow
from station.estimation.interface import CAP
from station.frames import Frames, frames_of
from station.geometry import TANKS
from station.measurement import Samples, TagMap
from station.parameters import Station

CANDIDATES = (0.0, 2.0, 3.0, 5.0, 7.0, 10.0, 15.0, 20.0, 30.0, 45.0, 60.0, 90.0)
"""Time constants that are tried [s]."""

LONGEST = 21_600
"""Seconds of the record that are looked at."""

_SETTLED = 600  # the filter still learns before [s]
_BETTER = 0.003  # by so large a part a misfit must fall, lest chance be taken for slowness
_FIRST = len(TANKS)  # channel of the first thermometer
_READ = 600  # of fewer readings nothing is said


def time_constants_of(
    frames: Frames, tags: TagMap, station: Station, progress: Callable[[int, int], None] = lambda _done, _total: None
) -> NDArray[np.float64]:
    """Time constant of each tank's thermometer [s], (len(TANKS),): as its tag tells it, else as the record fits best.

    The filter is soft here, as it is where clocks are compared, so that wrong parameters do not count for slowness.
    """
    told = {tag.sensor: tag.time_constant_s for tag in tags.tags}
    free = np.array([told.get(f"temperature_{tank}", 0.0) is None for tank in TANKS])
    if not free.any():
        return frames.time_constants
    misfits = np.empty((len(CANDIDATES), len(TANKS)))
    cut = frames.part(0, min(len(frames), LONGEST))
    for place, candidate in enumerate(CANDIDATES):
        z = follow(replace(cut, time_constants=np.where(free, candidate, frames.time_constants)), station, SOFT)
        misfits[place] = _misfits(z.innovations[_SETTLED:, _FIRST : _FIRST + len(TANKS)])
        progress(place + 1, len(CANDIDATES))
    best = np.argmin(misfits, axis=0)
    slow = free & (misfits.min(axis=0) < (1.0 - _BETTER) * misfits[0])
    return np.where(slow, np.array(CANDIDATES)[best], frames.time_constants)


def _misfits(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean square of each thermometer's innovations, an outlier's capped; infinite of hardly any."""
    read = np.isfinite(normal).sum(axis=0)
    total = np.nansum(np.minimum(normal * normal, CAP), axis=0)
    return np.where(read >= _READ, total / np.maximum(read, 1), np.inf)


def frames_and_skew(
    samples: list[Samples], tags: TagMap, station: Station,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> tuple[Frames, dict[str, float]]:  # fmt: skip
    """Frames of a record with clocks put right and the time constants of thermometers, and by how much clocks are fast.

    A slow thermometer looks much like one whose clock is late: where one is found clocks are compared once more.
    """
    skew = skew_of(samples, tags, station, progress)
    frames = frames_of(samples, skew)
    found = time_constants_of(frames, tags, station, progress)
    if np.array_equal(found, frames.time_constants):
        return frames, skew
    known = with_time_constants(tags, found)
    again = [replace(each, tag=tag) for each, tag in zip(samples, known.tags, strict=True)]
    skew = skew_of(again, known, station, progress)
    frames = frames_of(samples, skew)
    return replace(frames, time_constants=time_constants_of(frames, tags, station, progress)), skew


def with_time_constants(tags: TagMap, found: Sequence[float] | NDArray[np.float64]) -> TagMap:
    """The map whose thermometers have these time constants [s], those of TANKS."""
    of_sensor = {f"temperature_{tank}": float(value) for tank, value in zip(TANKS, found, strict=True)}
    return tags.model_copy(
        update={
            "tags": [
                tag.model_copy(update={"time_constant_s": of_sensor[tag.sensor]}) if tag.sensor in of_sensor else tag
                for tag in tags.tags
            ]
        }
    )
