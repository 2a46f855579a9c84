"""Detection of faults: limits in engineering units on the robust filter's states, and sensors that fail."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.archives import arrays_under, refuse_other_shapes
from station.errors import InputError
from station.estimation.beginnings import began
from station.estimation.detection_kernel import scan
from station.estimation.detection_memory import (
    CHANGED_LEAK,
    DRIFTS,
    FACTOR_NOTHING,
    HEALTH,
    LEAK_NOTHING,
    LINE,
    METER_DRIFTS,
    NOISES,
    OFFSET_WINDOW,
    OFFSETS,
    PRECOOLER,
    SEATS,
    SIGNALS,
    SIZED,
    STICKS,
    WARMER,
    Memory,
    memory,
    note_lasting,
)
from station.estimation.drifting import FASTEST
from station.estimation.filter import model_of
from station.estimation.interface import LEAK, Drifts, Followed
from station.estimation.line_balance import FOUND, LineMemory, balance_line, line_of_nothing
from station.estimation.valves.memory import METER, SEAT, STUCK
from station.frames import Frames
from station.geometry import BUFFERS, VALVES
from station.measurement import unit_of
from station.parameters import Station
from station.plants.interface import plant_named
from station.plants.thesis import THESIS
from station.sensor_names import ANALOG, BANK_SENSORS, DETECTABLE, HEARD, METERS, SENSORS, VEHICLE_SENSORS

SIZE = 600
"""The size of an event is told from so many seconds, from where it was found."""

CLOGGED = HEALTH - 1
"""Place of a clogged dispenser among the signals."""

_BLOCK = 3600  # seconds judged at once, so that long records need little memory

_UNITS = (
    *("g/s" for _ in BUFFERS),
    "%",
    "%",
    *(unit_of(name) for _ in range(3) for name in ANALOG),
    *("s" for _ in range(HEARD)),
    *(f"{unit_of(name)}/h" for name in BANK_SENSORS),
    *("" for _ in VALVES),
    "g/s",
    *("g/s/h" for _ in METERS),
    *("g/s" for _ in BUFFERS),
    "K",
)

_SIZED_LATER = frozenset((*range(SIZED), *range(DRIFTS, STICKS), LINE, *range(METER_DRIFTS, PRECOOLER + 1)))


@dataclass(frozen=True)
class Event:
    """Something that is wrong."""

    name: str
    begin_s: float  # about when it began [s], in the record's time
    found_s: float  # when it was found [s]
    size: float
    unit: str
    settled: bool = True  # False: only found yet, and told again with the size that shows later
    size_deviation: float | None = None  # standard deviation of the size, in its unit; None where it has none
    begin_low_s: float | None = None  # it began between these [s], as far as is known; None where nothing is known
    begin_high_s: float | None = None


_GAS_GOES = [*range(len(BUFFERS)), *range(STICKS, LINE), *range(METER_DRIFTS, SIGNALS)]
"""Events of leaks, valves and meters: what is weighed while one lasts is no sign of what the line loses."""


class _Shown(NamedTuple):
    """What is known of an event's begin when it is found."""

    since: float  # it shows [s]
    right: float  # there was last nothing of it [s]; -inf: never
    scale: float  # `EstimationModel.scale_of`

    def dated(self, event: Event, signal: int) -> Event:
        """The event with the time at which it began, by its size."""
        about, low, high = began(signal, self.since, event.found_s, self.right, event.size, self.scale)
        return replace(event, begin_s=about, begin_low_s=low, begin_high_s=high)


@dataclass(frozen=True)
class _Pending:
    """An event whose size is not told yet."""

    event: Event
    shown: _Shown
    signal: int
    values: NDArray[np.float64]  # (k,) of the signal since it was found; NaN where there is none
    deviations: NDArray[np.float64]  # (k,) of a state that these are, as the filter has it; else NaN

    def with_more(self, values: NDArray[np.float64], deviations: NDArray[np.float64]) -> _Pending:
        """The same with the values that follow, SIZE at most."""
        left = SIZE - len(self.values)
        return replace(
            self, values=np.concatenate([self.values, values[:left]]),
            deviations=np.concatenate([self.deviations, deviations[:left]]),
        )  # fmt: skip

    def settled(self) -> Event:
        """The event with the size that these values tell, if they tell any."""
        there = np.flatnonzero(np.isfinite(self.values))
        if self.signal < HEALTH:  # what has passed has its size from before
            nothing = FACTOR_NOTHING if self.signal >= HEALTH - 2 else LEAK_NOTHING
            passed = np.flatnonzero(self.values[there] <= nothing)
            there = there[: max(int(passed[0]), 1)] if len(passed) else there
        if not len(there):
            return replace(self.event, settled=True)
        size, deviation = _sized(self.signal, self.values[there], self.deviations[there])
        event = replace(self.event, size=size, settled=True, size_deviation=deviation)
        return self.shown.dated(event, self.signal)


