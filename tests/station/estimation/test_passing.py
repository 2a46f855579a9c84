"""Faults that end, and volumes that are told late: told as what they were, and no model is refused for them."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest

from controllers import create_from
from station import simulate
from station.measurement import Tag, TagMap
from station.scenario import parse_scenario
from tests.station.estimation.hidden import day, measured, tags, truth
from tests.station.estimation.sensors import CARS, SECONDS, STATIONS, told

VOLUME = "vehicle_volume"


def _with(name, **fault):
    return measured(truth(day(STATIONS[name](3, spread=0.005), CARS, SECONDS, faults=[fault]), SECONDS), 3)


@pytest.mark.parametrize("name", STATIONS)
@pytest.mark.parametrize(
    ("bank", "begin", "end"), [("low", 3000, 4500), ("medium", 9000, 11_000), ("high", 9000, 10_000)]
)
def test_a_large_leak_that_is_mended_is_told(name, bank, begin, end):
    """Its end is a step as its beginning is: the model was refused for it, and no leak told."""
    fault = {"kind": "leak", "buffer": bank, "rate_g_per_s": 2.0, "begin_s": begin, "end_s": end}
    events, why, _ = told(name, _with(name, **fault))
    assert [event.name for event in events] == [f"leak_{bank}"]
    assert begin <= events[0].found_s <= begin + 60
    assert events[0].size == pytest.approx(2.0, abs=0.3)
    assert why == []


@pytest.mark.parametrize("name", STATIONS)
def test_a_trip_that_has_passed_has_the_size_that_it_had(name):
    """Of five minutes, it was told as less than a percent."""
    events, why, _ = told(name, _with(name, kind="compressor_tripped", begin_s=9300, end_s=9600))
    assert [event.name for event in events] == ["compressor_weak"]
    assert events[0].size == pytest.approx(100.0, abs=1.0)
    assert why == []


@pytest.mark.parametrize("name", STATIONS)
def test_what_sensors_of_no_vehicle_read_is_no_frozen_sensor(name, records):
    true = truth(records[name, False], SECONDS)
    away = true["vehicle"] < 0
    table = measured(true, 3)
    for sensor, value in (("pressure_vehicle", 0.0), ("temperature_vehicle", 20.0)):
        read = np.where(away, value, table[sensor].to_numpy(zero_copy_only=False).astype(float))
        table = table.set_column(table.column_names.index(sensor), sensor, pa.array(read, from_pandas=True))
    assert told(name, table)[:2] == ([], [])


def _mixed_day(name):
    """A day of vehicles whose tanks are up to a quarter larger or smaller than the usual one."""
    station = STATIONS[name](3, spread=0.005)
    random = np.random.default_rng(11)
    vehicles = [
        {
            "time_s": 800.0 + 2100.0 * k,
            "start_pressure_bar": float(random.uniform(100, 180)),
            "volume_m3": station.vehicle.volume_m3 * float(random.uniform(0.75, 1.25)),
        }
        for k in range(CARS)
    ]
    arrivals = {"kind": "trace", "vehicles": vehicles}
    given = {"name": "mixed", "station": station.model_dump(), "arrivals": arrivals, "time_limit_s": SECONDS}
    return simulate(parse_scenario(given), create_from("logic"))


@pytest.mark.parametrize(("name", "late"), [*((name, late) for name in STATIONS for late in (0, 1)), ("thesis-fit", 3)])
def test_a_volume_may_be_told_late(name, late):
    """The usual one was taken for the whole fill, and the model refused or offsets told."""
    record = _mixed_day(name)
    true = truth(record, SECONDS)
    there = true["vehicle"] >= 0
    volume = np.where(there, record.vehicles["volume"][true["vehicle"].astype(int)], np.nan)
    for begin in np.flatnonzero(there & (np.r_[-1.0, true["vehicle"][:-1]] != true["vehicle"])):
        volume[begin : begin + late] = np.nan
    table = measured(true, 3).append_column(VOLUME, pa.array(volume, from_pandas=True))
    known = TagMap(tags=[*tags().tags, Tag(tag=VOLUME, column=VOLUME, sensor=VOLUME, source="plc")])
    assert told(name, table, known)[:2] == ([], [])
