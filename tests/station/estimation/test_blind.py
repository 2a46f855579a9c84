"""Stretches in which nobody tells who is connected, or what valves do: no leak is made of what was given in them."""

from __future__ import annotations

from functools import cache

import numpy as np
import pyarrow as pa
import pytest

from station import load_station
from station.estimation.detection import detect
from station.estimation.filter import follow
from station.estimation.verdict import judged
from station.frames import frames_of
from station.geometry import BUFFERS, VALVES
from station.measurement import samples_of
from station.sensor_names import ANALOG
from tests.station.estimation.hidden import day, hidden_real_station, hidden_station, measured, tags, truth

SECONDS, CARS = 24_000, 11
STATIONS = {"thesis-fit": hidden_station, "h70-light": hidden_real_station}
SILENT = {
    "vehicle": ("vehicle",),
    "commands": (*VALVES, "vehicle"),
    "outlets": VALVES[3:],
    "inlets": VALVES[:3],
    "all": (*ANALOG, *VALVES, "vehicle"),
    "all but transmitters of pressure": (*ANALOG[4:], *VALVES, "vehicle"),
}


@cache
def _day(name):
    """A station half a percent off in other air, its record, and the second in which a vehicle comes."""
    record = day(STATIONS[name](3, spread=0.005), CARS, SECONDS)
    came = np.flatnonzero(np.diff(record["vehicle"][:SECONDS]) > 0) + 1
    return record, int(came[came > 9000][0])


def _silenced(name, sensors, begin, seconds):
    """What is found where sensors say nothing for so long, from a second on; and the record."""
    record, came = _day(name)
    table = measured(truth(record, SECONDS), 3)
    begin += came
    for sensor in sensors:
        values = table[sensor].to_numpy(zero_copy_only=False).astype(float).copy()
        values[begin : begin + seconds] = np.nan
        place = table.column_names.index(sensor)
        table = table.set_column(place, sensor, pa.array(values, from_pandas=True))
    known = load_station(name)
    frames = frames_of(samples_of(table, tags()))
    followed = follow(frames, known)
    events = detect(frames, followed, known)
    return record, followed, events, judged(followed, frames.start, events)[1]


@pytest.mark.parametrize("name", STATIONS)
@pytest.mark.parametrize("seconds", [15, 150, pytest.param(1500, marks=pytest.mark.slow)])
@pytest.mark.parametrize("sensors", SILENT.values(), ids=SILENT)
def test_what_is_given_unseen_is_no_leak(name, seconds, sensors):
    for begin in (-30, 20):  # before the vehicle comes, and while it is filled
        record, followed, events, why = _silenced(name, sensors, begin, seconds)
        assert [event.name for event in events if not event.name.startswith("absent_")] == []
        assert why == []
        rows = len(followed.states)
        last = slice(rows - 3600, rows)
        for place, buffer in enumerate(BUFFERS):
            off = followed.states[last, place] - record[f"mass_{buffer}"][last]
            assert np.sqrt(np.mean(off**2)) < 0.01 * record[f"mass_{buffer}"][last].mean()
