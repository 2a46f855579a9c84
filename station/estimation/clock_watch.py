"""Clock skew while a station is followed: whether a source's readings fit better some seconds earlier or later.

As `station.estimation.clock` does it with a record, but of each block of seconds by itself, and only while it pays: at
the beginning, and where something seems to fail.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.archives import arrays_under, refuse_other_shapes
from station.errors import InputError
from station.estimation.clock import INTERVAL_MAX, LEAST, SOFT
from station.estimation.clock_shift import SKEW_MAX, columns_of, shifted
from station.estimation.filter import follow
from station.estimation.interface import CAP
from station.estimation.noise import LOUD
from station.estimation.resting import held_for
from station.frames import Frames, kept_frames, told_each_second
from station.measurement import TagMap, kind_of
from station.parameters import Station
from station.sensor_names import ANALOG, DETECTABLE

BLOCK = 150
"""Seconds of a block."""

LOOKED = 3600
"""So many seconds clocks are looked at from the beginning, and from where something seems to fail [s]."""

RENEWED = 1800
"""What seems to fail lets them be looked at anew, unless that began less long ago [s]."""

SETTLING = 120
"""Before these seconds a filter still learns [s]."""

GAIN, LEAD = 100.0, 30.0
"""What twice the logarithm of the likelihood must gain by a shift, and by how much it must lead any other."""

AGREEING, SHARE = 2, 40.0
"""So many blocks must have that shift as their best, and gain so much by it: one may hold a valve that gets stuck."""

ALIAS = 0.5
"""No shift fits far better than most do where it costs less than this part of what they cost in the median."""

READ = 30
"""A channel with fewer readings tells nothing."""

SHIFTS = tuple(range(-SKEW_MAX, SKEW_MAX + 1))

CHANNELS = np.array([place for place, sensor in enumerate(ANALOG) if kind_of(sensor) != "temperature"])
"""Channels that tell of clocks; a thermometer may be slow."""


class Skew(NamedTuple):
    """A clock that is found to be fast, against what it was taken for."""

    source: str
    shift: int  # [s]
    begin: float  # since when clocks were looked at [s]
    right: float | None  # when it was still right, as far as is known [s]


class ClockWatch:
    """Look for the shifts of sources' clocks in seconds that are followed.

    Parameters
    ----------
    station : Station
        As it is known.
    tags : TagMap
        What is measured, by sources.
    """

    def __init__(self, station: Station, tags: TagMap) -> None:
        _, *others = tags.sources
        self._station = station.model_copy(update={"calibrated": False})  # drift is not looked for
        self._told = told_each_second(tags.tags)
        columns = {source: columns_of(tags, source) for source in others}
        self._columns = {source: each for source, each in columns.items() if np.isin(CHANNELS, each).any()}
        self._lasting = np.zeros(len(DETECTABLE), np.bool_)
        self._seconds: Frames | None = None  # of this block, and before it what filters need
        self._fresh = 0  # how many are of this block
        self._begin = np.nan  # of the look [s]; NaN: clocks are not looked at
        self._ails = True  # whether something began to seem to fail in this block; the first one counts as such
        self._sums = np.zeros((len(self._columns), 2, len(SHIFTS), len(CHANNELS)))
        self._agreeing = np.zeros((len(self._columns), len(SHIFTS)))
        self._right = np.full(len(self._columns), np.nan)  # begins of the last blocks in which clocks were right [s]

    @property
    def looks(self) -> bool:
        """Whether there is a clock to be looked at."""
        return bool(self._columns)

    def watch(self, frames: Frames, lasting: NDArray[np.bool_]) -> None:
        """Take seconds that are followed, and which events last after each, (seconds, len(DETECTABLE))."""
        if not self.looks or not len(frames):
            return
        before = np.vstack((self._lasting, lasting[:-1]))
        self._ails = self._ails or bool((lasting & ~before).any())
        self._lasting = lasting[-1].copy()
        kept = frames if self._seconds is None else self._seconds.followed_by(frames)
        self._fresh += len(frames)
        first = max(0, len(kept) - self._fresh - SETTLING - 2 * SKEW_MAX)
        self._seconds = kept.part(first, len(kept))

    def end_block(self) -> Skew | None:
        """End a block, and give a clock that its seconds and those before show to be fast or slow, if any."""
        if self._seconds is None:
            return None
        seconds, fresh, ails = self._seconds, self._fresh, self._ails
        self._fresh, self._ails = 0, False
        end = seconds.start + len(seconds)
        if ails and not end - self._begin < RENEWED:
            self._begin = end - fresh
            self._sums[:], self._agreeing[:] = 0.0, 0.0
        if not end - self._begin <= LOOKED:
            self._begin = np.nan
            return None
        for place, (source, columns) in enumerate(self._columns.items()):
            if seconds.valves_told * INTERVAL_MAX < 1.0 or _interval(seconds, columns) > INTERVAL_MAX:
                continue
            misfits = [self._misfit(shifted(seconds, columns, shift), fresh) for shift in SHIFTS]
            block = np.stack(misfits, axis=1)
            if not _fits(block):
                continue
            self._sums[place] += block
            best, misfit = _best(block)
            self._agreeing[place, best] += misfit[SKEW_MAX] > SHARE
            if best == SKEW_MAX and np.sort(misfit)[1] > LEAD:
                self._right[place] = end - fresh
            best, misfit = _best(self._sums[place])
            agree = self._agreeing[place, best] >= AGREEING
            if misfit[SKEW_MAX] > GAIN and np.sort(misfit)[1] > LEAD and agree and not _aliased(best, misfit):
                right = float(self._right[place])
                return Skew(source, SHIFTS[best], self._begin, None if np.isnan(right) else right)
        return None

    def snapshot(self) -> dict[str, np.ndarray]:
        """Everything needed to go on, as arrays."""
        numbers = {"begin": np.array(self._begin), "fresh": np.array(self._fresh), "ails": np.array(self._ails)}
        kept = {} if self._seconds is None else self._seconds.arrays()
        seconds = {f"seconds_{name}": each for name, each in kept.items()}
        sums = {"sums": self._sums.copy(), "agreeing": self._agreeing.copy(), "right": self._right.copy()}
        return {**numbers, "lasting": self._lasting, **sums, **seconds}

    def restore(self, arrays: dict[str, np.ndarray]) -> None:
        """Go on from the arrays of one of the same station and tags.

        Raises
        ------
        InputError
            naming what none could have written.
        """
        numbers = {"begin": np.array(0.0), "fresh": np.array(0), "ails": np.array(True)}
        like = {"lasting": self._lasting, "sums": self._sums, "agreeing": self._agreeing, "right": self._right}
        refuse_other_shapes(arrays, {**numbers, **like})
        self._seconds = kept_frames(arrays_under(arrays, "seconds_"), self._told)
        self._begin, self._fresh, self._ails = (arrays[name].item() for name in numbers)
        if not 0 <= self._fresh <= (0 if self._seconds is None else len(self._seconds)):
            raise InputError(
                "snapshot", [("fresh", f"cannot be read: of so many seconds none were kept: {self._fresh}")]
            )
        self._lasting, self._sums, self._agreeing, self._right = (arrays[name].copy() for name in like)

    def _misfit(self, seconds: Frames, fresh: int) -> NDArray[np.float64]:
        """Sums of squares of each channel's innovations, an outlier's capped, and how many, (2, len(CHANNELS))."""
        known = seconds.part(SKEW_MAX, len(seconds) - SKEW_MAX)
        z = follow(known, self._station, SOFT).innovations[max(0, len(known) - fresh) :, CHANNELS]
        return np.stack((np.nansum(np.minimum(z * z, CAP), 0), np.isfinite(z).sum(0)))


def _fits(misfits: NDArray[np.float64]) -> bool:
    """Whether each channel that tells fits at some shift, of `_best`'s sums; else something fails besides clocks."""
    squares, counts = misfits
    telling = counts.min(0) > READ
    return bool(telling.any() and ((squares / np.maximum(counts, 1.0)).min(0)[telling] <= LOUD**2).all())


