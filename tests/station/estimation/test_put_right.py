"""A flow meter that is put right while gas flows is read as it is from there on, and nothing is told of that."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from station import load_station
from station.estimation.filter import follow
from station.frames import frames_of
from station.measured_day import measured_day
from station.measurement import samples_of
from station.record import Record
from tests.station.estimation.hidden import day, tags
from tests.station.estimation.sensors import STATIONS, read_of, replaced, told

SECONDS, CARS, BEGIN, EARLIEST = 24_000, 11, 10_000, 17_500
METERS = ("flow_compressor", "flow_dispenser")


@cache
def record_of(name, controller, *fault) -> Record:
    station = STATIONS[name](41, spread=0.005, ambient=3.0)
    return day(station, CARS, SECONDS, controller, [dict(fault)] if fault else [])


@cache
def table_of(name, controller, *fault):
    return measured_day(record_of(name, controller, *fault), seed=4)


def off(table, sensor, rate, end):
    """The table with a meter that drifts [g/s/h] until it is put right."""
    second = np.arange(len(read_of(table, sensor)))
    drift = np.where((second >= BEGIN) & (second < end), rate * (second - BEGIN) / 3600.0, 0.0)
    return replaced(table, sensor, lambda values: values + drift)


def in_a_flow(name, controller, sensor, since):
    """So many seconds after gas began to flow, where it flows for twice as long."""
    flows = np.array(record_of(name, controller)[sensor], float) > 0.5
    begins = np.flatnonzero(flows[1:] & ~flows[:-1]) + 1
    for begin in begins[begins > EARLIEST].tolist():
        if flows[begin : begin + 2 * since].all():
            return begin + since
    raise AssertionError("gas never flows for so long")


@pytest.mark.parametrize("name", STATIONS)
@pytest.mark.parametrize("sensor", METERS)
@pytest.mark.parametrize("rate", [1.0, -1.0, 3.0])
def test_nothing_is_told_of_a_meter_that_is_put_right(name, sensor, rate):
    end = in_a_flow(name, "logic", sensor, 8)
    events, refused, _ = told(name, off(table_of(name, "logic"), sensor, rate, end))
    assert ([event.name for event in events], refused) == ([f"drift_{sensor}"], [])


@pytest.mark.slow
@pytest.mark.parametrize("controller", ["switched", "minlp1"])
@pytest.mark.parametrize("since", [3, 60])
@pytest.mark.parametrize("name", STATIONS)
@pytest.mark.parametrize("sensor", METERS)
@pytest.mark.parametrize("rate", [0.5, 1.0, -1.0, 3.0, -3.0])
def test_nothing_is_told_whenever_it_is_put_right(name, controller, sensor, rate, since):
    end = in_a_flow(name, controller, sensor, since)
    events, refused, _ = told(name, off(table_of(name, controller), sensor, rate, end))
    assert ([event.name for event in events], refused) == ([f"drift_{sensor}"], [])


def test_it_is_read_as_it_is_within_seconds():
    sensor = METERS[0]
    end = in_a_flow("h70-light", "logic", sensor, 60)
    frames = frames_of(samples_of(off(table_of("h70-light", "logic"), sensor, 1.0, end), tags()))
    followed = follow(frames, load_station("h70-light"))
    behind = followed.innovations[end + 10 : end + 110, 8]
    assert np.isfinite(behind).sum() > 90
    assert np.abs(behind[np.isfinite(behind)]).max() < 6.0


FAULTS = [
    {"kind": "compressor_weak", "loss_percent": 20.0, "begin_s": 17_000.0},
    {"kind": "compressor_tripped", "begin_s": 17_000.0, "end_s": 19_000.0},
]


@pytest.mark.parametrize("name", STATIONS)
@pytest.mark.parametrize("rate", [1.0, -1.0])
@pytest.mark.parametrize("fault", FAULTS, ids=lambda each: each["kind"])
def test_a_compressor_that_ails_is_no_meter_that_is_put_right(name, fault, rate):
    table = off(table_of(name, "logic", *fault.items()), METERS[0], rate, SECONDS)
    events, _, _ = told(name, table)
    assert {event.name for event in events} == {f"drift_{METERS[0]}", "compressor_weak"}
    size = next(event.size for event in events if event.name == "compressor_weak")
    assert size == pytest.approx(fault.get("loss_percent", 100.0), abs=4.0)
