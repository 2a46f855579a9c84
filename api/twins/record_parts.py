"""The record of a twin in parts of bounded size, with the columns that figures need, simulated or measured."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from api.http.timeseries import Selection
from api.twins.messages import is_measured
from api.twins.minutes import MINUTE_S, RESOLUTION
from station.columns import CODES
from station.geometry import BUFFERS, VALVES
from station.plants.interface import plant_named

PART_S = 21_600
"""Seconds read at once: some 5 MB of columns."""

MASSES = tuple(f"mass_{buffer}" for buffer in BUFFERS)

_COUNTED = ("flow_dispenser", *CODES, "queue_length", "vehicle")
"""Columns of every simulated record that figures are counted from."""

_READ = (*VALVES, "flow_dispenser", "vehicle")
"""What of them is measured; of a measured record the others are not known."""

_AT_FIRST = {"vehicle": -1.0}
"""What is taken of a reading before the first; 0 of any other."""


class History(Protocol):
    """Reads a stretch of a twin's history; see `api.twins.queries.TwinQueries`."""

    def columns(self, twin_id: str, chosen: Selection) -> dict[str, np.ndarray]:
        """The columns chosen."""

    def layout(self, twin_id: str) -> str:
        """The layout of the twin's samples."""


class Part(NamedTuple):
    """Rows of a record that follow one another: seconds, or minutes where no more is kept."""

    table: dict[str, np.ndarray]  # columns of _COUNTED, and the plant's powers [kW]
    spans: NDArray[np.float64]  # what each row stands for [s]
    masses: NDArray[np.float64]  # (rows, 3) of the buffers [g]; NaN in a measured record
    unread: NDArray[np.bool_]  # in which rows a reading is missing, and the one before is taken

    @property
    def time(self) -> NDArray[np.float64]:
        """When each row begins [s]."""
        return self.table["time"]


def powers_of(layout: str) -> list[str]:
    """Columns of electric power [kW] in a record of a layout, compressor first; none where no account is kept."""
    return [] if is_measured(layout) else plant_named(layout).powers


def parts(history: History, twin_id: str, first: int, last: int) -> Iterator[Part]:
    """The rows that begin in the seconds from `first` to `last`, both included, in order."""
    layout = history.layout(twin_id)
    readings = _Readings() if is_measured(layout) else None
    names = tuple(map("measured_{}".format, _READ)) if readings else (*_COUNTED, *MASSES, *powers_of(layout))
    for begin in range(first - first % PART_S, last + 1, PART_S):
        bounds = max(first, begin), min(last, begin + PART_S - 1)
        found = history.columns(twin_id, Selection((*names, RESOLUTION), float(bounds[0]), float(bounds[1])))
        if not len(found["time"]):
            continue
        spans = _spans(found["time"], found[RESOLUTION])
        if readings is None:
            masses = np.column_stack([found[name] for name in MASSES])
            yield Part(found, spans, masses, np.zeros(len(spans), np.bool_))
        else:
            table, unread = readings.held(found)
            yield Part(table, spans, np.full((len(spans), len(BUFFERS)), np.nan), unread)


def _spans(time: NDArray[np.float64], resolution: NDArray[np.float64]) -> NDArray[np.float64]:
    """What each row stands for [s]: a second; of a minute what of it was thinned together, which the next row ends."""
    ends = np.where(resolution == 1.0, time + 1.0, (np.floor(time / MINUTE_S) + 1.0) * MINUTE_S)
    ends[:-1] = np.minimum(ends[:-1], time[1:])
    return np.asarray(ends - time)


class _Readings:
    """Measured columns as those of a simulated record; where a reading is missing the one before is taken."""

    def __init__(self) -> None:
        self._last: dict[str, float] = {}

    def held(self, found: dict[str, np.ndarray]) -> tuple[dict[str, np.ndarray], NDArray[np.bool_]]:
        """The columns, and in which rows one was missing."""
        rows = len(found["time"])
        table = {name: np.zeros(rows) for name in _COUNTED}
        unread = np.zeros(rows, np.bool_)
        for name in _READ:
            column = found[f"measured_{name}"].astype(float)
            missing = np.isnan(column)
            unread |= missing
            known = np.maximum.accumulate(np.where(missing, -1, np.arange(rows)))
            last = self._last.get(name, _AT_FIRST.get(name, 0.0))
            held = np.where(known >= 0, column[known], last)
            self._last[name] = float(held[-1])
            table[name] = (held > 0.5).astype(float) if name in VALVES else held
        return {**table, "time": found["time"]}, unread
