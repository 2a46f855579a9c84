"""Figures of merit against sums done by hand over the record."""

from __future__ import annotations

import numpy as np
import pytest

from controllers import create
from station import load_scenario, load_station, simulate
from station.metrics import UNITS

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
    assert RECORD.metrics().energy_kwh is None
    record = simulate(load_scenario("S1").on(load_station("light-duty-700")), create("logic"))
    found = record.metrics()
    assert found.energy_kwh == pytest.approx((65 * found.t_comp + 13 * found.t_dis) / 3600)


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
