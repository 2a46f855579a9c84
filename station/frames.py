"""Samples brought to whole seconds, and nothing invented: what no sample tells of a second is NaN."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from station.archives import refuse_other_shapes
from station.errors import InputError
from station.geometry import TANKS, VALVES
from station.measurement import METER_CLASS, Samples, Tag, kind_of
from station.sensor_names import ANALOG, POWER, SENSORS

SECONDS_MAX = 40 * 86_400
"""Longest record [s]."""

RAW = 4
"""Columns of `Frames.raw`."""


@dataclass(frozen=True)
class Frames:
    """A record second by second."""

    start: float  # time of the first [s]
    values: NDArray[np.float64]  # (seconds, len(SENSORS)) NaN where nothing is known
    noise: NDArray[np.float64]  # (seconds, len(ANALOG)) standard deviation, absolute part
    relative: NDArray[np.float64]  # (len(ANALOG),) relative part, of flows alone
    measured: tuple[str, ...]  # sensors with a tag that is told second by second
    time_constants: NDArray[np.float64]  # (len(TANKS),) of the thermometers [s]
    # (seconds, RAW) of both flow meters: what was read before what they are off by was taken off, and what is known of
    # that from this second; None: nothing was taken off
    raw: NDArray[np.float64] | None = None
    meter_class: float = METER_CLASS  # of the flow meters: their readings are the scale of all masses [%]

    def __len__(self) -> int:
        return len(self.values)

    def __getitem__(self, sensor: str) -> NDArray[np.float64]:
        """The values of a sensor."""
        return self.values[:, SENSORS.index(sensor)]

    @property
    def usual_noise(self) -> NDArray[np.float64]:
        """The median of the noise of a channel's readings, (len(ANALOG),); 1 where there is none."""
        read = np.isfinite(self.values[:, : len(ANALOG)])
        return np.array([np.median(self.noise[read[:, c], c]) if read[:, c].any() else 1.0 for c in range(len(ANALOG))])

    @property
    def valves_told(self) -> float:
        """The part of the seconds in which any valve was told [1]."""
        first = SENSORS.index(VALVES[0])
        return float(np.isfinite(self.values[:, first : first + len(VALVES)]).any(axis=1).mean())

    @property
    def memory(self) -> NDArray[np.float64]:
        """The part that is left after a second of what a thermometer is behind, (len(TANKS),) [1]."""
        late = self.time_constants > 0.0
        return np.where(late, np.exp(-1.0 / np.where(late, self.time_constants, 1.0)), 0.0)

    def followed_by(self, later: Frames) -> Frames:
        """These seconds and those that follow them, of the same tags."""
        return Frames.joined([self, later])

    @classmethod
    def joined(cls, parts: Sequence[Frames]) -> Frames:
        """Seconds that follow each other, of the same tags, as one; at least one part."""
        values, noise = (np.concatenate([getattr(part, name) for part in parts]) for name in ("values", "noise"))
        none = all(part.raw is None for part in parts)
        raw = None if none else np.concatenate([part.as_read() for part in parts])
        return replace(parts[0], values=values, noise=noise, raw=raw)

    def blocks(self, length: int) -> Iterator[Frames]:
        """The seconds up to each whole number of blocks of a length [s], and those left; at least one part."""
        first = 0
        while first + (until := length - int(self.start + first) % length) < len(self):
            yield self.part(first, first + until)
            first += until
        yield self.part(first, len(self))

    def as_read(self) -> NDArray[np.float64]:
        """`raw`; NaN and 0 where there is none."""
        return np.tile((np.nan, np.nan, 0.0, 0.0), (len(self), 1)) if self.raw is None else self.raw

    def arrays(self) -> dict[str, np.ndarray]:
        """All of it, as arrays that `kept_frames` reads."""
        return {
            "start": np.array(self.start), "values": self.values, "noise": self.noise, "relative": self.relative,
            "measured": np.array(self.measured, np.str_), "time_constants": self.time_constants,
            "meter_class": np.array(self.meter_class),
        }  # fmt: skip

    def part(self, first: int, last: int) -> Frames:
        """The seconds from `first` up to `last`."""
        return Frames(
            self.start + first, self.values[first:last], self.noise[first:last], self.relative, self.measured,
            self.time_constants, None if self.raw is None else self.raw[first:last], self.meter_class,
        )  # fmt: skip


