"""The seconds of a foreign unit as readings of a measured twin that follows it."""

from __future__ import annotations

import math
import time
from typing import Any

from api.bridges.fmi.foreign_run import Row
from api.bridges.fmi.unit_map import Wiring
from api.bridges.measurements import ROWS_MAX, MeasurementSender
from api.client import Service
from station.measured_day import TOLD
from station.measurement import Tag, TagMap
from station.scenario import Scenario
from station.sensor_names import ANALOG

GATHER_S = 0.5
"""Readings wait at most so long to be sent together [s]."""

SOURCE = "fmu"
"""Under which name the service counts the batches."""


def tags_of(wiring: Wiring) -> TagMap:
    """The tag map of what a unit shows: a tag is called as its sensor; what it does not show has none."""
    names = [name for name in ANALOG if name in wiring.outputs]
    return TagMap(tags=[Tag(tag=name, column=name, sensor=name) for name in (*names, *TOLD)])


class TwinStream:
    """Sends each second to a measured twin that it starts, at a pace of the wall clock.

    Parameters
    ----------
    service
        At which the twin is started.
    twin
        Its id.
    scenario
        Whose station it follows.
    tags
        What the unit shows.
    speed
        Seconds of the run a second.

    Raises
    ------
    StationError
        if the service refuses, or does not answer.
    """

    def __init__(self, service: Service, twin: str, scenario: Scenario, tags: TagMap, speed: float) -> None:
        service.start(scenario, id=twin, source="measured", tags=tags.model_dump(mode="json", exclude_defaults=True))
        self._sender = MeasurementSender(service, twin, SOURCE)
        self._tags = [tag.tag for tag in tags.tags]
        self._speed, self._began = speed, time.monotonic()
        self._rows: list[dict[str, Any]] = []
        self._sent = self._began
        self.count = 0  # readings that are stored

    def tell(self, row: Row) -> None:
        """Send a second when its time has come."""
        values = [(tag, row[tag]) for tag in self._tags]
        self._rows += [
            {"tag": tag, "time": row["time"], "value": value} for tag, value in values if math.isfinite(value)
        ]
        due = self._began + row["time"] / self._speed
        now = time.monotonic()
        if max(due, now) - self._sent >= GATHER_S or len(self._rows) + len(self._tags) > ROWS_MAX:
            self.flush()
        time.sleep(max(0.0, due - time.monotonic()))

    def flush(self) -> None:
        """Send what waits."""
        if self._rows:
            self._sender.send(self._rows)
            self.count += len(self._rows)
            self._rows = []
        self._sent = time.monotonic()
