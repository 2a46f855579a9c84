"""What a live twin has told, read from the service second by second, complete and in order."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import orjson

from api.client import Twin
from api.files import write_whole
from api.twins.messages import EventKind
from station import InputError

SECONDS_MAX = 2000
"""Seconds of history that are read at once."""

_ALIVE = ("running", "paused")


class Place(NamedTuple):
    """How far a twin has been told."""

    born: str  # when it was started: another may have its id later
    sample: int  # next second
    event: int  # last event


class Second(NamedTuple):
    """A second of a twin's history."""

    epoch: int  # of the twin when it was read
    seq: int  # row of the record, from 0
    values: dict[str, Any]  # by column; None: there is none


class History:
    """The seconds and events of a twin behind a place, which moves as they are read.

    The service's history is read, not its stream: nothing is left out, however fast the twin.

    Parameters
    ----------
    twin
        To be read.
    file
        Keeps the place; left out: it begins with the newest second and the next event.

    Raises
    ------
    StationError
        if the file cannot be read, or the service does not answer.
    """

    def __init__(self, twin: Twin, file: Path | None = None) -> None:
        self._twin, self._file = twin, file
        state = twin.state()
        newest = Place(state["created"], max(state["samples"] - 1, 0), state["events"] - 1)
        self.place = _kept(file, state["created"]) or newest

    def is_over(self) -> bool:
        """Whether the twin has ended, and tells nothing more."""
        return self._twin.state()["state"] not in _ALIVE

    def events(self) -> Iterator[dict[str, Any]]:
        """The events there are; one that says that the service has begun anew moves the seconds back to where."""
        for event in self._twin.events(after=self.place.event):
            begin = self.place.sample
            if event["kind"] == EventKind.RESUMED:  # seconds behind the stored state are told anew
                begin = min(begin, math.ceil(event["time"]))
            self.place = self.place._replace(sample=begin, event=event["seq"])
            yield event

    def seconds(self) -> Iterator[Second]:
        """The next seconds there are, at most SECONDS_MAX."""
        epoch, begin = self._twin.state()["epoch"], self.place.sample
        series = self._twin.history(from_s=begin, to_s=begin + SECONDS_MAX - 1)
        columns = {name: column.tolist() for name, column in series.numpy().items()}
        for row in zip(*columns.values(), strict=True):
            values = {name: None if _is_nan(value) else value for name, value in zip(columns, row, strict=True)}
            seq = int(values["time"])  # type: ignore[arg-type]  # no row is without its time
            self.place = self.place._replace(sample=seq + 1)
            yield Second(epoch, seq, values)

    def columns(self) -> dict[str, str]:
        """Name and unit of each column."""
        return self._twin.history(from_s=0, to_s=0).units

    def keep(self, place: Place | None) -> None:
        """Write a place to the file, where there are both."""
        if self._file is not None and place is not None:
            write_whole(self._file, orjson.dumps(place._asdict()))


def _is_nan(value: Any) -> bool:
    return isinstance(value, float) and math.isnan(value)


def _kept(file: Path | None, born: str) -> Place | None:
    """The place that a file keeps; None where there is none, or the twin of that id is another now.

    Raises
    ------
    InputError
        if the file cannot be read.
    """
    if file is None or not file.exists():
        return None
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
        place = Place(str(found["born"]), int(found["sample"]), int(found["event"]))
    except (ValueError, KeyError, TypeError, OSError) as error:
        raise InputError(str(file), [("", f"cannot be read: {error!r}")]) from None
    return place if place.born == born else None
