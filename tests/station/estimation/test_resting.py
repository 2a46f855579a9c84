"""Sensors that stick at one value: they are told, say nothing against the model, and hide no leak."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest

from station import load_station
from station.estimation.detection import detect
from station.estimation.filter import follow
from station.estimation.verdict import judged
from station.frames import frames_of
from station.geometry import BUFFERS
from station.measurement import samples_of
from tests.station.estimation.hidden import day, hidden_real_station, hidden_station, measured, tags, truth

SECONDS, CARS, STUCK, LEAKS = 24_000, 11, 7000, 15_000
STATIONS = {"thesis-fit": hidden_station, "h70-light": hidden_real_station}


def _followed(name, sensor, record):
    """What is found where a sensor sticks at what it read in a second."""
    table = measured(truth(record, SECONDS), 3)
    values = table[sensor].to_numpy(zero_copy_only=False).astype(float).copy()
    values[STUCK:] = values[STUCK - 10 : STUCK][np.isfinite(values[STUCK - 10 : STUCK])][-1]
    table = table.set_column(table.column_names.index(sensor), sensor, pa.array(values, from_pandas=True))
    known = load_station(name)
    frames = frames_of(samples_of(table, tags()))
    followed = follow(frames, known)
    events = detect(frames, followed, known)
    return followed, events, judged(followed, frames.start, events)[1]


@pytest.mark.parametrize("name", STATIONS)
@pytest.mark.parametrize("sensor", ["temperature_high", "temperature_medium", "temperature_low", "pressure_medium"])
def test_a_bank_is_followed_without_a_sensor_that_sticks(name, sensor):
    record = day(STATIONS[name](3, spread=0.005), CARS, SECONDS)
    followed, events, why = _followed(name, sensor, record)
    assert [event.name for event in events] == [f"frozen_{sensor}"]
    assert abs(events[0].begin_s - STUCK) <= 10
    assert why == []
    known = 0.01 if sensor.startswith("temperature") else 0.02  # without a pressure what flows is summed up for hours
    for place, buffer in enumerate(BUFFERS):
        true = record[f"mass_{buffer}"][len(followed.states) - 3600 : len(followed.states)]
        off = followed.states[-3600:, place] - true
        assert np.sqrt(np.mean(off**2)) < known * true.mean()


@pytest.mark.parametrize("name", STATIONS)
@pytest.mark.parametrize("buffer", BUFFERS)
def test_a_leak_is_found_behind_a_thermometer_that_sticks(name, buffer):
    leak = {"kind": "leak", "buffer": buffer, "rate_g_per_s": 0.5, "begin_s": LEAKS, "end_s": SECONDS}
    record = day(STATIONS[name](3, spread=0.005), CARS, SECONDS, faults=[leak])
    _, events, _ = _followed(name, f"temperature_{buffer}", record)
    found = [event for event in events if not event.name.startswith("frozen_")]
    assert {event.name for event in found} == {f"leak_{buffer}"}
    assert LEAKS <= found[0].found_s <= LEAKS + 300
    assert found[0].size == pytest.approx(0.5, abs=0.15)
