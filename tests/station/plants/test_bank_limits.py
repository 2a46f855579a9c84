"""Limits that stations with real gas alone have: least pressure and temperature of a bank, minimum times of valves."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from controllers import create
from station import InputError, Limit, load_station, parse_scenario, simulate
from station.geometry import BUFFERS, VALVES
from station.plants.interface import plant_named
from station.record import Record


def day(changes: dict[str, Any], controller: str = "logic", ambient: float = 25.0, count: int = 30) -> Record:
    station = load_station("h70-light").model_dump()
    station["real_gas"] |= changes
    station["thermal"]["ambient_temperature_c"] = station["vehicle"]["start_temperature_c"] = ambient
    for buffer in BUFFERS:
        station["buffers"][buffer]["initial_temperature_c"] = ambient
    arrivals = {"kind": "uniform", "count": count, "period_s": 43_200.0}
    record = simulate(parse_scenario({"name": "day", "station": station, "arrivals": arrivals}), create(controller))
    assert not np.isnan(record.vehicles["finished"]).any()
    return record


def spans(record: Record, valve: str) -> list[tuple[int, int, int]]:
    """From, to [s], and whether it was open, of each span in which a valve stayed as it was; but the first and last."""
    states = record[valve].astype(int)
    edges, times = (np.flatnonzero(np.diff(states)) + 1).tolist(), record["time"]
    return [(int(times[a]), int(times[b]), int(states[a])) for a, b in pairwise(edges)]


def lowest_giving(record: Record) -> dict[str, float]:
    """The lowest pressure at which each bank gave gas [bar]; infinite for one that never did."""
    return {
        name: float(record[f"pressure_{name}"][record[f"outlet_{name}"] > 0].min(initial=np.inf)) for name in BUFFERS
    }


@pytest.mark.parametrize("controller", ["logic", "switched", "minlp1"])
def test_nothing_flows_out_of_a_bank_below_its_least_pressure(controller):
    free = lowest_giving(day({}, controller))
    most = dict(load_station("h70-light").real_gas.bank_pressure_max_bar)
    least = {name: min(bar + 20.0, (bar + most[name]) / 2) for name, bar in free.items() if np.isfinite(bar)}
    held = lowest_giving(day({"bank_pressure_min_bar": least}, controller))
    assert least
    assert all(held[name] >= bar for name, bar in least.items())


def test_nothing_flows_out_of_a_bank_below_its_least_temperature():
    """Banks of a cold country that may not become as cold as expansion makes them."""
    free, held = (day({"bank_temperature_min_c": least}, ambient=-20.0) for least in (-100.0, -28.0))
    lowest = [
        min(record[f"temperature_{name}"][record[f"outlet_{name}"] > 0].min() for name in BUFFERS)
        for record in (free, held)
    ]
    assert lowest[0] < -28.0 <= lowest[1]


@pytest.mark.parametrize("controller", ["logic", "switched", "minlp1"])
def test_valves_stay_as_they_are_for_their_minimum_times(controller):
    """One is closed before its time only where a limit forbids it to be open: its vehicle left, or its bank is full."""
    record = day({"minimum_on_s": 10.0, "minimum_off_s": 8.0}, controller)
    constants = record.scenario.plant()
    plant = plant_named("real-gas")
    closed, opened = 0, 0
    for valve in VALVES:
        for start, end, is_open in spans(record, valve):
            if not is_open:
                closed += 1
                assert end - start >= 8
            elif end - start < 10:
                side, name = valve.split("_")
                if side == "outlet":
                    gap = record[f"pressure_{name}"][end] - record["pressure_vehicle"][end]
                    assert record["vehicle"][end] != record["vehicle"][end - 1] or gap < 10.0
                else:
                    place = BUFFERS.index(name)
                    assert record[f"pressure_{name}"][end] >= plant.filled_to(place, constants)
            else:
                opened += 1
    assert closed > 20
    assert opened > 20


def test_minlp1_switches_less_than_half_as_often_with_them():
    moves = [
        sum(np.abs(np.diff(record[valve].astype(int))).sum() for valve in VALVES)
        for record in (day({}, "minlp1"), day({"minimum_on_s": 10.0, "minimum_off_s": 10.0}, "minlp1"))
    ]
    assert moves[1] < moves[0] / 2


@pytest.mark.parametrize("controller", ["logic", "switched"])
def test_everybody_is_served_from_empty_banks_whose_valves_stay_closed_for_minutes(controller):
    station = {
        "preset": "h35-bus", "name": "slow valves", "real_gas": {"minimum_off_s": 300.0},
        "buffers": {name: {"initial_pressure_bar": 60.0} for name in BUFFERS},
    }  # fmt: skip
    arrivals = {"kind": "uniform", "count": 10, "period_s": 18_000.0}
    scenario = parse_scenario({"name": "d", "station": station, "arrivals": arrivals, "time_limit_s": 200_000.0})
    record = simulate(scenario, create(controller))
    assert np.isfinite(record.vehicles["finished"]).all()


def test_a_refusal_is_named():
    record = day({"minimum_on_s": 10.0, "minimum_off_s": 10.0}, "minlp1")
    codes = {int(code) for valve in VALVES for code in np.unique(record[f"refused_{valve}"])}
    assert Limit.MINIMUM_TIME in codes


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"bank_pressure_min_bar": {"high": 950.0}}, "bank_pressure_min_bar.high must lie below"),
        ({"bank_pressure_min_bar": {"low": -1.0}}, "greater than or equal to 0"),
        ({"bank_temperature_min_c": 30.0}, "less than or equal to 20"),
        ({"minimum_on_s": 601.0}, "less than or equal to 600"),
        ({"minimum_off_s": float("nan")}, "finite number"),
        ({"precooler": {"block_mass_kg": 1e-3}}, r"block_mass_kg: .* equal to 1; given 0\.001"),
        (
            {
                "dispensing": {
                    "ramp_mpa_per_min": 22.0,
                    "ramp_table": {"volume_l": [0.1, 0.2], "start_bar": [50.0], "ramp_mpa_per_min": [[20.0], [10.0]]},
                }
            },
            r"ramp_table\.volume_l\.0: .* equal to 1; given 0\.1",
        ),
    ],
)
def test_what_cannot_be_is_refused(changes, message):
    with pytest.raises(InputError, match=message):
        day(changes)


@pytest.mark.parametrize("place", ["vehicle", "buffers.low"])
def test_a_tank_too_small_to_be_computed_is_refused(place):
    section = {"volume_m3": 1e-300}
    changes = {"vehicle": section} if place == "vehicle" else {"buffers": {"low": section}}
    given = {
        "name": "day",
        "station": {"preset": "h70-light", **changes},
        "arrivals": {"kind": "uniform", "count": 1, "period_s": 60.0},
    }
    with pytest.raises(InputError, match=f"{place}.volume_m3 must be at least 0.001 m3 with real gas; given 1e-300"):
        parse_scenario(given)


@pytest.mark.parametrize("air", [-35.0, 0.0, 10.0])
def test_what_is_missing_in_the_cold_has_a_price(air):
    """Banks that are full in the cold could not hold as much at 25 degC: it was infinite."""
    told = day({}, "switched", ambient=air, count=10).metrics()
    assert np.isfinite([told.t_comp_restored, told.total_eur, told.eur_per_kg]).all()
