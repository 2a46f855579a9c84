"""Faults of valves and of the line, as a run simulates them."""

from __future__ import annotations

import numpy as np
import pytest

from controllers import create_from
from station import simulate
from station.errors import InputError
from station.geometry import BUFFERS, VALVES
from station.record import Record
from station.scenario import parse_scenario

STATIONS = ["thesis-fit", "h70-light"]


def run(station: str, faults: list[dict[str, object]], controller: str = "switched") -> Record:
    vehicles = [{"time_s": 1200.0 * k, "start_pressure_bar": 100.0} for k in range(6)]
    given = {
        "name": "faulty",
        "station": station,
        "arrivals": {"kind": "trace", "vehicles": vehicles},
        "time_limit_s": 9000.0,
        "faults": faults,
    }
    return simulate(parse_scenario(given), create_from(controller))


@pytest.mark.parametrize("station", STATIONS)
@pytest.mark.parametrize("valve", VALVES)
def test_nothing_flows_through_a_valve_that_is_stuck_closed(station, valve):
    record = run(station, [{"kind": "valve_stuck", "valve": valve, "position": "closed", "begin_s": 0.0}])
    others = [other for other in VALVES if other.startswith(valve[:5]) and other != valve]
    alone = (record[valve] == 1) & ~np.any([record[other] == 1 for other in others], axis=0)
    side = "compressor" if valve.startswith("inlet") else "dispenser"
    assert np.all(record[f"flow_{side}"][alone] == 0.0)


@pytest.mark.parametrize("station", STATIONS)
@pytest.mark.parametrize("bank", BUFFERS)
def test_a_buffer_gives_through_an_outlet_that_is_stuck_open(station, bank):
    fault = {"kind": "valve_stuck", "valve": f"outlet_{bank}", "position": "open", "begin_s": 0.0}
    first = "cascade" if bank == "high" else "largest_gap"  # so that other banks give before this one
    record = run(station, [fault], f"logic:dispense={first}" if station == "h70-light" else "switched")
    shut = (record[f"outlet_{bank}"][:-1] == 0) & (record[f"inlet_{bank}"][:-1] == 0)
    falls = np.diff(record[f"mass_{bank}"])
    above = record[f"pressure_{bank}"][:-1] > record["pressure_vehicle"][:-1] + 40.0
    there = record["vehicle"][:-1] >= 0
    assert (shut & above & there).sum() > 20
    assert np.all(falls[shut & above & there] < 0.0)
    assert np.all(falls[shut & ~there] == 0.0)


@pytest.mark.parametrize("station", STATIONS)
def test_gas_is_compressed_into_the_buffer_of_less_pressure(station):
    fault = {"kind": "valve_stuck", "valve": "inlet_medium", "position": "open", "begin_s": 0.0}
    record = run(station, [fault])
    pressure = {bank: record[f"pressure_{bank}"][:-1] for bank in BUFFERS}
    room = pressure["medium"] < pressure["medium"].max() - 5.0
    told = (record["inlet_high"][:-1] == 1) & (pressure["high"] > pressure["medium"] + 1.0) & room
    told &= (record["outlet_medium"][:-1] == 0) & (record["outlet_high"][:-1] == 0)
    assert told.sum() > 20
    assert np.all(np.diff(record["mass_medium"])[told] > 0.0)
    assert np.all(np.diff(record["mass_high"])[told] == 0.0)


@pytest.mark.parametrize("station", STATIONS)
def test_a_line_loses_while_an_outlet_is_open(station):
    healthy, record = run(station, []), run(station, [{"kind": "line_leak", "begin_s": 0.0, "rate_g_per_s": 2.0}])
    for each, rate in ((healthy, 0.0), (record, 2.0)):
        outlets = np.sum([each[f"outlet_{bank}"] for bank in BUFFERS], axis=0)[:-1] > 0
        held = np.sum([each[f"mass_{bank}"] for bank in BUFFERS], axis=0)
        missing = -np.diff(held) + each["flow_compressor"][:-1] - each["flow_dispenser"][:-1]
        assert missing[~outlets] == pytest.approx(0.0, abs=0.2)
        whole = missing[outlets].sum() / outlets.sum()  # the faithful plant's line fills and empties
        assert whole == pytest.approx(rate, abs=0.05 if station == "thesis-fit" else 0.8)


@pytest.mark.parametrize("station", STATIONS)
@pytest.mark.parametrize("bank", BUFFERS)
def test_a_closed_outlet_that_leaks_gives_to_the_vehicle_of_less_pressure(station, bank):
    fault = {"kind": "outlet_leak", "valve": f"outlet_{bank}", "begin_s": 0.0, "rate_g_per_s": 2.0}
    first = "cascade" if bank == "high" else "largest_gap"  # so that other banks give before this one
    record = run(station, [fault], f"logic:dispense={first}" if station == "h70-light" else "logic")
    shut = (record[f"outlet_{bank}"][:-1] == 0) & (record[f"inlet_{bank}"][:-1] == 0)
    there = (record["vehicle"][:-1] >= 0) & (record["vehicle"][1:] >= 0)
    above = (record[f"pressure_{bank}"] - record["pressure_vehicle"])[:-1]
    falls = -np.diff(record[f"mass_{bank}"])
    assert falls[shut & ~there & (record["vehicle"][:-1] < 0)] == pytest.approx(0.0, abs=1e-9)
    assert falls[shut & there & (above < -5.0)] == pytest.approx(0.0, abs=1e-9)
    leaking = shut & there & (above > 40.0)
    assert leaking.sum() > 20
    assert falls[leaking] == pytest.approx(2.0, abs=1e-6)
    held = np.sum([record[f"mass_{each}"] for each in BUFFERS], axis=0)
    missing = -np.diff(held) + record["flow_compressor"][:-1] - record["flow_dispenser"][:-1]
    assert missing.sum() == pytest.approx(0.0, abs=200.0 if station == "h70-light" else 1e-6)  # the line is vented
    if station == "h70-light":
        assert np.abs(record["mass_unaccounted"]).max() < 1e-12 * held[0]
        assert np.abs(record["energy_unaccounted"]).max() < 1.0  # of some 1e9 J


@pytest.mark.parametrize(
    ("given", "field"),
    [
        ({"valve": "outlet_top", "position": "open"}, "valve"),
        ({"valve": "outlet_low", "position": "half"}, "position"),
        ({"valve": "outlet_low"}, "position"),
        ({"kind": "outlet_leak", "valve": "inlet_low", "rate_g_per_s": 1.0}, "valve"),
        ({"kind": "outlet_leak", "valve": "outlet_low", "rate_g_per_s": 0.0}, "rate_g_per_s"),
    ],
)
def test_what_no_valve_does_is_refused(given, field):
    with pytest.raises(InputError, match=field):
        run("thesis-fit", [{"kind": "valve_stuck", "begin_s": 0.0, **given}])


def test_a_line_loses_through_an_outlet_that_is_stuck_open_too():
    stuck = {"kind": "valve_stuck", "valve": "outlet_high", "position": "open", "begin_s": 0.0}
    record = run("thesis-fit", [stuck, {"kind": "line_leak", "begin_s": 0.0, "rate_g_per_s": 2.0}])
    held = np.sum([record[f"mass_{bank}"] for bank in BUFFERS], axis=0)
    missing = -np.diff(held) + record["flow_compressor"][:-1] - record["flow_dispenser"][:-1]
    gives = (record["pressure_high"] > record["pressure_vehicle"] + 40.0)[:-1] & (record["vehicle"][1:] >= 0)
    assert missing[gives] == pytest.approx(2.0, abs=1e-6)
