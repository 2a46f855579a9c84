"""Readings of nodes: what a data value says, and values that hold on because nothing new was told."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from datetime import UTC, datetime
from enum import StrEnum
from typing import Any, NamedTuple

from asyncua import ua

HALF_S = 0.5
"""A reading counts for a second that is at most so far away [s]."""

LAG_S = 1.5
"""A second is completed when a reading is so much younger: by then all of it has been told [s]."""


class Quality(StrEnum):
    """The quality of a reading, as `POST /v1/twins/{id}/measurements` has it."""

    GOOD = "good"
    UNCERTAIN = "uncertain"
    BAD = "bad"


class Reading(NamedTuple):
    """A value of a tag."""

    tag: str
    time: float  # of its source, Unix time [s]
    value: float | None  # None: it is no number
    quality: Quality

    def row(self) -> dict[str, Any]:
        """As the service takes it."""
        return {"tag": self.tag, "time": self.time, "value": self.value, "quality": str(self.quality)}


def reading_of(tag: str, data: ua.DataValue) -> Reading:
    """The reading that a data value is, at the time of its source, else of the server, else now."""
    moment = data.SourceTimestamp or data.ServerTimestamp or datetime.now(UTC)
    value = None if data.Value is None else data.Value.Value
    if isinstance(value, bool | int | float) and math.isfinite(value):
        return Reading(tag, moment.timestamp(), float(value), _quality(data.StatusCode))
    return Reading(tag, moment.timestamp(), None, Quality.BAD)


def _quality(status: ua.StatusCode | None) -> Quality:
    """The severity of a status code: its two highest bits."""
    if status is None or status.is_good():
        return Quality.GOOD
    return Quality.UNCERTAIN if status.is_uncertain() else Quality.BAD


class Holding:
    """Completes seconds: a server tells changes, and a value that it does not tell anew holds on.

    In each whole second for which some tag has a reading, a tag without one is given its last value, unless that was
    bad. A second for which no tag has any stays empty: the server was away.
    """

    def __init__(self) -> None:
        self._told: dict[str, deque[Reading]] = {}  # of each tag: what counts for a second to come, after what holds
        self._done: int | None = None  # the last second that is complete

    def push(self, readings: Iterable[Reading]) -> list[Reading]:
        """Readings in the order of time, and what holds on beside them."""
        fresh = list(readings)
        for reading in fresh:
            self._told.setdefault(reading.tag, deque()).append(reading)
        if not fresh:
            return []
        newest = max(reading.time for reading in fresh)
        if self._done is None:
            self._done = math.floor(min(reading.time for reading in fresh)) - 1
        last = math.floor(newest - LAG_S)
        seconds = sorted(
            {round(each.time) for told in self._told.values() for each in told if self._done < round(each.time) <= last}
        )
        held = [reading for second in seconds for reading in self._held(second)]
        self._done = max(self._done, last)
        return fresh + held

    def _held(self, second: int) -> Iterable[Reading]:
        """Values that hold on in a second."""
        for tag, told in self._told.items():
            while len(told) > 1 and told[1].time <= second + HALF_S:
                told.popleft()
            held = told[0]
            if held.time < second - HALF_S and held.quality is not Quality.BAD:
                yield Reading(tag, float(second), held.value, held.quality)
