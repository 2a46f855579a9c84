"""Detection of faults: limits in engineering units on the robust filter's states, and sensors that fail."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from station.estimation.filter import STATES, Followed
from station.geometry import BUFFERS
from station.measurement import ANALOG, Frames, kind_of, unit_of

LEAK_LIMIT = 0.15
"""A buffer that loses so much leaks [g/s]."""

FACTOR_LIMIT = 0.9
"""A compressor that gives less than this part of what it should is weak, a dispenser clogged [1]."""

SIGNIFICANT = 4.0
"""By so many standard deviations a state must be off as well."""

FROZEN = 60
"""A sensor that reads one value to the last digit so often in a row is frozen."""

OFFSET_WINDOW = 60
"""A sensor most of whose last readings, so many, lie beyond the filter's gate is off."""

NOISELESS = 0.1
"""A sensor whose innovations spread no more has no noise [1]: at rest it says one value all the time."""

SETTLING = 600
"""Seconds from the beginning in which states of health are not judged: the filter still learns them."""

_HOLD = 300  # an event ends when it was not seen for so long [s]
_LEAK_NOTHING, _FACTOR_NOTHING = 0.03, 0.02  # an event begins where a state was last so small [g/s, 1]
_SIZE = 600  # the size of an event is the median over so long from where it was found [s]


@dataclass(frozen=True)
class Event:
    """Something that is wrong."""

    name: str
    begin_s: float  # about when it began [s], in the record's time
    found_s: float  # when it was found [s]
    size: float
    unit: str


def detect(frames: Frames, followed: Followed) -> list[Event]:
    """Every event of a record that was followed with the robust filter, in the order in which they were found."""
    found = [*_leaks(frames, followed), *_weak(frames, followed)]
    for channel, name in enumerate(ANALOG):
        if name in frames.measured:
            is_noisy = np.nanstd(followed.innovations[:, channel]) > NOISELESS
            frozen = _frozen(frames, channel, name) if is_noisy else []
            found += frozen or _offset(frames, followed, channel, name)
    return sorted(found, key=lambda event: (event.found_s, event.name))


def _leaks(frames: Frames, followed: Followed) -> Iterator[Event]:
    for name in BUFFERS:
        leak, spread = _state(followed, f"leak_{name}")
        seen = (leak > LEAK_LIMIT) & (leak > SIGNIFICANT * spread)
        for first, _last in _spells(seen):
            size = float(np.median(leak[first : first + _SIZE]))
            begin = _begin(leak, first, _LEAK_NOTHING)
            yield Event(f"leak_{name}", frames.start + begin, frames.start + first, size, "g/s")


def _weak(frames: Frames, followed: Followed) -> Iterator[Event]:
    for state, name in (("compressor_factor", "compressor_weak"), ("dispenser_factor", "dispenser_clogged")):
        factor, spread = _state(followed, state)
        seen = (factor < FACTOR_LIMIT) & (1 - factor > SIGNIFICANT * spread)
        for first, _last in _spells(seen):
            loss = 1 - float(np.median(factor[first : first + _SIZE]))
            begin = _begin(1 - factor, first, _FACTOR_NOTHING)
            yield Event(name, frames.start + begin, frames.start + first, 100 * loss, "%")


def _state(followed: Followed, name: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    place = STATES.index(name)
    return followed.states[:, place], followed.deviations[:, place]


def _spells(seen: NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """First and last second of each spell after SETTLING; gaps shorter than _HOLD do not end one."""
    places = np.flatnonzero(seen)
    places = places[places >= SETTLING]
    if not len(places):
        return
    cuts = np.flatnonzero(np.diff(places) > _HOLD)
    for first, last in zip(np.r_[0, cuts + 1], np.r_[cuts, len(places) - 1], strict=True):
        yield int(places[first]), int(places[last])


def _begin(values: NDArray[np.float64], found: int, level: float) -> int:
    """The last second before `found` at which a value was not above a level: the filter begins to see it there."""
    before = np.flatnonzero(values[:found] <= level)
    return int(before[-1]) if len(before) else 0


def _frozen(frames: Frames, channel: int, name: str) -> list[Event]:
    """Spells in which a reading is the same to the last digit; a flow of nothing is none."""
    values = frames.values[:, channel]
    places = np.flatnonzero(np.isfinite(values))
    if kind_of(name) == "flow":
        places = places[values[places] != 0.0]
    read = values[places]
    changes = np.r_[0, np.flatnonzero(np.diff(read) != 0) + 1, len(read)]
    if len(read) < FROZEN or np.median(np.diff(changes)) > 2:  # it is read in coarse steps
        return []
    found = []
    for first, end in pairwise(changes):
        if end - first >= FROZEN:
            begin, seen = places[first], places[first + FROZEN - 1]
            found.append(Event(f"frozen_{name}", frames.start + float(begin), frames.start + float(seen),
                               float(read[first]), unit_of(name)))  # fmt: skip
    return found


def _offset(frames: Frames, followed: Followed, channel: int, name: str) -> Iterator[Event]:
    """Spells in which most readings lie beyond the gate; the size is their mean error."""
    z = followed.innovations[:, channel]
    places = np.flatnonzero(np.isfinite(z))
    beyond = np.abs(z[places]) > followed.gate
    if len(places) < OFFSET_WINDOW:
        return
    share = np.convolve(beyond, np.ones(OFFSET_WINDOW), "full")[: len(places)] / OFFSET_WINDOW
    seen = np.zeros(len(z), bool)
    seen[places[share > 0.5]] = True
    for first, last in _spells(seen):
        spell = places[(places >= first - 2 * OFFSET_WINDOW) & (places <= last) & (np.abs(z[places]) > followed.gate)]
        size = float(np.mean(followed.errors[spell, channel]))
        yield Event(f"offset_{name}", frames.start + float(spell[0]), frames.start + first, size, unit_of(name))
