"""Figures of merit against sums done by hand over the record."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from controllers import create
from station import load_scenario, load_station, simulate
from station.metrics import UNITS
from tests.samples import THESIS_PRESETS

RECORD = simulate(load_scenario("S2"), create("minlp1"), replication=2, seed=9)


def test_times_by_hand():
    found = RECORD.metrics()
    waits = RECORD.vehicles["connected"] - RECORD.vehicles["arrival"]
    assert found.t_total == waits.sum()
    assert found.t_avg == pytest.approx(waits.mean())
    inlets = sum(int(RECORD[f"inlet_{b}"].sum()) for b in ("high", "medium", "low"))
    assert found.t_comp == inlets
    assert found.t_dis == sum(int(RECORD[f"outlet_{b}"].sum()) for b in ("high", "medium", "low"))
    assert found.energy == 2 * found.t_comp + found.t_dis
    assert found.delivered == pytest.approx(RECORD["flow_dispenser"].sum() / 1000)
    assert found.vehicles == 5


def test_restoring_by_stepping_the_compressor():
    """Fill each buffer at 25 deg C second by second; the last second counts in part."""
    plant = RECORD.scenario.station.constants()
    total = 0.0
    for place, name in enumerate(("high", "medium", "low")):
        mass, goal = RECORD[f"mass_{name}"][-1], RECORD[f"mass_{name}"][0]
        per_gram = 8.3145 * 298.15 / 0.002016 * 1e-8 / plant.buffer_volume[place]
        while mass < goal:
            flow = plant.inlet_coefficient * (plant.compressor_pressure - per_gram * mass)
            total += min(1.0, (goal - mass) / flow)
            mass += flow
    found = RECORD.metrics()
    assert total > 100
    assert found.t_comp_restored - found.t_comp == pytest.approx(total, abs=3 * 0.01)


def test_compressor_starts_count_rising_edges():
    on = sum(RECORD[f"inlet_{b}"].astype(int) for b in ("high", "medium", "low"))[:-1]
    assert RECORD.metrics().compressor_starts == np.maximum(np.diff(np.concatenate(([0], on))), 0).sum()


def test_kilowatt_hours_need_powers():
    powerless = RECORD.scenario.station.model_dump()
    powerless["precooler"]["power_kw"] = None
    scenario = RECORD.scenario.model_copy(update={"station": type(RECORD.scenario.station)(**powerless)})
    assert replace(RECORD, scenario=scenario).metrics().energy_kwh is None
    record = simulate(load_scenario("S1").on(load_station("light-duty-700")), create("logic"))
    found = record.metrics()
    assert found.energy_kwh == pytest.approx((65 * found.t_comp + 13 * found.t_dis) / 3600)


@pytest.mark.parametrize("preset", THESIS_PRESETS)
def test_the_powers_of_every_preset_are_those_of_a_station_of_its_flows(preset):
    """Compression 1.7-6.4 kWh/kg measured (DOE record 9013), precooling 0.3-0.5 of a busy dispenser, more of others."""
    station = load_station(preset)
    record = simulate(load_scenario("S3").on(station), create("logic"))
    found = record.metrics()
    compressed = record["flow_compressor"].sum() / 1000
    assert 1.7 <= station.compressor.power_kw * found.t_comp / 3600 / compressed <= 6.4
    assert 0.2 <= station.precooler.power_kw * found.t_dis / 3600 / found.delivered <= 1.3
    if preset.startswith("thesis"):  # the 2:1 of Sec. 7.3, which controllers weigh by
        assert station.compressor.power_kw == 2 * station.precooler.power_kw


def test_a_mapping_with_units():
    found = RECORD.metrics()
    assert set(found) == set(UNITS)
    assert found["t_total"] == found.t_total
    with pytest.raises(KeyError):
        found["t_nothing"]


def test_compressor_seconds_count_every_compressor():
    document = load_scenario("S3").model_dump()
    document["station"]["compressor"]["count"] = 2
    from station import parse_scenario

    record = simulate(parse_scenario(document), create("minlp1"))
    inlets = sum(record[f"inlet_{b}"].astype(int) for b in ("high", "medium", "low"))
    assert inlets.max() == 2
    assert record.metrics().t_comp == inlets.sum()
