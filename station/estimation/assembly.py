"""Seconds out of batches: a second is closed by the time of the data alone, so that a replay gives the same bytes."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.archives import refuse_other_shapes
from station.batches import Batch
from station.errors import InputError
from station.estimation.clock_shift import SKEW_MAX
from station.frames import (
    Frames,
    Listening,
    hold,
    meter_class,
    nearest,
    relative_noise,
    second_of,
    time_constants,
    told_each_second,
)
from station.measurement import TagMap
from station.sensor_names import ANALOG, SENSORS

LATENESS = 5.0
"""A second is closed when the newest sample of each source is so much younger than its end [s]; of a source that is
behind others by more than a clock may be, no sample is waited for."""

LATENESS_MAX = 600.0
"""Most that it may be [s]."""

AHEAD_MAX = 600.0
"""A sample so far ahead of the newest is refused, unless most tags of its batch have gone on as far [s]."""

GAP_MAX = 86_400.0
"""A batch may bring the newest time forward by at most so much [s]."""


class Counts(NamedTuple):
    """Samples since the beginning, by what became of them; the sum is that of all that came but for `duplicate`."""

    taken: int = 0
    late: int = 0  # their second was closed, or before the first
    empty: int = 0  # bad, no number, or outside what the sensor can read; not of tags told when they change
    ahead: int = 0  # too far in the future of all others
    duplicate: int = 0  # of those taken: of the tag and time of another that was held


class _Open(NamedTuple):
    """Samples that count so far for seconds that are not closed, one a cell."""

    cell: NDArray[Any]  # (k,) second times the number of tags, and place of the tag
    distance: NDArray[Any]  # (k,) of `second_of` [s]
    time: NDArray[Any]  # (k,) [s]
    value: NDArray[Any]  # (k,)
    noise: NDArray[Any]  # (k,)


class Assembler:
    """Bring batches to whole seconds: those of `frames_of` over all samples that were taken, byte for byte.

    Parameters
    ----------
    tags : TagMap
        What the tags of batches are. A tag that is silent is measured all the same.
    skew : dict, optional
        By how much the clock of a source is fast [s].
    lateness : float
        How long samples are waited for, by the time of the data [s].

    Raises
    ------
    InputError
        naming a lateness outside its limits.
    """

    def __init__(self, tags: TagMap, skew: dict[str, float] | None = None, lateness: float = LATENESS) -> None:
        if not 0 <= lateness <= LATENESS_MAX:
            raise InputError("assembly", [("lateness", f"must lie from 0 to {LATENESS_MAX:g} s; given {lateness:g}")])
        self._tags = tags
        self._columns = np.array([SENSORS.index(tag.sensor) for tag in tags.tags])
        self._measured = told_each_second(tags.tags)
        self._on_change = np.array([tag.on_change for tag in tags.tags])
        self._last = np.full(len(tags.tags), np.nan)
        self._listening = Listening()
        self._silent = np.ones(len(ANALOG))  # noise of a second without a sample
        for tag in tags.tags:
            if tag.on_change and tag.sensor in ANALOG:
                self._silent[ANALOG.index(tag.sensor)] = tag.deviation
        self._relative, self._time_constants = relative_noise(tags.tags), time_constants(tags.tags)
        self._meter_class = meter_class(tags.tags)
        self._skew = np.array([(skew or {}).get(tag.source, 0.0) for tag in tags.tags])
        lag = np.array([tag.lag_s for tag in tags.tags])
        # the newest time is of a tag whose clock is fast or whose lag is small; others come so much later
        self._hold = lateness + max(float((self._skew - lag).max() + lag.max()), 0.0)
        self._sources = np.array([tags.sources.index(tag.source) for tag in tags.tags])
        self._newest_of = np.full(len(tags.sources), -np.inf)  # sample of each source [s]
        self._start: float | None = None
        self._newest = -np.inf
        self._closed = 0
        self._counts = Counts()
        self._open = _Open(np.zeros(0, np.int64), *(np.zeros(0) for _ in range(4)))

    @property
    def counts(self) -> Counts:
        """Counts of the samples so far, by what became of them."""
        return self._counts

    @property
    def newest(self) -> float | None:
        """Time of the newest sample taken [s]; None before the first."""
        return None if self._start is None else self._newest

    @property
    def next_second(self) -> float | None:
        """Time of the first second that is not closed [s]; None before the first sample."""
        return None if self._start is None else self._start + self._closed

    def push(self, batch: Batch) -> Frames | None:
        """Take a batch, and give the seconds that it closes; None before there is a first second.

        Raises
        ------
        InputError
            if the batch has a tag that the map does not have, or lies too far ahead; nothing is taken then.
        """
        samples = batch.samples(self._tags)
        tag = np.repeat(np.arange(len(samples)), [len(each.time) for each in samples])
        time, value, noise = (
            np.concatenate([getattr(each, name) for each in samples]) for name in ("time", "value", "noise")
        )
        read = np.isfinite(value) | self._on_change[tag]
        counts = self._counts._replace(empty=self._counts.empty + int((~read).sum()))
        tag, time, value, noise = tag[read], time[read], value[read], noise[read]
        if not len(time):
            self._counts = counts
            return None if self._start is None else self._take(0, self._start)
        start, first, last = self._bounds(tag, time)
        ahead = time > last
        second, distance = second_of(time, start + self._skew[tag], self._on_change[tag])
        late = ~ahead & ((time < first) | (second < self._closed))
        taken = ~ahead & ~late
        newest = max(self._newest, float(time[~ahead].max()))
        if newest - max(self._newest, start) > GAP_MAX:
            given = f"given {newest - max(self._newest, start):.0f}"
            raise InputError("batch", [("time", f"must not go on by more than {GAP_MAX:.0f} s at once; {given}")])
        cell = second[taken] * len(samples) + tag[taken]
        new = (cell, distance[taken], time[taken], value[taken], noise[taken])
        held = _Open(*(np.concatenate(pair) for pair in zip(self._open, new, strict=True)))
        self._counts = counts._replace(
            taken=counts.taken + int(taken.sum()),
            late=counts.late + int(late.sum()),
            ahead=counts.ahead + int(ahead.sum()),
            duplicate=counts.duplicate + _duplicates(held),
        )
        chosen = nearest(held.cell, held.distance)
        self._open = _Open(*(each[chosen] for each in held))
        self._start, self._newest = start, newest
        np.maximum.at(self._newest_of, self._sources[tag[~ahead]], time[~ahead])
        heard = self._newest_of[self._newest_of >= newest - SKEW_MAX].min()  # of sources whose clocks may be apart
        return self._take(max(int(np.floor(heard - self._hold - start + 0.5)) - self._closed, 0), start)

    def close(self) -> Frames | None:
        """The seconds that are not closed, up to the newest sample's; None where there was no sample."""
        if self._start is None:
            return None
        return self._take(int(np.ceil(self._newest) - self._start) + 1 - self._closed, self._start)

    def snapshot(self) -> dict[str, np.ndarray]:
        """Everything needed to go on, as arrays."""
        start = np.nan if self._start is None else self._start
        numbers = np.array([start, self._newest, float(self._closed)])
        counts = np.array(self._counts, np.int64)
        return {
            "numbers": numbers,
            "counts": counts,
            "newest_of": self._newest_of.copy(),
            "last": self._last.copy(),
            "heard": self._heard(),
            **self._open._asdict(),
        }

    def _heard(self) -> NDArray[np.int64]:
        return np.array([self._listening.silent, self._listening.seconds, self._listening.alive], np.int64)

    def restore(self, arrays: dict[str, np.ndarray]) -> None:
        """Go on from the arrays of an assembler of the same tags, skew and lateness.

        Raises
        ------
        InputError
            naming what no assembler could have written.
        """
        count = len(arrays["cell"]) if "cell" in arrays and arrays["cell"].ndim else 0
        like = {name: np.zeros(count, np.int64 if name == "cell" else np.float64) for name in _Open._fields}
        numbers = {"numbers": np.zeros(3), "counts": np.zeros(len(Counts()), np.int64), "last": self._last}
        numbers["newest_of"] = self._newest_of
        refuse_other_shapes(arrays, {**numbers, "heard": self._heard(), **like})
        start, newest, closed = arrays["numbers"].tolist()
        self._start = None if np.isnan(start) else start
        self._newest, self._closed, self._newest_of = newest, int(closed), arrays["newest_of"].copy()
        self._listening = Listening(*arrays["heard"].tolist())
        self._counts, self._last = Counts(*arrays["counts"].tolist()), arrays["last"].copy()
        self._open = _Open(*(arrays[name].copy() for name in _Open._fields))

    def _bounds(self, tag: NDArray[np.int64], time: NDArray[np.float64]) -> tuple[float, float, float]:
        """Time of the first second, and the first and last time that can be taken [s]."""
        if self._start is not None:
            reference = max(self._newest, _median([time[tag == each].max() for each in np.unique(tag)]))
            return self._start, self._start, _chain(time, reference, 1.0)
        newest = _median([time[tag == each].max() for each in np.unique(tag)])
        oldest = _median([time[tag == each].min() for each in np.unique(tag)])
        first = _chain(time, oldest, -1.0)
        start = float(np.floor(first))
        return start, start, _chain(time, newest, 1.0)

    def _take(self, count: int, start: float) -> Frames:
        """Close so many seconds."""
        values = np.full((count, len(SENSORS)), np.nan)
        noise = np.tile(self._silent, (count, 1))
        second, tag = np.divmod(self._open.cell, len(self._columns))
        row = second - self._closed
        closing = row < count
        column = self._columns[tag[closing]]
        values[row[closing], column] = self._open.value[closing]
        analog = column < len(ANALOG)
        noise[row[closing][analog], column[analog]] = self._open.noise[closing][analog]
        lost = self._listening.lost(np.isin(np.arange(count), row))
        for place in np.flatnonzero(self._on_change):
            told = np.isin(np.arange(count), row[tag == place])
            self._last[place] = hold(values[:, self._columns[place]], told, lost, self._last[place])
        frames = Frames(
            start + self._closed, values, noise, self._relative, self._measured, self._time_constants,
            meter_class=self._meter_class,
        )  # fmt: skip
        self._open = _Open(*(each[~closing] for each in self._open))
        self._closed += count
        return frames


def _median(times: list[float]) -> float:
    """The lower median."""
    return float(np.sort(times)[(len(times) - 1) // 2])


def _chain(time: NDArray[np.float64], reference: float, sign: float) -> float:
    """How far times reach from a reference without a step of more than AHEAD_MAX; `sign` -1: backward."""
    beyond = np.sort(sign * time[sign * time > sign * reference])
    reached = np.r_[sign * reference, beyond]
    steps = np.flatnonzero(np.diff(reached) > AHEAD_MAX)
    return float(sign * reached[steps[0] if len(steps) else -1])


def _duplicates(held: _Open) -> int:
    """Samples with the cell and the time of one before them."""
    order = np.lexsort((held.time, held.cell))
    cell, time = held.cell[order], held.time[order]
    return int(((cell[1:] == cell[:-1]) & (time[1:] == time[:-1])).sum())
