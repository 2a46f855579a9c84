"""Compile what follows a station before it is needed: some minutes for a gas that is real, once for a version."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from station.batches import Batch
from station.estimation.followed import FollowedRun
from station.estimation.interface import FIRST_SECONDS
from station.geometry import VALVES
from station.measurement import Tag, TagMap
from station.preset_files import load_station
from station.sensor_names import ANALOG

PRESETS = ("thesis-fit", "h70-light")
"""A station of each plant that is followed."""

_AT_REST = {"pressure": 500.0, "temperature": 25.0, "flow": 0.0}
_SENSORS = (*ANALOG, *VALVES, "vehicle")


def compile_followers() -> Iterator[str]:
    """Follow a station of each plant for a minute at rest, which compiles the kernels; the plants, one by one."""
    tags = TagMap(tags=[Tag(tag=name, column=name, sensor=name) for name in _SENSORS])
    values = [-1.0 if name == "vehicle" else _AT_REST.get(name.partition("_")[0], 0.0) for name in _SENSORS]
    seconds = FIRST_SECONDS + 2
    count = seconds * len(_SENSORS)
    batch = Batch(
        np.tile(np.arange(len(_SENSORS)), seconds), np.repeat(np.arange(float(seconds)), len(_SENSORS)),
        np.tile(values, seconds), np.full(count, 2),
    )  # fmt: skip
    for preset in PRESETS:
        station = load_station(preset)
        run = FollowedRun(station, tags)
        run.push(batch)
        run.finish()
        yield station.plant
