"""Sensors of a hidden day that are not as their tags say, and what is told of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pyarrow as pa

from station import load_station
from station.estimation.detection import Event, detect
from station.estimation.filter import follow
from station.estimation.interface import Followed
from station.estimation.verdict import coarse_sensors, judged
from station.frames import frames_of
from station.measurement import TagMap, samples_of
from station.sensor_names import ANALOG
from tests.station.estimation.hidden import hidden_real_station, hidden_station, tags

SECONDS, CARS, LEAKS = 24_000, 11, 15_000
"""Of the days [s], their vehicles, and when the leak of `leaking` ones begins [s]."""

STATIONS = {"thesis-fit": hidden_station, "h70-light": hidden_real_station}

PARTS = {
    "all": tuple(ANALOG),
    "pressures": tuple(name for name in ANALOG if name.startswith("pressure")),
    "thermometers": tuple(name for name in ANALOG if name.startswith("temperature")),
    "meters": tuple(name for name in ANALOG if name.startswith("flow")),
    "vehicle": ("pressure_vehicle", "temperature_vehicle"),
}


def told(name: str, table: pa.Table, of_tags: TagMap | None = None) -> tuple[list[Event], list[str], Followed]:
    """Events, why the model is refused, and the estimates."""
    known = load_station(name)
    frames = frames_of(samples_of(table, of_tags or tags()))
    followed = follow(frames, known)
    events = detect(frames, followed, known)
    coarse = coarse_sensors(frames.values, frames.usual_noise)
    return events, judged(followed, frames.start, events, coarse)[1], followed


def read_of(table: pa.Table, sensor: str) -> np.ndarray:
    """The readings of a sensor, to be changed; NaN for none."""
    return table[sensor].to_numpy(zero_copy_only=False).astype(float).copy()


def replaced(table: pa.Table, sensor: str, change: Callable[[np.ndarray], np.ndarray]) -> pa.Table:
    """The table with other readings of a sensor."""
    values = pa.array(change(read_of(table, sensor)), from_pandas=True)
    return table.set_column(table.column_names.index(sensor), sensor, values)


def held(table: pa.Table, sensors: Sequence[str], every: int, step: float | None = None) -> pa.Table:
    """Sensors that are read every so many seconds, each in another one, in steps if wanted, and told in all of them."""
    for place, name in enumerate(sensors):
        values = read_of(table, name)
        if step is not None and not name.startswith("flow"):
            values = np.round(values / step) * step
        second = np.arange(len(values))
        read = np.maximum((second - 7 * place % every) // every * every + 7 * place % every, 0)
        again = values[read]
        for k in np.flatnonzero(np.isnan(again) & ~np.isnan(values)):  # a reading that is missing: the one before
            again[k] = again[k - 1] if k else np.nan
        table = table.set_column(table.column_names.index(name), name, pa.array(again, from_pandas=True))
    return table
