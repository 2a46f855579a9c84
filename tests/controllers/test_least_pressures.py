"""Banks that may give little: what lies near their least pressures leaves nobody waiting for liveness."""

from __future__ import annotations

import numpy as np
import pytest

from controllers import create
from controllers.reserve.settings import FULL, OPEN, OPEN_SHARE, RETURNS, SETTINGS_SIZE, STOP, ReserveSettings
from controllers.reserve.settings import reserve_vector as vector_of
from station import Scenario, load_station, parse_scenario, simulate
from station.geometry import BUFFERS, HIGH
from station.parameters import Station

RATES = {"h70-light": 3.0, "h70-equal": 3.0, "h35-bus": 1.5, "h70-truck": 1.5}
"""Vehicles an hour, on the mean."""

SHARES = (0.0, 0.3, 0.6, 0.75, 0.85)
"""Least pressure of each bank by its greatest."""

SLOWER, GRACE = 1.5, 30.0
"""How much longer than with logic vehicles may wait on the mean: so many times, and so many seconds more."""

PLANNED = ("guarded", "switched", "adaptive", "scenario")


def with_least(preset: str, share: float) -> Station:
    """A preset out of whose banks nothing may flow below a share of the greatest pressure of each."""
    given = load_station(preset).model_dump(mode="json")
    real = given["real_gas"]
    real["bank_pressure_min_bar"] = {name: round(share * real["bank_pressure_max_bar"][name]) for name in BUFFERS}
    return Station.model_validate(given)


def day(preset: str, share: float) -> Scenario:
    """Ten hours of arrivals at a station with such least pressures."""
    arrivals = {"kind": "poisson", "rate_per_h": RATES[preset], "period_s": 36_000.0}
    station = with_least(preset, share).model_dump(mode="json")
    return parse_scenario({"name": "day", "station": station, "arrivals": arrivals, "time_limit_s": 200_000.0})


def played(preset: str, share: float, name: str, days: int = 3) -> tuple[float, float, float]:
    """Mean wait [s], vehicles left, and seconds of liveness of some days under a controller."""
    scenario = day(preset, share)
    told = [simulate(scenario, create(name), replication=k, seed=77).metrics() for k in range(1, days + 1)]
    left = sum(each.vehicles_not_finished + each.vehicles_incomplete for each in told)
    return float(np.mean([each.t_avg for each in told])), left, float(np.sum([each.t_liveness for each in told]))


@pytest.mark.parametrize("preset", RATES)
@pytest.mark.parametrize("share", SHARES)
def test_reserve_waits_for_no_bank_that_may_give_nothing(preset, share):
    """A vehicle stayed at a bank below its least pressure until liveness stood in, ten minutes later."""
    logic, left, _ = played(preset, share, "logic")
    wait, unserved, liveness = played(preset, share, "reserve")
    assert liveness == 0.0
    assert unserved <= left == 0
    assert wait <= 1.1 * logic + 5.0


@pytest.mark.slow
@pytest.mark.parametrize("name", [*PLANNED, "minlp1"])
@pytest.mark.parametrize("preset", RATES)
def test_nobody_waits_several_times_as_long_as_with_logic(preset, name):
    for share in SHARES:
        logic, left, _ = played(preset, share, "logic")
        wait, unserved, _ = played(preset, share, name)
        assert unserved <= left == 0
        assert wait <= SLOWER * logic + GRACE, share


@pytest.mark.slow
@pytest.mark.parametrize("name", ["minlp2", "minlp3"])
@pytest.mark.parametrize("preset", RATES)
def test_two_seconds_ahead_wait_no_longer_for_least_pressures(preset, name):
    """They price no bank and are left to liveness everywhere; what may not flow out costs them no more than that."""
    without, _, _ = played(preset, 0.0, name)
    for share in SHARES[1:]:
        wait, unserved, _ = played(preset, share, name)
        assert unserved == 0
        assert wait <= 1.1 * without, share


def test_what_opens_high_is_a_share_of_what_it_may_give():
    settings = ReserveSettings()
    for share in SHARES:
        vector = vector_of(settings, with_least("h70-equal", share))
        span = 900.0 - round(share * 900.0)
        assert vector.size == SETTINGS_SIZE
        assert vector[OPEN] == pytest.approx(OPEN_SHARE * span)
        assert vector[FULL] == pytest.approx(900.0 - (1.0 - settings.stop_share) * span)
        assert vector[RETURNS] == 1.0
    assert vector_of(ReserveSettings(open_bar=2.0), with_least("h70-equal", 0.0))[OPEN] == 2.0


@pytest.mark.parametrize("preset", ["thesis-fit", "thesis-fit-a", "light-duty-700"])
def test_the_rule_that_is_certified_knows_nothing_of_it(preset):
    vector = vector_of(ReserveSettings(), load_station(preset))
    assert vector[OPEN] == 130.0
    assert vector[FULL] == vector[STOP + HIGH]
    assert vector[RETURNS] == 0.0