class Detector:
    """Find events second by second: the same ones, however the seconds are split.

    An event is told twice where its size shows later: when it is found, with the size that it seems to have, and SIZE
    seconds later or at the end. `latest` takes the last word of each.

    Parameters
    ----------
    measured : sequence of str
        Sensors that have a tag; of others nothing is said.
    station : Station, optional
        As it is known. Where its parameters come from an accepted calibration smaller leaks are told. Left out: one of
        the thesis's plant that was not calibrated.
    """

    def __init__(self, measured: Sequence[str], station: Station | None = None) -> None:
        plant = THESIS.name if station is None else station.plant
        self._small_leak = np.full(len(BUFFERS), math.inf)
        self._scale = 1.0 if station is None else model_of(station).scale_of(station)
        if station is not None and station.calibrated:
            self._small_leak = smallest_leaks(station)
        self._measured = np.array([float(sensor in measured) for sensor in SENSORS[:HEARD]])
        self._signals = SIGNALS + plant_named(plant).precools
        mute = [untellable(measured, () if station is None else station.unknown_buffers)]
        mute += [untellable({*measured} - {f"pressure_{bank}"}) for bank in BUFFERS]
        self._mute = np.array([[float(name in each) for name in DETECTABLE[: self._signals]] for each in mute])
        self._memory, self._line = memory(self._signals), line_of_nothing()
        self._meters = {*METERS} <= {*measured}
        self._pending: list[_Pending] = []
        self._lasting: list[NDArray[np.bool_]] = []

    @property
    def active(self) -> tuple[str, ...]:
        """Names of the events that last, in order."""
        lasting = np.zeros(self._signals, np.bool_)
        note_lasting(self._memory, lasting)
        return tuple(sorted(DETECTABLE[k] for k in np.flatnonzero(lasting)))

    @property
    def lasting(self) -> NDArray[np.bool_]:
        """Which events last after each of the seconds fed last, (seconds, len(DETECTABLE))."""
        found = np.concatenate([np.zeros((0, self._signals), np.bool_), *self._lasting])
        return np.pad(found, ((0, 0), (0, len(DETECTABLE) - self._signals)))

    def feed(self, frames: Frames, followed: Followed) -> list[Event]:
        """Events found in the seconds that follow those fed so far, or whose size shows in them; as they are found."""
        found: list[tuple[float, Event]] = []
        self._lasting = []
        for at in range(0, len(followed.states), _BLOCK):
            found += self._scan(frames.part(at, at + _BLOCK), followed.part(at, at + _BLOCK))
        return [event for _, event in sorted(found, key=lambda each: (each[0], each[1].name, each[1].found_s))]

    def finish(self) -> list[Event]:
        """Events whose size is told from fewer seconds than SIZE, there being no later ones."""
        pending, self._pending = self._pending, []
        return [each.settled() for each in pending]

    def snapshot(self) -> dict[str, np.ndarray]:
        """Everything needed to go on, as arrays."""
        events = [
            (
                each.signal, each.shown.since, each.shown.right, each.event.found_s, each.event.size,
                _number(each.event.size_deviation),
            )
            for each in self._pending
        ]  # fmt: skip
        values, deviations = (np.full((len(self._pending), SIZE), np.nan) for _ in range(2))
        for row, deviation, each in zip(values, deviations, self._pending, strict=True):
            row[: len(each.values)], deviation[: len(each.values)] = each.values, each.deviations
        pending = {"pending": np.array(events, float).reshape(-1, 6), "values": values, "deviations": deviations}
        lengths = np.array([len(each.values) for each in self._pending], np.int64)
        memories = {f"memory_{name}": each for name, each in self._memory._asdict().items()}
        line = {f"line_{name}": each for name, each in self._line._asdict().items()}
        return {**pending, "lengths": lengths, **memories, **line}

    def restore(self, arrays: dict[str, np.ndarray]) -> None:
        """Go on from the arrays of a detector of the same sensors.

        Raises
        ------
        InputError
            naming what no detector could have written.
        """
        remembered, fresh = arrays_under(arrays, "memory_"), memory(self._signals)
        refuse_other_shapes(remembered, fresh._asdict())
        line = arrays_under(arrays, "line_")
        refuse_other_shapes(line, self._line._asdict())
        count = len(arrays["lengths"]) if "lengths" in arrays and arrays["lengths"].ndim else 0
        like = {
            "pending": np.zeros((count, 6)),
            "values": np.zeros((count, SIZE)),
            "deviations": np.zeros((count, SIZE)),
            "lengths": np.zeros(count, np.int64),
        }
        refuse_other_shapes(arrays, like)
        place, changes = remembered["beyond_place"], remembered["changes"]
        if not (((place >= 0) & (place < OFFSET_WINDOW)).all() and ((changes >= 0) & (changes < 2**53)).all()):
            raise InputError("snapshot", [("beyond_place", "cannot be read: it is none that a run could have written")])
        self._memory = Memory._make(remembered[name].copy() for name in Memory._fields)
        self._line = LineMemory._make(line[name].copy() for name in LineMemory._fields)
        self._pending = []
        kept = (arrays["pending"].tolist(), arrays["lengths"].tolist(), arrays["values"], arrays["deviations"])
        for (number, since, right, found, size, deviation), length, values, deviations in zip(*kept, strict=True):
            signal, shown = int(number), _Shown(since, right, self._scale)
            spread = None if math.isnan(deviation) else deviation
            event = shown.dated(Event(DETECTABLE[signal], since, found, size, _UNITS[signal], False, spread), signal)
            self._pending.append(_Pending(event, shown, signal, values[:length].copy(), deviations[:length].copy()))

    def _scan(self, frames: Frames, followed: Followed) -> list[tuple[float, Event]]:
        """Events with the time at which they are told."""
        rows = len(followed.states)
        begins, firsts, rights, sizes = (np.full((rows, self._signals), np.nan) for _ in range(4))
        lasting = np.zeros((rows, self._signals), np.bool_)
        self._lasting.append(lasting)
        drifts = followed.drifts or Drifts.of_nothing()
        stuck = np.zeros((0, STUCK)) if followed.stuck is None else np.ascontiguousarray(followed.stuck)
        zero = frames.start - float(self._memory.second[0])
        scan(
            np.ascontiguousarray(frames.values), np.ascontiguousarray(frames.noise), followed.innovations,
            followed.errors, followed.states, followed.deviations, self._measured, self._mute, followed.gate,
            self._small_leak, self._scale, (drifts.biases, drifts.begins, drifts.lasts, drifts.falls), stuck,
            self._memory, begins, firsts, rights, sizes, lasting,
        )  # fmt: skip
        told: list[tuple[float, Event]] = []
        deviations = _deviations(frames, followed, self._signals)
        self._weigh_line(frames, followed, begins, firsts, lasting, rights, sizes, deviations)
        pending = [each.with_more(sizes[:, each.signal], deviations[:, each.signal]) for each in self._pending]
        for row, signal in np.argwhere(~np.isnan(begins)).tolist():
            seen = frames.start + float(row)
            first = firsts[row, signal]
            later = signal in _SIZED_LATER
            size, deviation = float(first), None
            if later:
                size, deviation = _sized(signal, np.array([first]), deviations[row : row + 1, signal])
            shown = _Shown(zero + float(begins[row, signal]), zero + float(rights[row, signal]), self._scale)
            event = Event(DETECTABLE[signal], shown.since, seen, size, _UNITS[signal], not later, deviation)
            event = shown.dated(event, signal)
            told.append((seen, event))
            if later:
                nothing = _Pending(event, shown, signal, np.zeros(0), np.zeros(0))
                pending.append(nothing.with_more(sizes[row:, signal], deviations[row:, signal]))
        self._pending = [each for each in pending if len(each.values) < SIZE]
        settled = [each.settled() for each in pending if len(each.values) == SIZE]
        return [*told, *((event.found_s + SIZE - 1, event) for event in settled)]

    def _weigh_line(
        self, frames: Frames, followed: Followed, begins: NDArray[np.float64], firsts: NDArray[np.float64],
        lasting: NDArray[np.bool_], rights: NDArray[np.float64], sizes: NDArray[np.float64],
        deviations: NDArray[np.float64],
    ) -> None:  # fmt: skip
        """Fill in what the line loses while it is told to leak, and when it was tight, where both meters are read.

        One that has grown or shrunk is found again.
        """
        if not self._meters:
            return
        found, told = np.full((len(lasting), FOUND), np.nan), np.ascontiguousarray(lasting[:, LINE])
        others: NDArray[np.bool_] = np.logical_or.reduce(lasting[:, _GAS_GOES], axis=1)
        values, rows = np.ascontiguousarray(frames.values), len(lasting)
        seconds = float(self._memory.second[0]) - rows + np.arange(rows)
        ago, least = seconds - begins[:, LINE], self._scale * CHANGED_LEAK
        balance_line(values, followed.states, followed.deviations, told, ago, others, self._line, found, least)
        sizes[:, LINE], deviations[:, LINE], tight, changed, same = found.T
        again = np.isnan(ago) & ~np.isnan(changed)
        begins[again, LINE], firsts[again, LINE] = (seconds - changed)[again], sizes[again, LINE]
        right = np.where(again, same, tight)
        rights[:, LINE] = np.where(np.isnan(right), -np.inf, seconds - right)


