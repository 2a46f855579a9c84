"""Shifts of a station: what a file may say of them, and that a station without them is written as before."""

from __future__ import annotations

import pytest

from station import InputError, load_station, parse_scenario
from station.shifts import Shifts

ARRIVALS = {"kind": "uniform", "count": 1, "period_s": 60.0}


def at(shifts):
    return parse_scenario(
        {"name": "x", "station": {"preset": "thesis-fit", "shifts": shifts}, "arrivals": ARRIVALS}
    ).station


def test_a_station_has_the_shifts_of_its_file_and_else_those_of_eight_hours_from_midnight_on():
    assert load_station("thesis-fit").shifts == Shifts(shift_h=8, first_h=0)
    assert "shifts" not in load_station("thesis-fit").model_dump(mode="json")
    own = at({"shift_h": 12, "first_h": 7})
    assert own.shifts == Shifts(shift_h=12, first_h=7)
    assert own.model_dump(mode="json")["shifts"] == {"shift_h": 12, "first_h": 7}


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"shift_h": 7}, "shift_h: must divide 24 h.*given 7"),
        ({"shift_h": 48}, "shift_h: .*less than or equal to 24"),
        ({"first_h": 24}, "first_h: .*less than 24"),
        ({"hours": 8}, "hours"),
    ],
)
def test_shifts_that_no_day_has_are_refused(given, message):
    with pytest.raises(InputError, match=message):
        at(given)
