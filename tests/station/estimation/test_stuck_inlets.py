"""Inlets that are stuck open: gas goes where less stands against it, and warms what it fills."""

from __future__ import annotations

import pytest

from benchmarks.drills import OFF, drill
from benchmarks.following import HALF_DAY, WIDTH, told
from benchmarks.measured_forecasts import drawn_station, measured
from controllers import create_from
from station import load_station, parse_scenario, simulate


def stuck(bank, controller, seed):
    fault = {"kind": "valve_stuck", "valve": f"inlet_{bank}", "position": "open"}
    return drill("thesis-fit", controller, fault, seed)


@pytest.mark.parametrize(
    ("bank", "controller", "seed", "late"),
    [("medium", "logic", 45, 150), ("medium", "switched", 43, 20), ("low", "switched", 40, 20)],
)
def test_an_inlet_that_is_stuck_open_is_told_and_hardly_anything_else(bank, controller, seed, late):
    """Its gas is compressed, and so twice as many bars as cold gas would be; what was told to be filled gets none."""
    judged, false = stuck(bank, controller, seed)
    assert judged["found"]
    assert judged["delay_s"] <= late
    assert len(false) <= 1


def test_what_an_inlet_moves_that_goes_to_and_fro_adds_up():
    """Logic fills high to its stop pressure again and again, for two seconds each time."""
    judged, false = stuck("high", "logic", 43)
    assert judged["found"]
    assert judged["delay_s"] <= 1200
    assert len(false) <= 1


@pytest.mark.parametrize(("preset", "seed"), [("h35-bus", 501), ("h70-truck", 504), ("h35-bus", 505)])
def test_a_bank_that_warms_after_it_has_given_is_not_filled(preset, seed):
    """It stands above the bank that is told to be filled: no gas goes there, whatever its pressure does."""
    hidden, known = drawn_station(preset, seed, OFF / WIDTH), load_station(preset)
    known = known.model_copy(update={"calibrated": True})
    law = {"kind": "uniform", "count": 20, "period_s": float(HALF_DAY)}
    given = {"name": "day", "station": hidden.model_dump(mode="json"), "arrivals": law}
    scenario = parse_scenario({**given, "time_limit_s": float(HALF_DAY)})
    record = simulate(scenario, create_from("logic"), replication=seed, seed=seed)
    assert told(measured(record, seed), known) == []
