"""Measured seconds as a calibration's spec carries them: a Parquet file as text, every figure bit for bit."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np

from api.packing import plain, unpacked
from station.frames import Frames, frames_of_seconds
from station.measurement import TagMap
from station.sensor_names import SENSORS


def encoded_seconds(start: float, values: np.ndarray, tags: TagMap) -> dict[str, Any]:
    """Seconds from `start` [s] on, shape (seconds, len(SENSORS)), with what their tags are, as JSON carries them."""
    content = plain({name: np.ascontiguousarray(values[:, place]) for place, name in enumerate(SENSORS)})
    return {
        "start": start, "tags": tags.model_dump(mode="json", exclude_unset=True),
        "seconds": base64.b64encode(content).decode(),
    }  # fmt: skip


def decoded_frames(record: dict[str, Any]) -> Frames:
    """The seconds that `encoded_seconds` wrote."""
    columns = unpacked(base64.b64decode(record["seconds"]), SENSORS)
    tags = TagMap.model_validate(record["tags"])
    return frames_of_seconds(record["start"], _all_sensors(columns), tags.tags)


def _all_sensors(columns: dict[str, np.ndarray]) -> np.ndarray:
    """A column a sensor; NaN of one that an older version did not keep."""
    none = np.full(len(next(iter(columns.values()))), np.nan)
    return np.column_stack([columns.get(name, none) for name in SENSORS])
