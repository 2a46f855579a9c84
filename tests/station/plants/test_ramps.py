"""Ramps in the loop: fixed, a table's, chosen by the model; and fills of vehicles that report nothing."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from controllers import create
from station import InputError, load_station, parse_scenario, simulate
from station.geometry import KELVIN
from station.live import AtEnd, LiveRun
from station.plants.real_gas.catalog import TEMPERATURE_LIMIT
from station.plants.real_gas.fill import End
from station.plants.real_gas.options import RampTableOptions
from station.plants.real_gas.ramp_table import full_pressure
from station.readings import observations
from station.record import Record

HOT = TEMPERATURE_LIMIT - KELVIN
FLEET = [
    {"name": "any", "volume_m3": [0.03, 0.6], "start_pressure_bar": [5.0, 250.0]},
    {"name": "usual", "volume_m3": [0.122, 0.157], "start_pressure_bar": [20.0, 200.0]},
    {"name": "old", "volume_m3": [0.05, 0.3], "start_pressure_bar": [10.0, 150.0], "finish_pressure_bar": [350.0] * 2},
]  # fmt: skip
TABLE = {"volume_l": [100.0, 200.0], "start_bar": [50.0, 150.0], "ramp_mpa_per_min": [[10.0, 20.0], [5.0, 15.0]]}


def scenario(dispensing: dict[str, Any], ambient: float = 25.0, count: int = 60, *, communication: bool = True, **more):
    station = load_station("h70-light").model_dump()
    station["real_gas"]["dispensing"].update(dispensing)
    station["thermal"]["ambient_temperature_c"] = station["vehicle"]["start_temperature_c"] = ambient
    arrivals = {"kind": "poisson", "rate_per_h": count / 24, "period_s": 86_400.0, "fleet": FLEET}
    given = {"name": "day", "station": station, "communication": communication, "arrivals": arrivals}
    return parse_scenario({**given, **more})


def day(
    dispensing: dict[str, Any], ambient: float = 25.0, replication: int = 1, *, communication: bool = True
) -> Record:
    given = scenario(dispensing, ambient, communication=communication)
    record = simulate(given, create("logic"), replication=replication)
    assert not np.isnan(record.vehicles["finished"]).any()
    return record


def fill_times(record: Record) -> np.ndarray:
    return record.vehicles["finished"] - record.vehicles["connected"]


@pytest.mark.slow
@pytest.mark.parametrize("ambient", [-20.0, 10.0, 40.0])
def test_a_chosen_ramp_keeps_every_tank_cool_to_the_target(ambient):
    record = day({"ramp_choice": "auto", "ramp_mpa_per_min": 60.0}, ambient)
    assert set(record.vehicles["ended_by"]) == {End.STATE_OF_CHARGE}
    assert record.vehicles["temperature_max"].max() < HOT
    assert (len(set(record.vehicles["ramp"])) > 1) is (ambient > 0)  # in the cold the steepest will do for all
    assert record.vehicles["ramp"].max() <= 60.0


@pytest.mark.slow
def test_it_is_faster_than_the_fixed_one_that_is_safe_for_all_of_them():
    chosen = day({"ramp_choice": "auto", "ramp_mpa_per_min": 60.0})
    fixed = day({"ramp_mpa_per_min": float(chosen.vehicles["ramp"].min())})
    assert np.median(fill_times(chosen)) < 0.5 * np.median(fill_times(fixed))  # large ones wait for the compressor


def test_the_chosen_ramp_is_bounded_by_the_one_given():
    assert set(day({"ramp_choice": "auto", "ramp_mpa_per_min": 9.0}).vehicles["ramp"]) == {9.0}


def test_a_table_of_ones_own_is_looked_up_by_volume_and_start():
    vehicles = day({"ramp_table": TABLE, "ramp_mpa_per_min": 18.0}).vehicles
    own = RampTableOptions(**TABLE)
    single = vehicles["volume"] / np.ceil(vehicles["volume"] / 0.35)  # of several tanks side by side each is looked up
    row = np.minimum(np.searchsorted(own.volume_l, single * 1e3), 1)
    column = np.minimum(np.searchsorted(own.start_bar, vehicles["start_pressure"]), 1)
    assert vehicles["ramp"].tolist() == np.minimum(np.array(own.ramp_mpa_per_min)[row, column], 18.0).tolist()
    assert len(set(vehicles["ramp"])) == 4


def test_who_does_not_report_a_volume_gets_the_gentlest_of_the_column():
    vehicles = day({"ramp_table": TABLE}, communication=False).vehicles
    assert set(vehicles["ramp"]) == {5.0, 15.0}
    assert ((vehicles["ramp"] == 5.0) == (vehicles["start_pressure"] <= 50.0)).all()


@pytest.mark.parametrize("ambient", [-20.0, 25.0, 40.0])
@pytest.mark.parametrize("choice", ["fixed", "auto"])
def test_without_communication_nobody_is_overfilled(ambient, choice):
    record = day({"ramp_choice": choice, "ramp_mpa_per_min": 22.0}, ambient, communication=False)
    assert set(record.vehicles["ended_by"]) == {End.FULL}
    charge = record.vehicles["state_of_charge"]
    assert charge.min() > 0.75
    assert charge.max() <= 1.0
    for bar, nominal in ((350.0, 35e6), (700.0, 70e6)):
        reached = record.vehicles["final_pressure"][record.vehicles["finish_pressure"] == bar]
        assert reached == pytest.approx(full_pressure(nominal, ambient + KELVIN, ambient + KELVIN) / 1e5, abs=0.5)
    if choice == "auto":
        assert record.vehicles["temperature_max"].max() < HOT


@pytest.mark.parametrize(("ambient", "start"), [(45.0, 25.0), (50.0, 25.0), (20.0, -10.0), (40.0, 10.0), (-20.0, 25.0)])
@pytest.mark.parametrize("choice", ["fixed", "auto"])
def test_tanks_that_come_colder_or_warmer_than_the_air_are_not_overfilled_either(ambient, start, choice):
    """Without communication: nearly full ones, whose gas the fill hardly warms, and empty ones, which it warms most."""
    station = load_station("h70-light").model_dump()
    station["real_gas"]["dispensing"].update({"ramp_choice": choice, "ramp_mpa_per_min": 22.0})
    station["thermal"]["ambient_temperature_c"], station["vehicle"]["start_temperature_c"] = ambient, start
    kinds = ((350.0, 320.0), (350.0, 250.0), (350.0, 20.0), (700.0, 600.0), (700.0, 620.0), (700.0, 20.0))
    vehicles = [
        {"time_s": 3600.0 * k, "start_pressure_bar": low, "volume_m3": 0.3, "finish_pressure_bar": high}
        for k, (high, low) in enumerate(kinds)
    ]
    given = {"name": "day", "station": station, "communication": False}
    record = simulate(parse_scenario({**given, "arrivals": {"kind": "trace", "vehicles": vehicles}}), create("logic"))
    raised = record.vehicles["delivered"] > 0
    assert raised.sum() >= 3
    assert record.vehicles["state_of_charge"][raised].max() <= 1.0
    if choice == "auto":
        assert record.vehicles["temperature_max"].max() < HOT


def test_a_fill_that_is_paused_without_communication_is_not_overfilled():
    """Banks that are nearly empty: the vehicle waits at the nozzle for the compressor and takes cold gas for hours."""
    station = load_station("h70-light").model_dump()
    for name in ("high", "medium", "low"):
        station["buffers"][name]["initial_pressure_bar"] = 300.0
        station["buffers"][name]["volume_m3"] = 0.2
    vehicles = [{"time_s": 0.0, "start_pressure_bar": 20.0, "volume_m3": 1.0}]
    given = {"name": "slow", "station": station, "communication": False, "time_limit_s": 40_000.0}
    record = simulate(parse_scenario({**given, "arrivals": {"kind": "trace", "vehicles": vehicles}}), create("logic"))
    assert fill_times(record)[0] > 5_000
    assert record.vehicles["ended_by"].tolist() == [End.FULL]
    assert record.vehicles["state_of_charge"][0] <= 1.0


@pytest.mark.slow
def test_the_dispenser_reads_the_pressure_of_who_reports_nothing():
    record = day({}, communication=False)
    seen = list(observations(record))
    pressure = np.array([each.vehicle_pressure for each in seen])
    assert np.array_equal(pressure, record["pressure_vehicle"], equal_nan=True)
    temperature = np.array([each.vehicle_temperature for each in seen])
    there = record["vehicle"] >= 0
    assert np.isnan(temperature[there]).any()
    assert {each.vehicle_volume for each in seen} == {record.scenario.station.vehicle.volume_m3}


@pytest.mark.parametrize(
    ("dispensing", "communication", "refused"),
    [({}, True, False), ({}, False, True), ({"ramp_choice": "auto"}, True, True), ({"ramp_table": TABLE}, True, False)],
)
def test_a_nominal_pressure_that_nothing_was_worked_out_for_is_refused(dispensing, communication, refused):
    fleet = [{"name": "odd", "finish_pressure_bar": [500.0, 500.0]}]
    arrivals = {"kind": "uniform", "count": 2, "period_s": 600.0, "fleet": fleet}
    if refused:
        with pytest.raises(InputError, match=r"arrivals\.fleet\.0\.finish_pressure_bar must be 350 or 700 bar"):
            scenario(dispensing, communication=communication, arrivals=arrivals)
    else:
        assert scenario(dispensing, communication=communication, arrivals=arrivals)
    live = LiveRun(scenario(dispensing, communication=communication), AtEnd.IDLE)
    if refused:
        with pytest.raises(InputError, match="finish_pressure_bar must be 350 or 700 bar"):
            live.add_vehicle(100.0, finish_pressure=500.0)
    else:
        live.add_vehicle(100.0, finish_pressure=500.0)


@pytest.mark.parametrize(
    ("dispensing", "message"),
    [
        ({"ramp_choice": "auto", "ramp_table": TABLE}, "ramp_table must be left out with ramp_choice = 'auto'"),
        ({"ramp_choice": "table"}, "'fixed' or 'auto'"),
        ({"ramp_table": {**TABLE, "volume_l": [200.0, 100.0]}}, "volume_l must increase"),
        ({"ramp_table": {**TABLE, "start_bar": [50.0]}}, "must have 2 rows of 1 ramps"),
        ({"ramp_table": {**TABLE, "ramp_mpa_per_min": [[10.0, 20.0]]}}, "must have 2 rows of 2 ramps"),
        ({"ramp_table": {**TABLE, "ramp_mpa_per_min": [[10.0, 20.0], [5.0, 61.0]]}}, "less than or equal to 60"),
        ({"ramp_table": {**TABLE, "volume_l": [100.0, float("inf")]}}, "finite number"),
        ({"ramp_table": {**TABLE, "volume_l": []}}, "at least 1 item"),
    ],
)
def test_a_ramp_that_cannot_be_is_refused(dispensing, message):
    with pytest.raises(InputError, match=message):
        scenario(dispensing)
