"""Messages of a live twin: a sample every simulated second, and events."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cache
from typing import Any, Protocol

from station.columns import CODES, COUNTS, VALUES
from station.measured_second import HEALTHY, SensorState
from station.plants.interface import plant_named
from station.plants.thesis import THESIS

VERSION = 1
"""Of the documents; a reader refuses a version it does not know. The keys carry it too (`hrs/v1/...`)."""

COLUMNS = {**VALUES, **CODES, **COUNTS}
"""Name and unit of every figure that a sample of any plant has, in the order of a record's columns."""


MEASURED = "measured"
"""The layout of samples of a twin that follows measurements begins so; that of a simulated one is its plant's name."""

_OF_PLANT = f"{MEASURED}-"


def measured_layout(plant: str) -> str:
    """The layout of samples of a twin that follows a station of a plant."""
    return MEASURED if plant == THESIS.name else _OF_PLANT + plant


def is_measured(layout: str) -> bool:
    """Whether samples of a layout are of a twin that follows measurements."""
    return layout == MEASURED or layout.startswith(_OF_PLANT)


@cache
def sample_columns(layout: str) -> dict[str, str]:
    """Name and unit of every figure of a sample: of a plant COLUMNS, then the plant's own; else what is followed."""
    if is_measured(layout):
        from station.estimation.followed import followed_columns  # with the filter and its kernels

        plant = THESIS.name if layout == MEASURED else layout.removeprefix(_OF_PLANT)
        return {"time": "s", "source_time": "s", **followed_columns(plant)}
    return {**COLUMNS, **plant_named(layout).columns}


CERTIFIED, UNCERTIFIED = "certified", "uncertified"
"""Whether a verified certificate of service belongs to a twin's controller and station."""


class EventKind(StrEnum):
    """The kind of an event of a twin."""

    STARTED = "started"
    RESUMED = "resumed"  # after a restart of the service, from the last stored state
    ARRIVAL = "arrival"
    FILL_START = "fill_start"
    FILL_END = "fill_end"
    FILL_INCOMPLETE = "fill_incomplete"  # the vehicle left: nothing could be given to it any more, or it was too warm
    VALVE_CHANGE = "valve_change"
    SHIELD_REFUSAL = "shield_refusal"
    DEADLINE_MISSED = "deadline_missed"
    CONTROLLER_CHANGED = "controller_changed"
    SPEED_CHANGED = "speed_changed"
    VEHICLE_ADDED = "vehicle_added"
    PAUSED = "paused"
    CONTINUED = "continued"
    DAY_END = "day_end"  # figures of 86 400 simulated seconds
    FINISHED = "finished"  # the scenario is over
    STOPPED = "stopped"  # somebody stopped it
    DETECTED = "detected"  # measurements say that something fails, or has been found to since
    STATION_CHANGED = "station_changed"  # another station, which a calibration found, is followed from then on
    DRILL = "drill"  # a fault is put into the station, or those that are there are ended
    ALARM = "alarm"  # the state of an alarm has changed
    MEASUREMENTS_REFUSED = "measurements_refused"  # they were stored, but do not follow those before


@dataclass(frozen=True, slots=True)
class Sample:
    """One simulated second: the row of the record that begins at `time`."""

    twin: str
    epoch: int  # counts the (re)starts of the twin; a later epoch's sample replaces an earlier one's of the same seq
    seq: int  # row of the record, from 0
    sent: float | None  # Unix time [s]; None where a version that kept no time has stored it
    row: tuple[float, ...]  # one figure a column of `sample_columns`, NaN where there is none
    certification: str | None = None  # CERTIFIED or UNCERTIFIED; None where it is read from history
    layout: str = THESIS.name  # of its row: the plant of its station, or that of what is measured
    sensors: SensorState = HEALTHY  # faults of a simulated station's sensors; the row is what is true

    @property
    def columns(self) -> dict[str, str]:
        """Name and unit of each figure of its row."""
        return sample_columns(self.layout)

    def document(self) -> dict[str, Any]:
        """As JSON carries it: NaN becomes null, every other float keeps all its digits."""
        return {
            "version": VERSION,
            "twin": self.twin,
            "epoch": self.epoch,
            "seq": self.seq,
            "sent": self.sent,
            "service": self.certification,
            "values": {
                name: None if math.isnan(figure) else figure
                for name, figure in zip(self.columns, self.row, strict=True)
            },
        }


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened at simulated `time`."""

    twin: str
    epoch: int
    seq: int  # number among the twin's events, from 0
    sent: float  # Unix time [s]
    time: float  # simulated [s]
    kind: EventKind
    details: dict[str, Any] = field(default_factory=dict)

    def document(self) -> dict[str, Any]:
        """As JSON carries it."""
        return {
            "version": VERSION,
            "twin": self.twin,
            "epoch": self.epoch,
            "seq": self.seq,
            "sent": self.sent,
            "time": self.time,
            "kind": str(self.kind),
            "details": self.details,
        }


class TwinObserver(Protocol):
    """An observer of twins; called from a twin's own thread, so it must neither wait nor raise."""

    def opened(self, twin: str) -> None:
        """A twin has been started or resumed."""

    def sample(self, sample: Sample) -> None:
        """A second was simulated."""

    def event(self, event: Event) -> None:
        """Something happened."""

    def closed(self, twin: str) -> None:
        """A twin runs no longer in this process."""


def signals(sample: Sample) -> list[tuple[str, dict[str, Any]]]:
    """(name, document) of each figure of a sample."""
    about = {"version": VERSION, "twin": sample.twin, "epoch": sample.epoch, "seq": sample.seq, "sent": sample.sent}
    return [
        (name, {**about, "time": sample.row[0], "value": figure, "unit": unit})
        for (name, unit), figure in zip(sample.columns.items(), sample.row, strict=True)
    ]
