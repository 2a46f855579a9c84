"""A station's readings for tests of twins that follow measurements, and what following them must give."""

from __future__ import annotations

from functools import cache

import numpy as np

from api.twins.schemas import TwinRequest
from station import load_scenario
from station.batches import Batch
from station.estimation.followed import FollowedRun
from station.geometry import VALVES
from station.measurement import TagMap
from station.sensor_names import ANALOG

BEGIN = 1_795_252_800.0
"""Time of the first reading: Unix time [s]."""

NAMES = (*ANALOG, *VALVES, "vehicle")
TAGS = {"tags": [{"tag": f"T.{name}", "column": name, "sensor": name} for name in NAMES]}
TAG_MAP = TagMap.model_validate(TAGS)
ORDER = {"scenario": "S1", "source": "measured", "tags": TAGS}
"""A twin that follows measurements, but for its id."""

_USUAL = {"pressure": (300.0, 303.0), "temperature": (20.0, 21.0), "flow": (0.0, 20.0)}


@cache
def readings(seconds: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Tags, times and values of seconds of readings at random, a reading of each tag a second, in order."""
    rng = np.random.default_rng(26)
    time = np.repeat(np.arange(float(seconds)), len(NAMES))
    tag = np.tile(np.arange(len(NAMES)), seconds)
    bounds = np.array([_USUAL.get(name.partition("_")[0], (0.0, 0.7)) for name in NAMES])
    value = rng.uniform(bounds[tag, 0], bounds[tag, 1])
    vehicle = tag == len(NAMES) - 1
    value[vehicle] = time[vehicle] // 90 - 1
    value[rng.random(len(value)) < 0.05] = np.nan
    return tag, BEGIN + time + 0.1, value


def batches(seconds: int, each: int = 1) -> list[Batch]:
    """The readings of so many seconds, a batch for `each` seconds."""
    step, (tag, time, value) = each * len(NAMES), readings(seconds)
    parts = [slice(begin, begin + step) for begin in range(0, len(tag), step)]
    return [Batch(tag[part], time[part], value[part], np.full(len(tag[part]), 2)) for part in parts]


def rows(batch: Batch) -> list[dict[str, object]]:
    """The rows of a batch, as JSON carries them."""
    return [
        {"tag": f"T.{NAMES[tag]}", "time": time, "value": None if np.isnan(value) else value}
        for tag, time, value in zip(batch.tag.tolist(), batch.time.tolist(), batch.value.tolist(), strict=True)
    ]


def followed(sent: list[Batch], *, finish: bool = False) -> np.ndarray:
    """The rows of a run that follows batches and is never killed, without their numbers."""
    run = FollowedRun(load_scenario("S1").station, TAG_MAP)
    found = [run.push(batch) for batch in sent] + ([run.finish()] if finish else [])
    return np.concatenate([np.column_stack((part.time, part.table())) for part in found])


def measured(**more: object) -> TwinRequest:
    """A twin `m` that follows measurements."""
    return TwinRequest.model_validate({"id": "m", "scenario": "S1", "source": "measured", "tags": TAGS, **more})