def _best(misfits: NDArray[np.float64]) -> tuple[int, NDArray[np.float64]]:
    """The place of the best shift, and by how much each fits worse, (len(SHIFTS),).

    Parameters
    ----------
    misfits : ndarray, shape (2, len(SHIFTS), len(CHANNELS))
        Sums of squares of innovations, and how many, of channels of which one at least tells.
    """
    squares, counts = misfits
    telling = counts.min(0) > READ
    mean = squares[:, telling] / counts[:, telling]
    misfit = counts.mean(0)[telling] @ np.log(mean + LEAST).T
    best = int(np.argmin(misfit))
    return best, misfit - misfit[best]


def _aliased(best: int, misfit: NDArray[np.float64]) -> bool:
    """Whether no shift fits far better than most do, and a second towards the best one worse than none.

    Where commands change every few seconds a shift by as many fits nearly as well as none.
    """
    none, towards = misfit[SKEW_MAX], misfit[SKEW_MAX + int(np.sign(best - SKEW_MAX))]
    others = np.delete(misfit, [best, SKEW_MAX])
    return bool(towards >= none and none < ALIAS * np.median(others))


def _interval(seconds: Frames, columns: NDArray[np.int64]) -> float:
    """Seconds between readings of the sensor of a source that reads most often; those told again are none."""
    readings = [seconds.values[:, place] for place in CHANNELS[np.isin(CHANNELS, columns)]]
    gaps = [held_for(each) / max(float(np.isfinite(each).mean()), 1e-9) for each in readings]
    return min(gaps)
