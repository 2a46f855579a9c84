"""Sources that tell a reading again until there is another one: nothing is told of it, and nothing is hidden."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest

from station import load_station
from station.estimation.clock import skew_of
from station.estimation.detection import detect
from station.estimation.filter import follow
from station.estimation.resting import held_for
from station.estimation.verdict import coarse_sensors, judged
from station.frames import frames_of
from station.measurement import samples_of
from station.sensor_names import ANALOG
from tests.station.estimation.hidden import day, hidden_real_station, hidden_station, measured, tags, truth

SECONDS, CARS, STICKS, LEAKS = 24_000, 11, 9000, 15_000
STATIONS = {"thesis-fit": hidden_station, "h70-light": hidden_real_station}
PARTS = {
    "all": tuple(ANALOG),
    "pressures": tuple(name for name in ANALOG if name.startswith("pressure")),
    "thermometers": tuple(name for name in ANALOG if name.startswith("temperature")),
    "meters": tuple(name for name in ANALOG if name.startswith("flow")),
    "vehicle": ("pressure_vehicle", "temperature_vehicle"),
}


@pytest.fixture(scope="module")
def records():
    """A day of each station, healthy and with a leak."""
    leak = {"kind": "leak", "buffer": "medium", "rate_g_per_s": 0.5, "begin_s": LEAKS, "end_s": SECONDS}
    hidden = {name: make(3, spread=0.005) for name, make in STATIONS.items()}
    return {
        (name, bool(faults)): day(station, CARS, SECONDS, faults=faults)
        for name, station in hidden.items()
        for faults in ([], [leak])
    }


def _held(table, sensors, every, step=None):
    """Sensors that are read every so many seconds, each in another one, in steps if wanted, and told in all of them."""
    for place, name in enumerate(sensors):
        values = table[name].to_numpy(zero_copy_only=False).astype(float)
        if step is not None and not name.startswith("flow"):
            values = np.round(values / step) * step
        second = np.arange(len(values))
        read = np.maximum((second - 7 * place % every) // every * every + 7 * place % every, 0)
        told = values[read]
        for k in np.flatnonzero(np.isnan(told) & ~np.isnan(values)):  # a reading that is missing: the one before
            told[k] = told[k - 1] if k else np.nan
        table = table.set_column(table.column_names.index(name), name, pa.array(told, from_pandas=True))
    return table


def _found(name, table):
    """Events, and why the model is refused."""
    known = load_station(name)
    frames = frames_of(samples_of(table, tags()))
    followed = follow(frames, known)
    events = detect(frames, followed, known.plant)
    coarse = coarse_sensors(frames.values, frames.usual_noise)
    return events, judged(followed, frames.start, events, coarse)[1]


@pytest.mark.parametrize("name", STATIONS)
@pytest.mark.parametrize("every", [2, 5, 20])
@pytest.mark.parametrize("part", PARTS)
def test_readings_told_again_say_nothing(name, every, part, records):
    """Held for 5 s they refused every model, and a day had dozens of clogged dispensers, weak compressors and leaks."""
    healthy = measured(truth(records[name, False], SECONDS), 3)
    assert _found(name, _held(healthy, PARTS[part], every)) == ([], [])


@pytest.mark.parametrize("name", STATIONS)
@pytest.mark.parametrize(("every", "within"), [(2, 200), (5, 200), (20, 900)])
def test_a_leak_is_found_by_them(name, every, within, records):
    events, why = _found(name, _held(measured(truth(records[name, True], SECONDS), 3), PARTS["all"], every))
    assert {event.name for event in events} == {"leak_medium"}
    assert LEAKS <= events[0].found_s <= LEAKS + within
    assert why == []


@pytest.mark.parametrize("name", STATIONS)
@pytest.mark.parametrize("step", [0.1, 0.5, 1.0])
@pytest.mark.parametrize("every", [5, 20])
def test_held_readings_in_steps_come_as_far_apart_as_they_mostly_do(name, every, step, records):
    """Of two that follow each other many are equal."""
    healthy = measured(truth(records[name, False], SECONDS), 3)
    table = _held(_held(healthy, PARTS["pressures"], every, step), PARTS["thermometers"], every, step / 2)
    assert _found(name, table) == ([], [])


@pytest.mark.parametrize("name", STATIONS)
@pytest.mark.parametrize("every", [5, 20])
def test_a_sensor_that_sticks_is_told_behind_them(name, every, records):
    table = _held(measured(truth(records[name, False], SECONDS), 3), PARTS["all"], every)
    values = table["pressure_medium"].to_numpy(zero_copy_only=False).astype(float).copy()
    values[STICKS:] = values[STICKS]
    table = table.set_column(table.column_names.index("pressure_medium"), "pressure_medium", pa.array(values))
    events, why = _found(name, table)
    assert [event.name for event in events] == ["frozen_pressure_medium"]
    assert events[0].found_s <= STICKS + max(60, 11 * every)
    assert why == []


@pytest.mark.parametrize("name", STATIONS)
def test_they_tell_no_second_of_a_clock(name, records):
    table = measured(truth(records[name, False], SECONDS), 3)
    for every, held in ((1, 1.0), (2, 2.0), (5, 5.0)):
        told = samples_of(_held(table, PARTS["all"], every), tags())
        found = [held_for(each.value) for each in told if each.tag.sensor == "pressure_high"]
        assert found == [held]
        if every > 1:
            assert skew_of(told, tags(), load_station(name)) == {"plc": 0.0, "transmitters": 0.0}
