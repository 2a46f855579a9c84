"""Detection of faults: limits in engineering units on the robust filter's states, and sensors that fail."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from station.archives import arrays_under, refuse_other_shapes
from station.errors import InputError
from station.estimation.detection_kernel import scan
from station.estimation.detection_memory import (
    DRIFTS,
    FACTOR_NOTHING,
    HEALTH,
    LEAK_NOTHING,
    NOISES,
    OFFSET_WINDOW,
    OFFSETS,
    PRECOOLER,
    SIGNALS,
    SIZED,
    STICKS,
    Memory,
    memory,
    note_lasting,
)
from station.estimation.drifting import FASTEST
from station.estimation.filter import model_of
from station.estimation.interface import Drifts, Followed
from station.estimation.valves.memory import STUCK
from station.frames import Frames
from station.geometry import BUFFERS, VALVES
from station.measurement import unit_of
from station.parameters import Station
from station.plants.interface import plant_named
from station.plants.thesis import THESIS
from station.sensor_names import ANALOG, BANK_SENSORS, DETECTABLE, HEARD, SENSORS

SIZE = 600
"""The size of an event is told from so many seconds, from where it was found."""

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
    "K",
)

_SIZED_LATER = frozenset((*range(SIZED), *range(DRIFTS, STICKS), PRECOOLER))


@dataclass(frozen=True)
class Event:
    """Something that is wrong."""

    name: str
    begin_s: float  # about when it began [s], in the record's time
    found_s: float  # when it was found [s]
    size: float
    unit: str
    settled: bool = True  # False: only found yet, and told again with the size that shows later


@dataclass(frozen=True)
class _Pending:
    """An event whose size is not told yet."""

    event: Event
    signal: int
    values: NDArray[np.float64]  # (k,) of the signal since it was found; NaN where there is none

    def settled(self) -> Event:
        """The event with the size that these values tell, if they tell any."""
        read = self.values[np.isfinite(self.values)]
        if self.signal < HEALTH:  # what has passed has its size from before
            nothing = FACTOR_NOTHING if self.signal >= HEALTH - 2 else LEAK_NOTHING
            passed = np.flatnonzero(read <= nothing)
            read = read[: max(int(passed[0]), 1)] if len(passed) else read
        size = _size(self.signal, read) if len(read) else self.event.size
        return replace(self.event, size=size, settled=True)


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
        self._mute = np.array([float(name in untellable(measured)) for name in DETECTABLE[: self._signals]])
        self._memory = memory(self._signals)
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
        events = [(each.signal, each.event.begin_s, each.event.found_s, each.event.size) for each in self._pending]
        values = np.full((len(self._pending), SIZE), np.nan)
        for row, each in zip(values, self._pending, strict=True):
            row[: len(each.values)] = each.values
        pending = {"pending": np.array(events, float).reshape(-1, 4), "values": values}
        lengths = np.array([len(each.values) for each in self._pending], np.int64)
        return {**pending, "lengths": lengths, **{f"memory_{k}": each for k, each in self._memory._asdict().items()}}

    def restore(self, arrays: dict[str, np.ndarray]) -> None:
        """Go on from the arrays of a detector of the same sensors.

        Raises
        ------
        InputError
            naming what no detector could have written.
        """
        remembered, fresh = arrays_under(arrays, "memory_"), memory(self._signals)
        refuse_other_shapes(remembered, fresh._asdict())
        count = len(arrays["lengths"]) if "lengths" in arrays and arrays["lengths"].ndim else 0
        like = {
            "pending": np.zeros((count, 4)),
            "values": np.zeros((count, SIZE)),
            "lengths": np.zeros(count, np.int64),
        }
        refuse_other_shapes(arrays, like)
        place, changes = remembered["beyond_place"], remembered["changes"]
        if not (((place >= 0) & (place < OFFSET_WINDOW)).all() and ((changes >= 0) & (changes < 2**53)).all()):
            raise InputError("snapshot", [("beyond_place", "cannot be read: it is none that a run could have written")])
        self._memory = Memory._make(remembered[name].copy() for name in Memory._fields)
        self._pending = []
        rows = zip(arrays["pending"].tolist(), arrays["lengths"].tolist(), arrays["values"], strict=True)
        for (number, begin, found, size), length, values in rows:
            signal = int(number)
            event = Event(DETECTABLE[signal], begin, found, size, _UNITS[signal], settled=False)
            self._pending.append(_Pending(event, signal, values[:length].copy()))

    def _scan(self, frames: Frames, followed: Followed) -> list[tuple[float, Event]]:
        """Events with the time at which they are told."""
        rows = len(followed.states)
        begins, firsts, sizes = (np.full((rows, self._signals), np.nan) for _ in range(3))
        lasting = np.zeros((rows, self._signals), np.bool_)
        self._lasting.append(lasting)
        drifts = followed.drifts or Drifts.of_nothing()
        stuck = np.zeros((0, STUCK)) if followed.stuck is None else np.ascontiguousarray(followed.stuck)
        zero = frames.start - float(self._memory.second[0])
        scan(
            np.ascontiguousarray(frames.values), np.ascontiguousarray(frames.noise), followed.innovations,
            followed.errors, followed.states, followed.deviations, self._measured, self._mute, followed.gate,
            self._small_leak, self._scale, (drifts.biases, drifts.begins, drifts.lasts, drifts.falls), stuck,
            self._memory, begins, firsts, sizes, lasting,
        )  # fmt: skip
        told: list[tuple[float, Event]] = []
        pending = [replace(each, values=_more(each.values, sizes[:, each.signal])) for each in self._pending]
        for row, signal in np.argwhere(~np.isnan(begins)).tolist():
            seen = frames.start + float(row)
            first = firsts[row, signal]
            later = signal in _SIZED_LATER
            size = _size(signal, np.array([first])) if later else float(first)
            event = Event(DETECTABLE[signal], zero + float(begins[row, signal]), seen, size, _UNITS[signal], not later)
            told.append((seen, event))
            if later:
                pending.append(_Pending(event, signal, _more(np.zeros(0), sizes[row:, signal])))
        self._pending = [each for each in pending if len(each.values) < SIZE]
        settled = [each.settled() for each in pending if len(each.values) == SIZE]
        return [*told, *((event.found_s + SIZE - 1, event) for event in settled)]


def untellable(measured: Collection[str]) -> set[str]:
    """Events that may come from the pressure of a bank which no tag tells: what it gives is not known then.

    Parameters
    ----------
    measured : collection of str
        Sensors that have a tag.
    """
    hidden = [bank for bank in BUFFERS if f"pressure_{bank}" not in measured]
    if not hidden:
        return set()
    given = ("pressure_vehicle", "temperature_vehicle", "flow_dispenser", "flow_compressor")
    own = {name for bank in hidden for name in (f"leak_{bank}", f"offset_temperature_{bank}")}
    kinds = {f"{kind}_{name}" for kind in ("offset", "noisy") for name in given}
    return {*own, *kinds, "leak_line", "dispenser_clogged", "precooler_weak"}


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


def _more(values: NDArray[np.float64], coming: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values and so many of those that come that there are SIZE at most."""
    return np.concatenate([values, coming[: SIZE - len(values)]])


def _size(signal: int, values: NDArray[np.float64]) -> float:
    """The size of an event: a state's or drift's median, an offset's mean, of noise the standard deviation added."""
    if signal < OFFSETS or signal >= DRIFTS:
        size = float(np.median(values))
        return 100 * size if HEALTH - 2 <= signal < OFFSETS else size
    mean = float(np.mean(values))
    return mean if signal < NOISES else float(np.sqrt(max(mean, 0.0)))
