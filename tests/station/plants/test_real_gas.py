"""The faithful plant in the loop: a day of mixed vehicles by logic, its ledger and record; live runs, station files."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest

from controllers import create
from station import InputError, Station, load_scenario, load_station, parse_scenario, simulate
from station.geometry import KELVIN
from station.live import AtEnd, LiveRun, SlotState
from station.metrics import incomplete, state_of_charge
from station.plants.interface import OWN, plant_named
from station.plants.real_gas.catalog import TEMPERATURE_LIMIT
from station.plants.real_gas.entries import FIGURES, LEVELS, RATES
from station.plants.real_gas.fill import PERIOD, End
from station.plants.real_gas.registration import REAL_GAS
from station.record import Record
from station.run import PERIOD as RUN_PERIOD

BUSY = {
    "name": "busy", "station": {"preset": "h70-light"},
    "arrivals": {
        "kind": "uniform", "count": 30, "period_s": 43_200.0,
        "fleet": [{"name": "light", "volume_m3": [0.122, 0.157]}, {"name": "small", "volume_m3": [0.05, 0.1]}],
    },
}  # fmt: skip
"""Twelve hours of vehicles of two classes."""


@cache
def day(controller: str = "logic", replication: int = 1) -> Record:
    return simulate(parse_scenario(BUSY), create(controller), replication=replication)


@pytest.mark.parametrize("replication", [0, 1, 2])
def test_a_day_of_logic_serves_everybody_within_every_limit(replication):
    record = day(replication=replication)
    vehicles = record.vehicles
    assert not np.isnan(vehicles["finished"]).any()
    assert set(vehicles["ended_by"]) == {End.STATE_OF_CHARGE}
    assert vehicles["state_of_charge"] == pytest.approx(0.95, abs=2e-4)
    assert vehicles["state_of_charge"].max() <= 0.95 + 1e-12
    assert vehicles["temperature_max"].max() < TEMPERATURE_LIMIT - KELVIN
    top = record.scenario.station.real_gas.bank_pressure_max_bar
    for name, most in top:
        assert record[f"pressure_{name}"].max() < most + 3.0  # the last second of filling passes it
    assert np.nanmax(record["flow_dispenser"]) <= 60.0 * (1 + 1e-12)


def test_mass_and_energy_are_accounted_for():
    record = day()
    stored = sum(record[f"mass_{name}"][0] for name in ("high", "medium", "low"))
    assert record["time"][-1] > 42_000
    assert np.abs(record["mass_unaccounted"]).max() < 1e-12 * stored
    assert np.abs(record["energy_unaccounted"]).max() < 1e-10 * 3.6e6 * record.metrics().energy_kwh


def test_the_record_holds_what_the_plant_tells():
    record = day()
    assert list(record.columns)[17 : 17 + len(RATES) + len(LEVELS)] == [*RATES, *LEVELS]
    assert set(FIGURES) < set(record.vehicles)
    spans = np.diff(record["time"])
    for machine in ("compressor", "precooler"):
        energy = record[f"energy_{machine}"]
        assert energy[-1] == pytest.approx((record[f"power_{machine}"][:-1] * spans).sum() / 3600, rel=1e-9)
        assert record[f"power_{machine}"][-1] == 0.0
    figures = record.metrics()
    assert figures.energy_kwh == record["energy_compressor"][-1] + record["energy_precooler"][-1]
    assert 0.7 < record["energy_compressor"][-1] / figures.delivered < 1.2
    there = record["vehicle"] >= 0
    assert np.isnan(record["state_of_charge_vehicle"]).tolist() == (~there).tolist()
    giving = record["flow_dispenser"] > 10
    assert np.nanmedian(record["temperature_delivery"][giving]) == pytest.approx(-33, abs=3)
    assert (state_of_charge(record.vehicles, "real-gas") == record.vehicles["state_of_charge"]).all()
    without = {name: column for name, column in record.vehicles.items() if name not in FIGURES}
    assert state_of_charge(without, "real-gas") == pytest.approx(record.vehicles["state_of_charge"], rel=1e-5)


def test_a_record_comes_back_from_parquet():
    record = day()
    again = Record.from_parquet(record.parquet())
    assert again.to_bytes() == record.to_bytes()
    assert again.columns == record.columns
    assert simulate(record.scenario, create("logic"), replication=1).to_bytes() == record.to_bytes()


def test_a_live_run_goes_on_from_a_snapshot_to_the_byte():
    scenario = parse_scenario({**BUSY, "arrivals": {"kind": "uniform", "count": 2, "period_s": 300.0}})

    def begun() -> LiveRun:
        return LiveRun(scenario, AtEnd.IDLE)

    def rows(run: LiveRun, count: int) -> list[tuple[float, ...]]:
        actor = create("logic")
        actor.start(scenario.station)
        return [run.step(SlotState(actor.decide, actor.obeys_hold)).row for _ in range(count)]

    whole, other = begun(), begun()
    rows(whole, 100)
    other.restore(whole.snapshot())
    assert other._run.state.tobytes() == whole._run.state.tobytes()
    assert np.array_equal(rows(whole, 300), rows(other, 300), equal_nan=True)
    assert whole._run.state.tobytes() == other._run.state.tobytes()
    assert whole._run.vehicles.tobytes() == other._run.vehicles.tobytes()
    assert whole.vehicle(0)["ended_by"] == End.STATE_OF_CHARGE
    assert whole.add_vehicle(200.0, volume=0.08) == 2


def test_a_vehicle_of_35_mpa_is_full_by_its_own_density():
    fleet = [{"name": "old", "volume_m3": [0.07, 0.08], "finish_pressure_bar": [350.0, 350.0]}]
    arrivals = {"kind": "uniform", "count": 2, "period_s": 600.0, "fleet": fleet}
    record = simulate(parse_scenario({**BUSY, "arrivals": arrivals}), create("logic"))
    assert record.vehicles["state_of_charge"] == pytest.approx(0.95, abs=2e-4)
    assert record.vehicles["final_pressure"].max() < 437.5
    held = record.vehicles["delivered"] + REAL_GAS.held(100.0, 25.0, record.vehicles["volume"])
    assert held / record.vehicles["volume"] / 1e3 == pytest.approx(0.95 * 24.0, rel=1e-3)


def test_a_fill_that_the_temperature_ends_is_incomplete_and_no_warmer_than_its_limit():
    station = {
        "preset": "h70-light", "name": "warm",
        "real_gas": {"precooler": {"set_point_c": 15.0}, "dispensing": {"ramp_mpa_per_min": 28.0}},
        "thermal": {"ambient_temperature_c": 40.0},
    }  # fmt: skip
    record = simulate(
        parse_scenario({**BUSY, "station": station, "arrivals": {"kind": "uniform", "count": 3, "period_s": 1200.0}}),
        create("logic"),
    )
    vehicles = record.vehicles
    assert set(vehicles["ended_by"]) == {End.TEMPERATURE}
    assert incomplete(record).all()
    assert record.metrics().vehicles_incomplete == 3
    assert vehicles["state_of_charge"].max() < 0.6
    assert 82.0 < vehicles["temperature_max"].min() <= vehicles["temperature_max"].max() < TEMPERATURE_LIMIT - KELVIN


@pytest.mark.parametrize(("volume", "limit"), [(0.05, 45.0), (0.05, 60.0), (0.1, 45.0), (0.3, 45.0)])
def test_a_bank_is_not_filled_into_its_greatest_temperature_however_small_it_is(volume, limit):
    bank = {"volume_m3": volume, "initial_pressure_bar": 60.0, "initial_temperature_c": 30.0}
    station = {
        "preset": "h70-light", "name": "small banks", "buffers": dict.fromkeys(("high", "medium", "low"), bank),
        "thermal": {"ambient_temperature_c": 30.0, "buffer_temperature_max_c": limit},
    }  # fmt: skip
    arrivals = {"kind": "uniform", "count": 3, "period_s": 1200.0}
    record = simulate(parse_scenario({**BUSY, "station": station, "arrivals": arrivals}), create("logic"))
    warmest = max(record[f"temperature_{name}"].max() for name in ("high", "medium", "low"))
    assert limit - 1.0 < warmest <= limit


def test_a_small_bank_that_is_nearly_empty_is_filled_all_the_same():
    bank = {"volume_m3": 0.05, "initial_pressure_bar": 5.0, "initial_temperature_c": 30.0}
    station = {
        "preset": "h70-light", "name": "empty banks", "buffers": dict.fromkeys(("high", "medium", "low"), bank),
        "thermal": {"ambient_temperature_c": 30.0, "buffer_temperature_max_c": 60.0},
    }  # fmt: skip
    arrivals = {"kind": "uniform", "count": 2, "period_s": 600.0}
    record = simulate(parse_scenario({**BUSY, "station": station, "arrivals": arrivals}), create("logic"))
    assert record.metrics().vehicles_not_finished == 0
    assert record["pressure_low"][-1] > 400.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"real_gas": None}, "real_gas must be given with plant = 'real-gas'"),
        ({"plant": "thesis"}, "real_gas must be given with plant = 'real-gas'"),
        ({"real_gas": {"bank_pressure_max_bar": {"high": 1001.0}}}, "must not exceed compressor.pressure_max_bar"),
        ({"real_gas": {"bank_pressure_max_bar": {"low": 400.0}}}, "initial_pressure_bar must not exceed"),
        ({"real_gas": {"dispensing": {"target_percent": 101.0}}}, "less than or equal to 100"),
        ({"real_gas": {"compressor": {"suction_bar": 1000.0}}}, "suction_bar must lie below"),
        ({"real_gas": {"dispensing": {"ramp": 1.0}}}, "Extra inputs are not permitted"),
    ],
)
def test_a_station_file_that_cannot_be_is_refused(changes, message):
    with pytest.raises(InputError, match=message):
        parse_scenario({**BUSY, "station": {"preset": "h70-light", **changes}})


def test_other_stations_know_nothing_of_it():
    thesis, own = load_station("thesis-fit"), load_station("h70-light")
    assert "real_gas" not in thesis.model_dump()
    assert "real_gas" not in Station.model_json_schema()["required"]
    assert Station.model_validate(json.loads(own.model_dump_json())) == own
    assert own.constants().unfilled == (1050.0, 1250.0, 1500.0)
    assert plant_named("real-gas") is REAL_GAS
    plain = simulate(load_scenario("S1"), create("logic"))
    assert len(plain.values) == 17


def test_what_a_plant_tells_of_itself():
    station = load_station("h70-light")
    constants = REAL_GAS.constants_of(station, communication=True)
    state = np.zeros(OWN + REAL_GAS.own)
    for place, buffer in enumerate(station.buffers.all):
        REAL_GAS.begin(state, place, buffer.initial_pressure_bar, 25.0, buffer.volume_m3, np.nan, constants)
    REAL_GAS.begin(state, 3, 100.0, 25.0, 0.14, 700.0, constants)
    assert REAL_GAS.leaves_at(state, 700.0, constants) == pytest.approx(681.0, abs=10.0)  # at 25 degC
    assert [REAL_GAS.filled_to(place, constants) for place in range(3)] == [950.0, 750.0, 500.0]
    assert REAL_GAS.held(700.0, 15.0, 0.1) == pytest.approx(4017, rel=1e-3)
    empty, full = REAL_GAS.held(700.0, 25.0, 0.5), REAL_GAS.held(940.0, 25.0, 0.5)
    assert REAL_GAS.restoring_time(0, empty, full, constants) == pytest.approx((full - empty) / 7.2, rel=0.05)
    assert REAL_GAS.restoring_time(0, empty, REAL_GAS.held(1050.0, 25.0, 0.5), constants) == np.inf


def test_tanks_are_made_for_the_period_of_a_run():
    assert PERIOD == RUN_PERIOD


def test_a_record_begins_as_the_station_file_says():
    scenario = parse_scenario(BUSY)
    record = simulate(scenario, create("logic"))
    for name in ("high", "medium", "low"):
        buffer = getattr(scenario.station.buffers, name)
        assert record[f"pressure_{name}"][0] == pytest.approx(buffer.initial_pressure_bar, rel=1e-12)
        assert record[f"temperature_{name}"][0] == pytest.approx(buffer.initial_temperature_c, abs=1e-9)
        held = REAL_GAS.held(buffer.initial_pressure_bar, buffer.initial_temperature_c, buffer.volume_m3)
        assert record[f"mass_{name}"][0] == pytest.approx(held, rel=1e-5)  # by tables
