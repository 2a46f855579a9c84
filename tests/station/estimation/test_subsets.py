"""Any subset of the sensors: of a healthy station nothing is told, whichever of them it lacks."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from controllers import create_from
from station import load_station, simulate
from station.estimation.detection import Event, detect, untellable
from station.estimation.filter import follow
from station.estimation.verdict import judged
from station.frames import frames_of
from station.measured_day import measured_day, tags_of_day
from station.measurement import TagMap, samples_of
from station.parameters import Station
from station.record import Record
from station.scenario import parse_scenario
from station.sensor_names import ANALOG, POWER

PARAMETERS = {
    "thesis-fit": ("compressor.inlet_coefficient_g_per_s_bar", "dispenser.outlet_coefficient_g_per_s_bar"),
    "h70-light": ("real_gas.compressor.displacement_m3_per_h", "real_gas.dispensing.valve_mm2"),
    "h70-truck": ("real_gas.compressor.displacement_m3_per_h", "real_gas.dispensing.valve_mm2"),
}
"""Beside the volumes of banks: half a percent off, as nobody knows."""

LEAK_G_PER_S, LEAK_BEGIN_S = 3.0, 20_000.0
"""Of a truck station's bank."""


def off(name: str, seed: int) -> Station:
    random = np.random.default_rng(seed)
    given = load_station(name).model_dump()
    for path in (*(f"buffers.{bank}.volume_m3" for bank in ("high", "medium", "low")), *PARAMETERS[name]):
        *sections, field = path.split(".")
        part = given
        for section in sections:
            part = part[section]
        part[field] *= random.normal(1.0, 0.005)
    return Station.model_validate({**given, "name": "mine"})


@cache
def day(name: str, controller: str, *, leak: bool = False) -> Record:
    random = np.random.default_rng(77)
    vehicles = [
        {
            "time_s": 300.0 + 900 * k + float(random.uniform(0, 300)),
            "start_pressure_bar": float(random.uniform(60, 200)),
        }
        for k in range(34)
    ]
    faults = [{"kind": "leak", "buffer": "low", "begin_s": LEAK_BEGIN_S, "rate_g_per_s": LEAK_G_PER_S}] if leak else []
    scenario = {
        "name": "healthy", "station": off(name, 8).model_dump(), "time_limit_s": 32_000.0, "faults": faults,
        "arrivals": {"kind": "trace", "vehicles": vehicles},
    }  # fmt: skip
    return simulate(parse_scenario(scenario), create_from(controller))


def told(record: Record, name: str, *lacking: str) -> tuple[list[Event], list[str]]:
    """Events, and why the model is refused."""
    tags = TagMap(tags=[tag for tag in tags_of_day().tags if tag.sensor not in lacking])
    frames, known = frames_of(samples_of(measured_day(record, seed=3), tags, "day")), load_station(name)
    followed = follow(frames, known)
    events = detect(frames, followed, known)
    return events, judged(followed, frames.start, events)[1]


@pytest.mark.parametrize("lacking", ["", *ANALOG, "vehicle_volume"])
@pytest.mark.parametrize("name", ["thesis-fit", "h70-light"])
def test_of_a_healthy_station_nothing_is_told_whatever_it_lacks(name, lacking):
    assert told(day(name, "logic"), name, lacking, POWER) == ([], [])


@pytest.mark.slow
@pytest.mark.parametrize("lacking", [(a, b) for a in ANALOG for b in ANALOG if a < b])
@pytest.mark.parametrize("name", ["thesis-fit", "h70-light"])
def test_nor_without_two_of_them(name, lacking):
    """A model may be refused then: nothing tells what a fill takes."""
    assert told(day(name, "switched"), name, *lacking, POWER)[0] == []


@pytest.mark.parametrize("controller", ["logic", "switched"])
def test_of_a_large_station_no_leak_is_told_that_is_none(controller):
    """Half a percent of 300 g/s is more than what a leak of a small station loses."""
    assert told(day("h70-truck", controller), "h70-truck")[0] == []


def test_a_leak_of_a_large_station_is_told():
    events, _ = told(day("h70-truck", "logic", leak=True), "h70-truck")
    assert {event.name for event in events} == {"leak_low"}
    assert LEAK_BEGIN_S < events[0].found_s < LEAK_BEGIN_S + 300


def test_what_cannot_be_told_is_said():
    everything = {tag.sensor for tag in tags_of_day().tags}
    assert untellable(everything) == set()
    assert {"leak_high", "dispenser_clogged"} <= untellable(everything - {"pressure_high"})
    assert "leak_low" not in untellable(everything - {"pressure_high"})