def untellable(measured: Collection[str], unknown: Collection[str] = ()) -> set[str]:
    """Events that may come from a bank of which nobody knows what it gives, or how large it is.

    Parameters
    ----------
    measured : collection of str
        Sensors that have a tag.
    unknown : collection of str
        Banks whose volumes a calibration did not come to know.
    """
    hidden = [bank for bank in BUFFERS if f"pressure_{bank}" not in measured]
    lost = {f"{name}_{bank}" for bank in (*hidden, *unknown) for name in ("leak", "leak_outlet", "offset_temperature")}
    if not hidden:
        return lost
    kinds = {f"{kind}_{name}" for kind in ("offset", "noisy") for name in (*VEHICLE_SENSORS, *METERS)}
    return {*lost, *kinds, "leak_line", "dispenser_clogged", "precooler_weak"}


def smallest_leaks(station: Station) -> NDArray[np.float64]:
    """Of each bank of a calibrated station, the loss beyond which a leak is told [g/s]: less may be a drift."""
    model = model_of(station)
    falls = FASTEST / 3600 * np.array(model.grams_of(station))
    return np.maximum(falls, model.scale_of(station) * model.small_leak)


def detect(frames: Frames, followed: Followed, station: Station | None = None) -> list[Event]:
    """Every event of a record that was followed with the robust filter, in the order in which they were found."""
    detector = Detector(frames.measured, station)
    return latest([*detector.feed(frames, followed), *detector.finish()])


