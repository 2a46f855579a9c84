"""Sensors noisier than their tags say, and sensors that read in steps: nothing else is told, and nothing is hidden."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from station import load_station
from station.estimation.clock import skew_of
from station.estimation.resting import coarse_channels
from station.geometry import BUFFERS
from station.measurement import samples_of
from station.sensor_names import ANALOG
from tests.station.estimation.hidden import measured, tags, truth
from tests.station.estimation.sensors import LEAKS, SECONDS, STATIONS, replaced, told

BEGINS = 7000
NOISE = {"pressure": 1.0, "temperature": 0.5}
"""Of the record [bar], [K]; of flows 2 %."""


def _noisy(table, sensor, times):
    """A sensor so many times as noisy as before, from a second on."""
    random = np.random.default_rng(99)
    spread = np.sqrt(times**2 - 1)

    def change(values):
        more = random.standard_normal(len(values) - BEGINS)
        kind = sensor.partition("_")[0]
        values[BEGINS:] += spread * (NOISE[kind] if kind in NOISE else 0.02 * values[BEGINS:]) * more
        return values

    return replaced(table, sensor, change)


@pytest.mark.parametrize("name", STATIONS)
@pytest.mark.parametrize("times", [3.0, pytest.param(10.0, marks=pytest.mark.slow)])
@pytest.mark.parametrize("sensor", ANALOG)
def test_noise_is_told_as_noise_alone(name, times, sensor, records):
    """Ten times the noise of a pressure gave a dozen leaks a day, that of a flow meter a clogged dispenser."""
    events, why, followed = told(name, _noisy(measured(truth(records[name, False], SECONDS), 3), sensor, times))
    assert [event.name for event in events] == [f"noisy_{sensor}"]
    assert why == []
    for place, buffer in enumerate(BUFFERS):
        true = records[name, False][f"mass_{buffer}"][: len(followed.states)]
        assert np.abs(followed.states[-3600:, place] / true[-3600:] - 1).max() < 0.02


@pytest.mark.parametrize("name", STATIONS)
@pytest.mark.parametrize(("sensor", "within"), [("pressure_medium", 600), ("temperature_medium", 300)])
def test_a_leak_is_found_behind_a_noisy_sensor(name, sensor, within, records):
    events, _, _ = told(name, _noisy(measured(truth(records[name, True], SECONDS), 3), sensor, 3.0))
    assert {event.name for event in events} == {f"noisy_{sensor}", "leak_medium"}
    leak = next(event for event in events if event.name == "leak_medium")
    assert LEAKS <= leak.found_s <= LEAKS + within
    assert leak.size == pytest.approx(0.5, abs=0.15)


STEPS = [*(("temperature", step) for step in (0.1, 0.5, 1.0, 2.0, 5.0)), *(("pressure", s) for s in (0.5, 1, 2, 5, 10))]


def _stepped(table, kind, step):
    for sensor in ANALOG:
        if sensor.startswith(kind):
            table = replaced(table, sensor, lambda values: np.round(values / step) * step)
    return table


@pytest.mark.parametrize("name", STATIONS)
@pytest.mark.parametrize(("kind", "step"), STEPS)
def test_a_sensor_that_reads_in_steps_is_healthy(name, kind, step, records):
    """Steps of ten times the noise gave hundreds of frozen sensors, those of twice the noise a refused model."""
    events, why, _ = told(name, _stepped(measured(truth(records[name, False], SECONDS), 3), kind, step))
    assert events == []
    assert why == []


@pytest.mark.parametrize("name", STATIONS)
@pytest.mark.parametrize(("kind", "step"), [("temperature", 1.0), ("pressure", 2.0)])
def test_a_leak_is_found_by_sensors_that_read_in_steps(name, kind, step, records):
    events, _, _ = told(name, _stepped(measured(truth(records[name, True], SECONDS), 3), kind, step))
    assert {event.name for event in events} == {"leak_medium"}
    assert LEAKS <= events[0].found_s <= LEAKS + 300


@given(
    step=st.floats(1e-3, 100.0), offset=st.floats(-300.0, 300.0), share=st.floats(0.05, 0.4),
    seed=st.integers(0, 2**32 - 1),
)  # fmt: skip
def test_steps_are_known_in_any_unit(step, offset, share, seed):
    """Converted from another unit, with gaps; noise without steps has none."""
    random = np.random.default_rng(seed)
    smooth = 3.0 * np.sin(np.arange(2000) / 100.0) + share * random.standard_normal(2000)
    stepped = np.round(smooth) * step + offset
    stepped[random.random(2000) < 0.1] = np.nan
    read = np.full((2000, len(ANALOG)), np.nan)
    read[:, 0], read[:, 1] = stepped, smooth
    found = coarse_channels(read, np.full(len(ANALOG), 0.4 * step))
    assert found[0]
    assert not coarse_channels(read, np.full(len(ANALOG), 1e-6))[1]


def _with_noise(table, sensor, noise):
    """A sensor with so much more noise in its unit, from the first second on."""
    random = np.random.default_rng(1)
    return replaced(table, sensor, lambda values: values + noise * random.standard_normal(len(values)))


@pytest.mark.parametrize("name", ["thesis-fit", pytest.param("h70-light", marks=pytest.mark.slow)])
@pytest.mark.parametrize("noise", [0.3, 1.0, 3.0])
def test_a_noisy_meter_makes_no_clock_wrong(name, noise, records):
    table = _with_noise(measured(truth(records[name, False], SECONDS), 3), "flow_compressor", noise)
    assert skew_of(samples_of(table, tags()), tags(), load_station(name)) == {"plc": 0.0, "transmitters": 0.0}


@pytest.mark.parametrize("name", STATIONS)
@pytest.mark.parametrize("every", [2, 5, 10])
def test_readings_far_apart_tell_no_second_of_a_clock(name, every, records):
    table = measured(truth(records[name, False], SECONDS), 3)
    thin = samples_of(table.take(np.arange(0, len(table), every)), tags())
    assert skew_of(thin, tags(), load_station(name)) == {"plc": 0.0, "transmitters": 0.0}


@pytest.mark.parametrize("seed", range(3))
def test_coarse_readings_with_gaps_are_no_frozen_ones(seed, records):
    """The size of one was the reading of a second without any."""
    table = measured(truth(records["h70-light", False], SECONDS), 3)
    for kind, step in (("pressure", 5.0), ("temperature", 2.0)):
        table = _stepped(table, kind, step)
    kept = np.flatnonzero(np.random.default_rng(seed).random(len(table)) < 0.3)
    events, _, _ = told("h70-light", table.take(kept))
    assert [event for event in events if event.name.startswith("frozen_") or not np.isfinite(event.size)] == []
