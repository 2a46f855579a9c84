"""Readings of a run second by second: each fault changes its sensor, while it is there, as it is defined to."""

from __future__ import annotations

import math

import pytest
from pydantic import TypeAdapter

from station.columns import CODES, COUNTS, VALUES
from station.faults.kinds import Fault
from station.measured_second import LiveSensors, SensorState, measured_second

FAULT = TypeAdapter(Fault)
COLUMNS = (*VALUES, *CODES, *COUNTS)


def row_at(time, vehicle=0):
    row = dict.fromkeys(COLUMNS, 0.0) | {name: 300.0 + time for name in COLUMNS if name.startswith("pressure")}
    if vehicle < 0:
        row |= {"pressure_vehicle": math.nan, "temperature_vehicle": math.nan}
    return row | {"time": float(time), "vehicle": vehicle}


def readings(*faults, seconds=200, vehicles=lambda time: 0, kill=None):
    """The healthy and the faulty readings of each second, and how they are stamped."""
    sensors = LiveSensors([FAULT.validate_python(each) for each in faults])
    found = []
    for seq in range(seconds):
        if seq == kill:
            memories, sensors = sensors.memories(), LiveSensors([FAULT.validate_python(each) for each in faults])
            sensors.resume(memories)
        row = row_at(seq, vehicles(seq))
        state = sensors.second(tuple(row[name] for name in COLUMNS), seq)
        found.append((measured_second(row, seq), measured_second(row, seq, sensors=state), state))
    return found


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        ({"kind": "sensor_offset", "offset_bar": 5.0}, lambda good, time: good + 5.0),
        ({"kind": "sensor_drift", "drift_bar_per_h": 36.0}, lambda good, time: good + 0.01 * (time - 100)),
    ],
)
def test_a_sensor_reads_wrong_by_as_much_as_its_fault_says(fault, expected):
    fault = {"sensor": "pressure_high", "begin_s": 100.0, "end_s": 150.0, **fault}
    for time, (good, bad, _) in enumerate(readings(fault)):
        assert set(good) == set(bad)
        for name in good:
            wrong = name == "pressure_high" and 100 <= time < 150
            assert bad[name] == (pytest.approx(expected(good[name], time)) if wrong else good[name])


def test_a_noisy_sensor_has_so_much_more_noise():
    fault = {"kind": "sensor_noisy", "sensor": "pressure_high", "noise_bar": 4.0, "begin_s": 0.0}
    found = readings(fault, seconds=2000)
    added = [bad["pressure_high"] - good["pressure_high"] for good, bad, _ in found if "pressure_high" in good]
    spread = math.sqrt(sum(each**2 for each in added) / len(added))
    assert 3.75 < spread < 4.25, "four standard errors of 2000 draws are 0.25"
    assert all(bad.get("pressure_low") == good.get("pressure_low") for good, bad, _ in found)


def test_an_absent_sensor_says_nothing_while_it_is_absent():
    fault = {"kind": "sensor_absent", "sensor": "temperature_low", "begin_s": 50.0, "end_s": 80.0}
    for time, (good, bad, _) in enumerate(readings(fault)):
        assert ("temperature_low" in bad) == ("temperature_low" in good and not 50 <= time < 80)


@pytest.mark.parametrize("kill", [None, 60, 101, 149])
def test_a_frozen_sensor_says_its_last_value_through_kills(kill):
    fault = {"kind": "sensor_frozen", "sensor": "pressure_medium", "begin_s": 100.0, "end_s": 150.0}
    found = readings(fault, kill=kill)
    held = {bad["pressure_medium"] for _, bad, _ in found[100:150] if "pressure_medium" in bad}
    assert len(held) == 1
    assert held == {dict(found[100][2].held)["pressure_medium"]}
    assert abs(held.pop() - 400.0) < 5.0
    assert all(good == bad for good, bad, _ in (*found[:100], *found[150:]))


@pytest.mark.parametrize("kill", [None, 90, 120])
def test_a_vehicles_sensor_freezes_at_what_it_read_of_the_last_vehicle(kill):
    fault = {"kind": "sensor_frozen", "sensor": "pressure_vehicle", "begin_s": 100.0, "end_s": 150.0}
    found = readings(fault, vehicles=lambda time: -1 if 80 <= time < 130 else 0, kill=kill)
    held = {bad["pressure_vehicle"] for _, bad, _ in found[100:150] if "pressure_vehicle" in bad}
    assert len(held) == 1
    assert abs(held.pop() - 379.0) < 5.0
    nobody = readings(fault, vehicles=lambda time: -1)
    assert all("pressure_vehicle" not in bad for _, bad, _ in nobody)


def test_a_skewed_clock_stamps_transmitters_and_no_valves():
    (_, _, before), *_, (_, _, state) = readings({"kind": "clock_skew", "skew_s": 3, "begin_s": 10.0}, seconds=20)
    assert before == SensorState()
    assert (state.stamp("pressure_high", 19.0), state.stamp("vehicle", 19.0)) == (22.0, 19.0)