def latest(events: Iterable[Event]) -> list[Event]:
    """The last word of each event that was told, in the order in which they were found."""
    told = {(event.found_s, event.name): event for event in events}
    return [told[key] for key in sorted(told)]


def _deviations(frames: Frames, followed: Followed, signals: int) -> NDArray[np.float64]:
    """Standard deviations of signals without those of single readings, (seconds, signals); NaN of others."""
    rows = len(followed.states)
    found = np.full((rows, signals), np.nan)
    found[:, :HEALTH] = followed.deviations[:, LEAK : LEAK + HEALTH]
    with np.errstate(invalid="ignore", divide="ignore"):  # what the model expects is as uncertain as innovations say
        expected = np.square(followed.errors / followed.innovations) - np.square(frames.noise[:rows])
    found[:, OFFSETS:NOISES] = np.sqrt(np.maximum(expected, 0.0))
    if followed.stuck is not None and len(followed.stuck):
        found[:, SEATS:PRECOOLER] = followed.stuck[:rows, SEAT + 3 * len(BUFFERS) : METER]
    if signals > PRECOOLER:
        found[:, PRECOOLER] = followed.deviations[:, WARMER]
    return found


def _number(value: float | None) -> float:
    return math.nan if value is None else value


def _sized(
    signal: int, values: NDArray[np.float64], deviations: NDArray[np.float64]
) -> tuple[float, float | None]:  # fmt: skip
    """The size of an event and its standard deviation, if it has one, from values of its signal.

    A drift's median; a state's too, of the later half, since an estimate takes time to reach what it is of; an offset's
    mean; of noise the standard deviation added. Errors of what a filter knows last, so that many values are no better
    than one; those of single readings do not. What a clogged dispenser has lost shows as long as it gives alone: how
    far that was learned no deviation tells.
    """
    if signal < OFFSETS or signal >= SEATS or signal == LINE:
        later = slice(len(values) // 2, None)
        scale = 100.0 if HEALTH - 2 <= signal < OFFSETS else 1.0
        size = scale * float(np.median(values[later]))
        known = deviations[later][np.isfinite(deviations[later])]
        return size, scale * float(np.mean(known)) if signal != CLOGGED and len(known) else None
    if signal >= DRIFTS:
        return float(np.median(values)), None
    mean, count = float(np.mean(values)), len(values)
    error = float(np.std(values, ddof=1)) / math.sqrt(count) if count > 1 else math.nan
    if signal < NOISES:
        error = math.hypot(error, float(np.nanmean(deviations)) if np.isfinite(deviations).any() else math.nan)
        return mean, None if math.isnan(error) else error
    size = math.sqrt(max(mean, 0.0))
    return size, error / (2.0 * size) if size > 0.0 and count > 1 else None