def kept_frames(arrays: dict[str, np.ndarray], told: tuple[str, ...] | None = None) -> Frames | None:
    """The seconds of `Frames.arrays`, of these sensors; None where nothing was kept.

    Raises
    ------
    InputError
        naming what no frames could have written.
    """
    if "start" not in arrays:
        return None
    count = len(arrays["values"]) if "values" in arrays and arrays["values"].ndim else 0
    channels = len(ANALOG)
    seconds = {"values": np.zeros((count, len(SENSORS))), "noise": np.zeros((count, channels))}
    sensors = {"relative": np.zeros(channels), "time_constants": np.zeros(len(TANKS))}
    refuse_other_shapes(arrays, {"start": np.zeros(()), "meter_class": np.zeros(()), **seconds, **sensors})
    measured = tuple(str(name) for name in arrays.get("measured", ()))
    if told is not None and measured != told:
        raise InputError("snapshot", [("measured", "cannot be read: other sensors were told")])
    values, noise, relative, late = (arrays[name] for name in (*seconds, *sensors))
    start, worse = float(arrays["start"]), float(arrays["meter_class"])
    return Frames(start, values, noise, relative, measured, late, meter_class=worse)


def as_kept_now(arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The arrays of `Frames.arrays` as another version wrote them, with what that one did not know of."""
    new = {"time_constants": np.zeros(len(TANKS)), "meter_class": np.array(METER_CLASS)}
    arrays = {**new, **arrays} if "start" in arrays else dict(arrays)
    values = arrays.get("values")
    if values is not None and values.ndim == 2 and values.dtype == np.float64:  # what no version wrote is left as it is
        missing = max(len(SENSORS) - values.shape[1], 0)  # versions up to 9 knew fewer sensors
        arrays["values"] = np.pad(values, ((0, 0), (0, missing)), constant_values=np.nan)
    return arrays


def frames_of(samples: list[Samples], skew: dict[str, float] | None = None) -> Frames:
    """Samples brought to whole seconds: of each sensor the one nearest to the second, within half a second of it.

    A sensor that is told when it changes has the last value told before the second's end, none after a bad
    sample, or where nothing at all came for a while.
    `skew` says by how much the clock of a source is fast [s]. Of two samples of one time the later in the file counts.

    Raises
    ------
    InputError
        if there is no time at all, or the record is longer than SECONDS_MAX.
    """
    given = np.concatenate([each.time[_counts(each)] for each in samples])
    if not len(given):
        raise InputError("record", [("", "must hold at least one sample with a time and a value")])
    start, length = np.floor(given.min()), int(np.ceil(given.max()) - np.floor(given.min())) + 1
    if length > SECONDS_MAX:
        raise InputError("record", [("time", f"must not span more than {SECONDS_MAX} s; given {length}")])
    values = np.full((length, len(SENSORS)), np.nan)
    noise = np.ones((length, len(ANALOG)))
    alive, told = np.zeros(length, np.bool_), np.zeros((length, len(SENSORS)), np.bool_)
    for each in samples:
        column = SENSORS.index(each.tag.sensor)
        place, rows = _nearest(each, start + (skew or {}).get(each.tag.source, 0.0), length)
        values[rows, column] = each.value[place]
        alive[rows] = True
        told[rows, column] = each.tag.on_change
        if column < len(ANALOG):
            noise[:, column] = each.tag.deviation if each.tag.on_change else 1.0
            noise[rows, column] = each.noise[place]
    tags = [each.tag for each in samples]
    lost = Listening().lost(alive)
    for column in (SENSORS.index(tag.sensor) for tag in tags if tag.on_change):
        hold(values[:, column], told[:, column], lost, np.nan)
    return _told_by(tags, float(start), values, noise)


def frames_of_seconds(start: float, values: NDArray[np.float64], tags: list[Tag]) -> Frames:
    """Seconds that were measured once and kept, as frames; of their qualities nothing is known: every one is good.

    Parameters
    ----------
    start : float
        Time of the first [s].
    values : ndarray, shape (seconds, len(SENSORS))
        In the sensors' units; NaN where nothing is known.
    tags : list of Tag
        What was measured, and with what noise.
    """
    noise = np.ones((len(values), len(ANALOG)))
    for tag in tags:
        if tag.sensor in ANALOG:
            noise[:, ANALOG.index(tag.sensor)] = tag.deviation
    return _told_by(tags, start, values, noise)


def _told_by(tags: list[Tag], start: float, values: NDArray[np.float64], noise: NDArray[np.float64]) -> Frames:
    relative, late = relative_noise(tags), time_constants(tags)
    return Frames(start, values, noise, relative, told_each_second(tags), late, meter_class=meter_class(tags))


def meter_class(tags: list[Tag]) -> float:
    """The worse class of the flow meters [%]; the usual one where there is none."""
    return max((tag.class_percent for tag in tags if kind_of(tag.sensor) == "flow"), default=METER_CLASS)


def relative_noise(tags: list[Tag]) -> NDArray[np.float64]:
    """Relative part of each channel's noise, shape (len(ANALOG),): of meters of flow, or of power instead."""
    relative = np.zeros(len(ANALOG))
    given = {tag.sensor: tag.noise_relative for tag in tags}
    relative[ANALOG.index("flow_compressor")] = given.get(POWER, 0.0)
    for sensor, noise in given.items():
        if kind_of(sensor) == "flow":
            relative[ANALOG.index(sensor)] = noise
    return relative


def time_constants(tags: list[Tag]) -> NDArray[np.float64]:
    """Time constant of each tank's thermometer [s], shape (len(TANKS),); 0 of one whose tag does not tell it."""
    known = {tag.sensor: tag.time_constant_s or 0.0 for tag in tags}
    return np.array([known.get(f"temperature_{tank}", 0.0) for tank in TANKS])


def told_each_second(tags: list[Tag]) -> tuple[str, ...]:
    """The sensors whose tags are told second by second: those of the others may be silent for long."""
    return tuple(tag.sensor for tag in tags if not tag.on_change)


@dataclass
class Listening:
    """How long nothing has come of any tag: then it may be that a change was not told."""

    silent: int = 0  # seconds in a row
    seconds: int = 0  # so far
    alive: int = 0  # of them with a sample

    def lost(self, alive: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """The seconds in which what was told before counts no more, of those that follow and have a sample or none."""
        if not len(alive):
            return alive
        place = np.arange(len(alive))
        silent = place - np.maximum.accumulate(np.where(alive, place, -1 - self.silent))
        heard = self.alive + np.cumsum(alive)
        interval = (self.seconds + place + 1) / np.maximum(heard, 1)
        self.silent, self.seconds, self.alive = int(silent[-1]), self.seconds + len(alive), int(heard[-1])
        found: NDArray[np.bool_] = silent >= np.maximum(SILENT, LONG * interval)
        return found


SILENT, LONG = 10.0, 4.0
"""A source has failed that tells nothing for so many seconds [s], and so many times as long as it mostly does."""


def hold(values: NDArray[np.float64], told: NDArray[np.bool_], lost: NDArray[np.bool_], before: float) -> float:
    """Let each value hold until the next one that is told, or until it counts no more; the last one.

    Parameters
    ----------
    values
        (seconds,) filled in here.
    told
        (seconds,) where there is one; NaN is one too.
    lost
        (seconds,) where what was told before counts no more.
    before
        The value before the first second.
    """
    if not len(values):
        return before
    values[lost & ~told] = np.nan
    last = np.maximum.accumulate(np.where(told | lost, np.arange(len(values)), -1))
    values[:] = np.where(last >= 0, values[last], before)
    return float(values[-1])


def second_of(
    time: NDArray[np.float64], start: NDArray[np.float64] | float, on_change: NDArray[np.bool_] | bool
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The second that each time is nearest to, counted from `start`, and a distance; shapes (k,).

    The smaller the distance the sooner a sample counts [s]: the nearest one, of tags told `on_change` the latest.
    """
    since = time - start
    second = np.floor(since + 0.5)
    off = since - second
    return second.astype(np.int64), np.where(on_change, 0.5 - off, np.abs(off))


def nearest(cell: NDArray[np.int64], distance: NDArray[np.float64]) -> NDArray[np.int64]:
    """Places of the samples that count, one a cell, in the order of cells: the nearest, of equal ones the last."""
    order = np.lexsort((-np.arange(len(cell)), distance, cell))
    return order[np.unique(cell[order], return_index=True)[1]]


def _counts(each: Samples) -> NDArray[np.bool_]:
    """Which samples count: those with a time and a value, and of a sensor told when it changes bad ones too."""
    return np.isfinite(each.time) & (np.isfinite(each.value) | each.tag.on_change)


def _nearest(each: Samples, start: float, length: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Which samples count, and the seconds they count for."""
    good = np.flatnonzero(_counts(each))
    second, distance = second_of(each.time[good], start, each.tag.on_change)
    inside = (second >= 0) & (second < length)
    good, second, distance = good[inside], second[inside], distance[inside]
    chosen = nearest(second, distance)
    return good[chosen], second[chosen]
