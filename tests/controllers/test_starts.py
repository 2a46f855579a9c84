"""Controllers at stations whose buffers can be filled too far to begin the fill of an empty vehicle, Eq. (7.11)."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from benchmarks.fleet_days import SEED, day
from controllers import create
from station import Limit, parse_scenario, simulate
from station.geometry import BUFFERS, INLETS
from station.limits import start_limit
from station.valves import commands
from tests.controllers.replay import enumerate_best
from tests.controllers.states import problem, seeded

STALLED_DAY = 6  # of those at thesis-fit-a
USUAL_DAY = 1  # one on which MINLP 1 at light-duty-700 leaves 75 usual vehicles, unless told how empty they come
MINLPS = ("minlp1", "minlp2", "minlp3")
EMPTY_DAYS = (0, 1, 2)
"""Drawn days of mixed fleets at light-duty-700 on which MINLP 1 to 3 left 20 to 67 vehicles that logic serves."""


def _played(place, station, name, **options):
    return simulate(day(place, station, mixed=True), create(name, **options), replication=place + 1, seed=SEED)


@pytest.mark.parametrize(("name", "place"), [*product(MINLPS, EMPTY_DAYS[1:]), ("reserve", 1), ("logic", 1)])
def test_nobody_is_left_on_a_day_of_mixed_tanks(name, place):
    record = _played(place, "light-duty-700", name)
    assert not np.isnan(record.vehicles["finished"]).any()
    assert not any((record[f"refused_inlet_{buffer}"] == Limit.BEGIN).any() for buffer in BUFFERS)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "place"), [*product(MINLPS, range(20))])
def test_nobody_is_left_on_twenty_days_of_mixed_tanks(name, place):
    assert not np.isnan(_played(place, "light-duty-700", name).vehicles["finished"]).any()


@pytest.mark.parametrize(("horizon", "count"), [(1, 60), (2, 6)])
def test_minlp_finds_the_best_that_leaves_an_inlet_closed(horizon, count):
    """What the slot keeps closed binds the first stage; the others are planned without."""
    source, bound = seeded(np.random.default_rng(horizon)), 0
    for place in range(count):
        free = problem(source, horizon, 1 + place % 2, node_limit=10**9)
        closed = 1 << place % 3
        held = free._replace(observation=free.observation._replace(timed=(0, closed)))
        found = held.exact()
        if start_limit(free.plant) >= free.plant.compressor_pressure:  # no buffer is ever too full there
            assert found == free.exact()
            continue
        assert found.command & closed == 0
        best, _ = enumerate_best(held.cost, commands(free.plant.compressor_count), horizon + 1)
        assert found.cost == pytest.approx(best, rel=1e-9)
        bound += free.exact().command & INLETS & closed != 0
    assert bound


def test_minlp1_serves_usual_vehicles_where_the_station_says_how_empty_they_come():
    usual = day(USUAL_DAY, "light-duty-700", mixed=False).model_dump()
    usual["station"]["slot"]["emptiest_bar"] = 50.0
    record = simulate(parse_scenario(usual), create("minlp1"), replication=USUAL_DAY + 1, seed=SEED)
    assert not np.isnan(record.vehicles["finished"]).any()


def test_minlp1_stands_still_as_printed_and_serves_all_with_the_slots_liveness():
    printed = _played(STALLED_DAY, "thesis-fit-a", "minlp1", liveness_s=0)
    assert np.isnan(printed.vehicles["finished"]).any()
    live = _played(STALLED_DAY, "thesis-fit-a", "minlp1")
    assert not np.isnan(live.vehicles["finished"]).any()
