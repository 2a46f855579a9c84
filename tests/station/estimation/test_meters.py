"""Flow meters that are off while nothing flows: drift and offsets are told, and taken off what they read."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from station import load_station
from station.estimation.detection import Detector, detect
from station.estimation.filter import follow
from station.frames import frames_of
from station.geometry import BUFFERS
from station.measured_day import measured_day
from station.measurement import samples_of
from tests.station.estimation.hidden import day, tags
from tests.station.estimation.sensors import STATIONS, read_of, replaced
from tests.station.estimation.sensors import told as all_told

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
    assert events[0].begin_low_s <= BEGIN <= events[0].begin_high_s <= events[0].found_s
    detector = Detector(frames.measured, known)
    detector.feed(frames, followed)
    assert detector.active == (), "it reads nothing at rest again"


@pytest.mark.parametrize("name", STATIONS)
@pytest.mark.parametrize("controller", ["logic", "minlp1"])
@pytest.mark.parametrize("rate", [1.0, -1.0])
def test_drift_is_found_where_the_compressor_hardly_rests(name, controller, rate):
    """Of rests of a second or two, where three of them have said before that a meter reads nothing then."""
    cars = {"thesis-fit": 60, "h70-light": 36}[name]
    station = STATIONS[name](41, spread=0.005, ambient=3.0)
    fault = {**dict(drift_of("flow_compressor", rate)), "begin_s": BEGIN}
    table = measured_day(day(station, cars, SECONDS, controller, [fault]), seed=4)
    events, refused, _ = all_told(name, table)
    assert ([event.name for event in events], refused) == (["drift_flow_compressor"], [])
    assert events[0].size == pytest.approx(rate, rel=0.15)
    assert events[0].begin_low_s <= BEGIN <= events[0].begin_high_s


@pytest.mark.parametrize("size", [0.3, 5.0])
def test_a_meter_that_lags_tells_nothing_at_short_rests(size):
    """It reads a little in the first second of each rest, or as much as flowed just before."""
    station = STATIONS["thesis-fit"](41, spread=0.005, ambient=3.0)
    table = measured_day(day(station, 60, SECONDS, "logic"), seed=4)
    inlets = np.stack([read_of(table, f"inlet_{bank}") for bank in BUFFERS])
    open_before = np.concatenate([[False], (np.nan_to_num(inlets) > 0.5).any(0)[:-1]])

    def lagging(values):
        return np.where(open_before & (values == 0.0), size, values)

    events = all_told("thesis-fit", replaced(table, "flow_compressor", lagging))[0]
    assert not [event for event in events if event.name.startswith("drift_flow")]


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
