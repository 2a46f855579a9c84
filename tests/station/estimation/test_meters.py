"""Flow meters that are off while nothing flows: drift and offsets are told, and taken off what they read."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from station import load_station
from station.estimation.detection import Detector, detect
from station.estimation.filter import follow
from station.frames import frames_of
from station.measured_day import measured_day
from station.measurement import samples_of
from tests.station.estimation.hidden import day, tags
from tests.station.estimation.sensors import STATIONS, replaced

SECONDS, CARS, BEGIN, END = 24_000, 11, 10_000.0, 20_000.0


@cache
def table_of(name, *fault):
    """What is measured on a day of a station half a percent off."""
    station = STATIONS[name](41, spread=0.005, ambient=3.0)
    faults = [{**dict(fault), "begin_s": BEGIN, "end_s": END}] if fault else []
    return measured_day(day(station, CARS, SECONDS, "switched", faults), seed=4)


def told(name, table):
    frames, known = frames_of(samples_of(table, tags())), load_station(name)
    followed = follow(frames, known)
    return frames, followed, known, detect(frames, followed, known)


def drift_of(sensor, rate):
    return tuple({"kind": "sensor_drift", "sensor": sensor, "drift_g_per_s_per_h": rate}.items())


@pytest.mark.parametrize("name", STATIONS)
@pytest.mark.parametrize(
    ("sensor", "rate"), [("flow_compressor", 1.0), ("flow_compressor", -1.0), ("flow_dispenser", 3.0)]
)
def test_drift_is_told_by_nothing_else(name, sensor, rate):
    frames, followed, known, events = told(name, table_of(name, *drift_of(sensor, rate)))
    assert [(event.name, event.unit) for event in events] == [(f"drift_{sensor}", "g/s/h")]
    assert events[0].size == pytest.approx(rate, rel=0.03)
    assert events[0].begin_s == pytest.approx(BEGIN, abs=60.0)
    assert events[0].found_s < BEGIN + 1200
    detector = Detector(frames.measured, known)
    detector.feed(frames, followed)
    assert detector.active == (), "it reads nothing at rest again"


def test_what_a_meter_is_off_by_is_taken_off():
    frames, followed, _, _ = told("thesis-fit", table_of("thesis-fit", *drift_of("flow_compressor", 3.0)))
    while_off = slice(int(BEGIN) + 2000, int(END) - 100)
    flows = frames["flow_compressor"][while_off] > 10.0
    assert flows.sum() > 100
    off = followed.innovations[while_off, 8][flows]  # 8 g/s off at last
    assert np.nanmax(np.abs(off)) < 6.0
    assert np.sqrt(np.nanmean(off**2)) < 1.2


@pytest.mark.parametrize("size", [0.4, -0.4])
def test_an_offset_at_rest_is_told_as_one(size):
    """With noise, as a meter has it that is read at rest."""
    random = np.random.default_rng(5)

    def moved(values):
        behind = np.arange(len(values)) >= BEGIN
        return values + behind * (size + 0.01 * random.standard_normal(len(values)))

    _, _, _, events = told("thesis-fit", replaced(table_of("thesis-fit"), "flow_dispenser", moved))
    assert [event.name for event in events] == ["offset_flow_dispenser"]
    assert events[0].size == pytest.approx(size, abs=0.02)
    assert events[0].begin_s == pytest.approx(BEGIN, abs=60.0)


def test_a_meter_that_reads_nothing_below_a_least_flow_is_right():
    def cut(values):
        return np.where(np.abs(values) < 0.5, 0.0, values)

    for name in STATIONS:
        assert told(name, replaced(table_of(name), "flow_compressor", cut))[3] == []


def test_noise_at_rest_is_no_drift():
    random = np.random.default_rng(6)

    def noisy(values):
        return values + 0.05 * random.standard_normal(len(values))

    events = told("thesis-fit", replaced(table_of("thesis-fit"), "flow_dispenser", noisy))[3]
    assert not [event for event in events if event.name.startswith(("drift_", "offset_flow", "leak"))]
