"""The study of shortages: its days, its limits and what it counts."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.shortages import (
    SPACING,
    START_SPREAD,
    VEHICLES,
    followed,
    poisson_day,
    upper_limit,
    upper_limit_by_days,
)
from station import load_station


def test_a_limit_is_that_of_clopper_and_pearson():
    assert upper_limit(0, 100) == pytest.approx(1 - 0.05**0.01)
    assert upper_limit(5, 100) == pytest.approx(0.10225, abs=1e-4)
    assert upper_limit(100, 100) == 1.0


def test_drawing_days_widens_the_limit_where_days_differ():
    same, apart = [2] * 50, [0, 4] * 25
    trials = [100] * 50
    assert upper_limit_by_days(same, trials) == pytest.approx(0.02)
    assert 0.024 < upper_limit_by_days(apart, trials) < 0.026


def test_days_repeat_and_are_as_they_say():
    station = load_station("thesis-fit")
    gaps = []
    for place in range(40):
        day, law = poisson_day(place, station, 400.0)
        assert poisson_day(place, station, 400.0)[0] == day
        coming = day.vehicles()
        assert VEHICLES[0] <= len(coming.arrival) <= VEHICLES[1]
        assert SPACING[0] * 400 <= law.gap <= SPACING[1] * 400
        assert np.abs(coming.start_pressure / law.usual - 1).max() <= START_SPREAD
        gaps += (np.diff(coming.arrival, prepend=0) / law.gap).tolist()
    assert np.mean(gaps) == pytest.approx(1, abs=0.1)
    assert np.std(gaps) == pytest.approx(1, abs=0.15)


def test_a_decision_is_followed_by_the_shortages_before_the_next():
    short = np.zeros(100, bool)
    short[[10, 30, 31, 99]] = True
    assert followed(short, [0, 11, 20, 40, 99]) == 3
