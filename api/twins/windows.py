"""Windows of a twin's record: a stretch, whole or cut at hours, shifts or days since the twin's midnight."""

from __future__ import annotations

from enum import StrEnum
from itertools import pairwise
from typing import NamedTuple

from api.twins.days import DAY_S
from station import InputError, Station

HOUR_S = 3600
"""[s]"""

SPAN_MAX_S = 7 * DAY_S
"""Longest stretch whose figures are told at once [s]: a day of seconds takes a core a second or two."""

WINDOWS_MAX = 1000
"""Most windows that a stretch is cut into: 7 days of hours are 168."""


class By(StrEnum):
    """What a stretch is cut into."""

    WINDOW = "window"  # nothing: it is one
    HOUR = "hour"
    SHIFT = "shift"
    DAY = "day"


class Shifts(NamedTuple):
    """Shifts, one after the other from the twin's first midnight on."""

    length: int  # [s]
    first: int  # of the day when one begins [s]

    @classmethod
    def of(cls, station: Station, shift_h: int | None = None) -> Shifts:
        """Those of a station; `shift_h` is another length [h]."""
        own = station.shifts
        return cls((own.shift_h if shift_h is None else shift_h) * HOUR_S, own.first_h * HOUR_S)


class Window(NamedTuple):
    """Seconds from `first` on, before `end`."""

    first: int
    end: int


def stretch_of(begin: int, end: int, from_s: int | None, to_s: int | None) -> Window:
    """The stretch asked for, of a record of the seconds from `begin` to `end`; left out bounds are the record's.

    Raises
    ------
    InputError
        if it holds no second, or one that the record has not, or is too long.
    """
    first = begin if from_s is None else from_s
    last = end if to_s is None else to_s
    if first < begin:
        raise _wrong("from_s", f"must be at least {begin}: nothing older is kept; given {first}")
    if last > end:
        raise _wrong("to_s", f"must be at most {end}, the seconds told so far; given {last}")
    if last <= first:
        raise _wrong("to_s", f"must lie behind from_s = {first} s; given {last}")
    if last - first > SPAN_MAX_S:
        raise _wrong("to_s", f"must lie at most {SPAN_MAX_S} s behind from_s = {first} s; given {last}")
    return Window(first, last)


def windows_of(stretch: Window, by: By, shifts: Shifts) -> list[Window]:
    """The windows of a stretch, in order; the first and the last may be parts of an hour, a shift or a day.

    Raises
    ------
    InputError
        if there would be more than WINDOWS_MAX.
    """
    if by is By.WINDOW:
        return [stretch]
    length = {By.HOUR: HOUR_S, By.SHIFT: shifts.length, By.DAY: DAY_S}[by]
    begin = shifts.first % length if by is By.SHIFT else 0
    cuts = range(begin + ((stretch.first - begin) // length + 1) * length, stretch.end, length)
    if len(cuts) >= WINDOWS_MAX:
        raise _wrong("by", f"must cut the stretch into at most {WINDOWS_MAX} windows; {by} gives {len(cuts) + 1}")
    edges = [stretch.first, *cuts, stretch.end]
    return [Window(*pair) for pair in pairwise(edges)]


def _wrong(field: str, message: str) -> InputError:
    return InputError("query", [(field, message)])
