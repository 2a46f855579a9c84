"""Inlets that are stuck open: gas goes where less stands against it, and warms what it fills."""

from __future__ import annotations

import pytest

from benchmarks.drills import drill
from tests.station.estimation.hidden import told_of_half_a_day


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
    assert told_of_half_a_day(preset, "logic", seed) == []
