"""Meters that read nothing, whatever flows, and outlets that take turns: told by name, and by nothing else."""

from __future__ import annotations

import pytest

from benchmarks.drills import drill
from station import load_station
from station.estimation.score import untold
from station.faults.sensors import SensorOffset
from station.measured_day import tags_of_day

AT_REST, IN_A_FILL = 44, 46
"""Drills whose faults begin while nothing flows, and while something does."""


@pytest.mark.parametrize(("seed", "late"), [(AT_REST, 3000), (IN_A_FILL, 100)])
@pytest.mark.parametrize("sensor", ["flow_compressor", "flow_dispenser"])
def test_a_meter_that_is_frozen_is_told_though_it_froze_at_no_flow(sensor, seed, late):
    judged, false = drill("thesis-fit", "logic", {"kind": "sensor_frozen", "sensor": sensor}, seed)
    assert judged["found"], "from the first seconds in which gas flows"
    assert judged["delay_s"] <= late
    assert false == []


@pytest.mark.slow
@pytest.mark.parametrize("sensor", ["flow_compressor", "flow_dispenser"])
def test_with_real_gas_as_well(sensor):
    judged, _ = drill("h70-light", "logic", {"kind": "sensor_frozen", "sensor": sensor}, AT_REST)
    assert judged["found"]


@pytest.mark.parametrize("sensor", ["flow_compressor", "flow_dispenser"])
def test_what_a_meter_is_off_by_at_rest_is_an_offset_and_no_frozen_meter(sensor):
    fault = {"kind": "sensor_offset", "sensor": sensor, "offset_g_per_s": 5.0}
    judged, false = drill("thesis-fit", "logic", fault, AT_REST)
    assert judged["found"]
    assert judged["size_error"] == pytest.approx(0.0, abs=0.1)
    assert false == []


@pytest.mark.parametrize("bank", ["high", "medium"])
def test_an_outlet_that_is_stuck_open_is_told_while_outlets_take_turns(bank):
    """Logic moves them second by second here, and no pressure falls for long enough."""
    judged, false = drill(
        "thesis-fit", "logic", {"kind": "valve_stuck", "valve": f"outlet_{bank}", "position": "open"}, 43
    )
    assert judged["found"]
    assert judged["delay_s"] <= 30
    assert len(false) <= 1


def test_a_thermometer_that_is_off_hardly_makes_leaks():
    """On one of five days, by the limit that holds for every station; small ones wait."""
    fault = {"kind": "sensor_offset", "sensor": "temperature_high", "offset_k": 5.0}
    leaks = 0
    for seed in range(40, 45):
        judged, false = drill("thesis-fit", "logic", fault, seed)
        assert judged["found"]
        leaks += any(name.startswith("leak") for name in false)
    assert leaks <= 1


@pytest.mark.parametrize(("sensor", "field"), [("pressure_vehicle", "offset_bar"), ("temperature_vehicle", "offset_k")])
def test_nobody_can_tell_what_a_vehicles_sensor_is_off_as_it_comes(sensor, field):
    fault = SensorOffset.model_validate({"kind": "sensor_offset", "sensor": sensor, field: 5.0, "begin_s": 0.0})
    assert "of its own" in untold(fault, tags_of_day(), load_station("thesis-fit"))


@pytest.mark.parametrize(("seed", "skew"), [(306, -1), (312, 1)])
def test_clocks_that_are_apart_freeze_no_meter(seed, skew):
    """Where inlets move second by second, a meter whose clock is off tells no flow in each second with one open."""
    _, false = drill("thesis-fit", "logic", {"kind": "clock_skew", "skew_s": skew}, seed)
    assert not any(name.startswith("frozen") for name in false)
