"""Faults of a hidden station are found and named, and a healthy one has none."""

from __future__ import annotations

import numpy as np
import pytest

from station import load_station
from station.estimation.clock import skew_of
from station.estimation.detection import detect
from station.estimation.filter import follow
from station.geometry import BUFFERS
from station.measurement import frames_of, samples_of
from tests.station.estimation.hidden import hidden_station, leaking, measured, replayed, tags

BEGIN = 40_000


def _events(true, seed):
    frames = frames_of(samples_of(measured(true, seed), tags()))
    return detect(frames, follow(frames, load_station("thesis-fit")))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_healthy_station_has_no_fault(near, seed):
    assert _events(near.true, seed) == []


@pytest.mark.parametrize("buffer", range(3))
def test_a_leak_is_found_and_named(near, buffer):
    (event,) = _events(leaking(near.station, near.record, buffer, BEGIN, 0.5), 10 + buffer)
    assert event.name == f"leak_{BUFFERS[buffer]}"
    assert BEGIN <= event.found_s <= BEGIN + 150
    assert abs(event.begin_s - BEGIN) < 120
    assert event.size == pytest.approx(0.5, abs=0.1)


def test_a_weak_compressor_is_found(near):
    true = replayed(
        near.station, near.record, lambda row, state: None, compressor=lambda row: 0.8 if row >= BEGIN else 1.0
    )
    (event,) = _events(true, 6)
    assert event.name == "compressor_weak"
    assert BEGIN <= event.found_s <= BEGIN + 500
    assert event.size == pytest.approx(20, abs=3)


def _sensor(true, name, change):
    changed = {**true, name: true[name].copy()}
    change(changed[name])
    return changed


def test_a_frozen_sensor_is_found(near):
    table = measured(near.true, 7)
    stuck = table["pressure_medium"].to_numpy(zero_copy_only=False).copy()
    stuck[BEGIN : BEGIN + 3600] = stuck[BEGIN - 10]
    place = table.column_names.index("pressure_medium")
    frames = frames_of(samples_of(table.set_column(place, "pressure_medium", [stuck]), tags()))
    events = detect(frames, follow(frames, load_station("thesis-fit")))
    assert "frozen_pressure_medium" in {event.name for event in events}
    event = next(event for event in events if event.name == "frozen_pressure_medium")
    assert event.found_s <= BEGIN + 90


def test_a_sensor_that_is_off_is_found(near):
    true = _sensor(near.true, "pressure_high", lambda read: read.__setitem__(slice(BEGIN, None), read[BEGIN:] + 20))
    event = next(event for event in _events(true, 8) if event.name == "offset_pressure_high")
    assert BEGIN <= event.found_s <= BEGIN + 90
    assert event.size == pytest.approx(20, abs=3)


@pytest.mark.parametrize("skew", [-6, -1, 0, 4, 6])
def test_a_clock_that_is_fast_is_found_though_parameters_are_wrong(near, skew):
    table = measured(near.true, 9, skew=skew)
    samples = samples_of(table, tags())
    assert skew_of(samples, tags(), hidden_station(5, 0.10)) == {"plc": 0.0, "transmitters": float(skew)}
    frames = frames_of(samples, {"transmitters": float(skew)})
    assert np.isfinite(frames["pressure_high"]).mean() > 0.97
