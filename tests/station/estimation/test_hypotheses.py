"""Valves that move every few seconds and are stuck: filters with a hypothesis each say which of them it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.drills import OFF, WIDTH, drill
from benchmarks.following import told
from benchmarks.measured_forecasts import drawn_station, measured
from controllers import create_from
from station import load_station, parse_scenario, simulate
from station.errors import InputError
from station.estimation.filter import model_of
from station.estimation.valves.hypotheses import BLOCK, SETTLING, Hypotheses
from station.estimation.valves.memory import valves_of_nothing
from station.frames import frames_of_seconds
from station.measured_day import tags_of_day
from station.sensor_names import SENSORS


def frames(seconds, start=0.0):
    return frames_of_seconds(start, np.full((seconds, len(SENSORS)), np.nan), tags_of_day().tags)


@pytest.mark.parametrize(
    ("preset", "valve", "seed", "late"),
    [
        ("thesis-fit", "inlet_high", 4, 200), ("thesis-fit", "outlet_low", 3, 300),
        ("h70-light", "inlet_high", 3, 600), ("h70-light", "inlet_medium", 3, 600),
        ("h70-light", "outlet_low", 1, 400),
    ],
)  # fmt: skip
def test_a_valve_among_those_that_take_turns_is_told(preset, valve, seed, late):
    """By `minlp1` valves move every second or third: no command lasts until a balance tells what it moved."""
    judged, false = drill(preset, "minlp1", {"kind": "valve_stuck", "valve": valve, "position": "open"}, seed)
    assert judged["found"]
    assert judged["delay_s"] <= late
    assert not [name for name in false if name.startswith("stuck")]


def test_it_is_told_open_and_began_before_it_was_found():
    """It may have stuck at any time of the block in which it shows."""
    known, begin = load_station("thesis-fit").model_copy(update={"calibrated": True}), 9_100.0
    fault = {"kind": "valve_stuck", "valve": "outlet_low", "position": "open", "begin_s": begin}
    station = drawn_station("thesis-fit", 3, OFF / WIDTH)
    law = {"kind": "uniform", "count": 10, "period_s": 20_000.0}
    day = {"name": "day", "station": station.model_dump(mode="json"), "arrivals": law, "time_limit_s": 20_000.0}
    record = simulate(parse_scenario({**day, "faults": [fault]}), create_from("minlp1"), replication=3, seed=3)
    (event,) = [each for each in told(measured(record, 3), known) if each.name == "stuck_outlet_low"]
    assert event.size == 1.0
    assert event.begin_low_s <= begin <= event.begin_high_s
    assert event.found_s % BLOCK == BLOCK - 1  # by hypotheses


def test_an_outlet_is_told_that_gives_too_little_for_a_balance():
    """`outlet_low` of `h70-light`, from which gas flows in the first minute of a fill alone."""
    fault = {"kind": "valve_stuck", "valve": "outlet_low", "position": "open"}
    judged, false = drill("h70-light", "logic", fault, 2)
    assert judged["found"]
    assert false == []


@pytest.mark.parametrize(
    "fault",
    [
        {"kind": "compressor_tripped"},
        {"kind": "sensor_offset", "sensor": "pressure_medium", "offset_bar": 10.0},
        {"kind": "sensor_frozen", "sensor": "pressure_high"},
        {"kind": "sensor_absent", "sensor": "temperature_high"},
        {"kind": "sensor_noisy", "sensor": "flow_compressor", "noise_g_per_s": 4.0},
    ],
)  # fmt: skip
@pytest.mark.parametrize("seed", [12, pytest.param(28, marks=pytest.mark.slow)])
def test_what_else_fails_is_no_valve(fault, seed):
    """A machine that trips, a sensor that jumps, sticks, is silent or noisy lets readings not fit either."""
    _, false = drill("h70-light", "logic", fault, seed)
    assert not [name for name in false if name.startswith("stuck")]


@pytest.mark.parametrize(("preset", "sensor"), [("thesis-fit", "temperature_medium"), ("h70-light", "pressure_high")])
def test_without_a_sensor_of_a_bank_no_valve_is_taken_for_stuck(preset, sensor):
    """What is not read of a bank is whatever makes the rest fit."""
    known = load_station(preset).model_copy(update={"calibrated": True})
    station = drawn_station(preset, 5, OFF / WIDTH)
    law = {"kind": "uniform", "count": 15, "period_s": 20_000.0}
    day = {"name": "day", "station": station.model_dump(mode="json"), "arrivals": law, "time_limit_s": 20_000.0}
    record = simulate(parse_scenario(day), create_from("logic"), replication=5, seed=5)
    read = measured(record, 5)
    values = read.values.copy()
    values[:, SENSORS.index(sensor)] = np.nan
    left = tuple(name for name in read.measured if name != sensor)
    events = told(replace(read, values=values, measured=left), known)
    assert not [event.name for event in events if event.name.startswith("stuck")]


@pytest.mark.parametrize("start", [0.0, 7.0, 1.7e9])
@pytest.mark.parametrize("seconds", [0, 1, BLOCK, 3 * BLOCK + 1])
def test_blocks_end_where_time_says_so(start, seconds):
    """Whatever second a record begins with, and however it comes."""
    parts = list(frames(seconds, start).blocks(BLOCK))
    assert sum(map(len, parts)) == seconds
    assert all((part.start + len(part)) % BLOCK == 0 for part in parts[:-1])
    assert all(len(part) <= BLOCK for part in parts)


def test_what_none_wrote_is_refused():
    """A snapshot that says that more seconds are of this block than were kept."""
    station = load_station("thesis-fit")
    hypotheses = Hypotheses(station, model_of(station))
    hypotheses.take(frames(100), frames(100))
    arrays = hypotheses.snapshot()
    other = Hypotheses(station, model_of(station))
    other.restore(arrays)
    assert {name: each.tobytes() for name, each in other.snapshot().items()} == {
        name: each.tobytes() for name, each in arrays.items()
    }
    with pytest.raises(InputError, match="fresh"):
        other.restore({**arrays, "fresh": np.array(101)})


def test_only_a_block_and_what_it_needs_is_kept():
    """However long a record is."""
    station = load_station("thesis-fit")
    hypotheses = Hypotheses(station, model_of(station))
    for part in frames(5 * BLOCK).blocks(BLOCK):
        hypotheses.take(part, part)
        assert hypotheses.end_block(valves_of_nothing()) is None
        assert len(hypotheses.snapshot()["values"]) <= BLOCK + SETTLING
