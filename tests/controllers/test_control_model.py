"""Controllers that plan with a covolume: they serve whom they serve without, and no bound is claimed."""

from __future__ import annotations

import numpy as np
import pytest

from controllers import create_from
from station import simulate
from station.preset_files import load_station
from station.scenario import parse_scenario

STATION = load_station("h70-light")
DAY = parse_scenario(
    {
        "name": "few", "station": STATION.model_dump(),
        "arrivals": {
            "kind": "uniform", "count": 4, "period_s": 3600.0,
            "fleet": [{"name": "mixed", "share": 1, "volume_m3": [0.122, 0.157]}],
        },
    }
)  # fmt: skip


@pytest.mark.parametrize(
    "name", ["logic", "minlp1", "minlp3", "switched", "scenario", "adaptive", "guarded", "reserve"]
)
def test_all_are_served_within_the_limits(name):
    record = simulate(DAY, create_from(name), replication=1)
    assert np.isfinite(record.vehicles["finished"]).all()
    assert record.vehicles["state_of_charge"].max() <= 1.0
    assert record.vehicles["temperature_max"].max() < 85.0


def test_no_bound_is_claimed_for_a_model_with_a_covolume():
    record = simulate(DAY, create_from("switched"), replication=1)
    assert np.isfinite(record["decision_cost"]).any()
    assert np.isnan(record["decision_bound"]).all()


@pytest.mark.parametrize("name", ["switched", "minlp1"])
def test_it_plans_otherwise_than_without(name):
    without = DAY.on(STATION.model_copy(update={"control_model": None}))
    one, other = (simulate(day, create_from(name), replication=1) for day in (DAY, without))
    assert one.to_bytes() != other.to_bytes()


def test_a_section_without_a_covolume_keeps_the_rest():
    """Its ramp, its compressor and its energy law are planned with, as with a covolume that is next to nothing."""
    figures = STATION.control_model.model_dump()
    none, least = (
        DAY.on(STATION.model_validate({**STATION.model_dump(), "control_model": {**figures, "covolume_l_per_kg": b}}))
        for b in (0.0, 1e-6)
    )
    waits = [simulate(day, create_from("switched"), replication=1).metrics().t_avg for day in (none, least)]
    assert waits[0] == pytest.approx(waits[1], abs=5.0)
