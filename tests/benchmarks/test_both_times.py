"""Two times at once: what is proved lies below what controllers have, and an ideal station trades one for the other."""

from __future__ import annotations

from itertools import pairwise

import pytest

from benchmarks.both_times import Times, ideal_excess, ideal_times, proved_excess
from benchmarks.controllers_document import FOUR, cell
from station import load_scenario, load_station
from station.bounds import COARSE

COUNT = 96


def _times(name):
    return Times(*cell("thesis-fit", "S3", name)[1:3])


def test_an_excess_is_that_of_the_worse_time():
    assert Times(103.0, 210.0).excess(Times(100.0, 200.0)) == pytest.approx(0.05)
    assert Times(90.0, 180.0).excess(Times(100.0, 200.0)) == pytest.approx(-0.1)


def test_an_ideal_station_gives_one_time_for_the_other():
    found = [ideal_times(load_station("thesis-fit"), COUNT, trade_off) for trade_off in (0.3, 0.6, 1.2, 2.4)]
    for less, more in pairwise(found):
        assert more.dispensing < less.dispensing
        assert more.compressing > less.compressing


def test_an_ideal_station_is_three_percent_above_both_least_times_of_the_four():
    found = [_times(name) for name in FOUR]
    least = Times(min(each.compressing for each in found), min(each.dispensing for each in found))
    assert ideal_excess(load_station("thesis-fit"), COUNT, least) == pytest.approx(0.030, abs=0.002)


@pytest.mark.slow
def test_nobody_is_below_what_is_proved():
    scenario = load_scenario("S3").on(load_station("thesis-fit"))
    for name in ("switched", "switched:patience=0.5", "minlp1"):
        times = _times(name)
        assert -1.0 < proved_excess(scenario, times, COARSE) <= 0.0
