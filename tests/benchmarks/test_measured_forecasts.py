"""Forecasts of measured twins are held against what came: at a station that is known they are near it."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.measured_forecasts import AIR, drawn_station, figures, of_station
from station import load_station
from station.estimation.filter import model_of
from station.estimation.interface import field_of


@pytest.mark.parametrize("preset", ["thesis-fit", "h70-light"])
def test_stations_are_drawn_within_the_widths_of_the_priors(preset):
    known, drawn = load_station(preset), drawn_station(preset, 3)
    model = model_of(known)
    for name, width in model.parameters.items():
        given, found = field_of(known, name), field_of(drawn, name)
        moved = abs(found - given) / (1.0 if name in model.absolute else given)
        assert 0.0 < moved <= width
    air = drawn.thermal.ambient_temperature_c - known.thermal.ambient_temperature_c
    assert 0.0 < abs(air) <= AIR
    assert drawn_station(preset, 3) == drawn


def test_a_station_that_is_known_is_forecast_within_a_bar():
    """In air that only the filter finds, with the vehicles that wait announced."""
    station, usual = drawn_station("h70-light", 1), load_station("h70-light").thermal
    found = list(of_station("h70-light", 4.0, 1, 6, station.model_copy(update={"thermal": usual})))
    assert np.median(np.abs([each.errors for each in found])) < 1.0
    assert [round(each.served[0]) for each in found] == [each.served[1] for each in found]
    assert figures(found)[-1] == "  served count right: 100.0% of 6"
