"""Certificates of service for vehicles in ranges: what is proved holds for any of them, what is false is refused."""

from __future__ import annotations

import copy
import json

import pytest

from benchmarks.service_runs import run
from controllers.certified.box import observe_scenarios
from controllers.certified.claim import Asked, Claim, claim_of
from controllers.certified.service import CERTIFIED, RefusedError, certify, verify
from controllers.certified.vehicles import vehicles_of
from station import InputError, load_station
from tests.controllers.test_service import runs_stay_within
from tests.generous import generous

RANGES = Asked(volume=(0.13, 0.15), start_spread=40.0)


@pytest.fixture(scope="module")
def ranged(once):
    return once("proved-ranges", lambda: certify("reserve", generous(), RANGES))


@pytest.mark.slow
def test_a_proof_for_ranges_keeps_its_word_for_every_vehicle(ranged):
    assert ranged["verdict"] == CERTIFIED
    assert ranged["vehicles"]["volume_m3"] == [0.13, 0.15]
    low, high = ranged["vehicles"]["start_pressure_bar"]
    assert high - low == pytest.approx(80.0)
    assert "vehicle of 0.13 to 0.15 m3 that begins with" in ranged["claim"]
    assert ranged["proof"]["vehicle_cells"] > 1
    assert ranged["tested"]["worst_fill_s"] <= ranged["proof"]["longest_fill_s"] <= ranged["within_s"]
    runs_stay_within(ranged, generous(), "reserve", {}, 60, 11)


@pytest.mark.full
def test_a_proof_for_ranges_verifies_and_cannot_be_widened(ranged):
    assert verify(json.loads(json.dumps(ranged))) == ranged
    for path, value in (("volume_m3", [0.1, 0.25]), ("start_spread_bar", 60.0), ("within_s", 200)):
        changed = copy.deepcopy(ranged)
        changed["asked"][path] = value
        with pytest.raises(RefusedError):
            verify(changed)


def test_what_the_widest_vehicle_is_too_late_for_is_not_certified():
    document = certify("reserve", generous(), Asked(volume=(0.13, 0.2), start_spread=40.0, within=410, spacing=900))
    assert document["verdict"] != CERTIFIED
    assert document["counterexample"]["kind"] == "late"
    assert document["counterexample"]["fill_s"] > 410


def test_times_of_ranges_follow_from_what_the_widest_vehicle_takes():
    station = load_station("thesis-fit")
    seen = observe_scenarios(station, "reserve", {})
    usual = claim_of(station, seen, Asked())
    assert (usual.spacing, usual.within) == (seen.spacing, seen.within)
    wide = claim_of(station, seen, Asked(volume=(0.1, 0.25), start_spread=40.0))
    more = 0.25 * (698.6593333 - 97.3270750) / (0.1413450 * (698.6593333 - 137.3270750))
    assert wide.spacing == int(more * seen.spacing)
    assert wide.within == int(more * seen.within)
    asked = claim_of(station, seen, Asked(spacing=900, within=600))
    assert (asked.spacing, asked.within) == (900, 600)


@pytest.mark.slow
def test_the_bound_on_gas_holds_for_every_vehicle_of_a_run(ranged):
    vehicles = vehicles_of(generous(), (0.13, 0.15), 40.0)
    gas = Claim(vehicles, 809, 618).gas(generous())
    assert gas["vehicle_kg"] < gas["hour_kg"] == pytest.approx(5 * gas["vehicle_kg"])
    # From 97 bar to 699 bar at no less than 25 degC, by the ideal gas law.
    least = 0.15 * (698.66e5 / 298.15 - 97.327e5 / 298.15) * 2.016e-3 / 8.3145
    assert least <= gas["vehicle_kg"] <= least + 0.07


@pytest.mark.parametrize(
    ("asked", "field"),
    [
        (Asked(volume=(0.2, 0.25)), "volume"),
        (Asked(volume=(0.25, 0.1)), "volume"),
        (Asked(volume=(1e-6, 0.2)), "volume"),
        (Asked(volume=(0.1, float("inf"))), "volume"),
        (Asked(volume=(0.1, 900.0)), "spacing"),
        (Asked(start_spread=-1.0), "start_spread"),
        (Asked(start_spread=600.0), "start_spread"),
        (Asked(spacing=0), "spacing"),
        (Asked(within=10_000), "within"),
    ],
)
def test_ranges_that_cannot_be_are_named(asked, field):
    with pytest.raises(InputError, match=field):
        certify("reserve", load_station("thesis-fit"), asked)


@pytest.mark.slow
def test_runs_inside_a_claim_are_in_time_and_runs_outside_are_found(ranged):
    inside = run(ranged, 400)
    assert inside["late"] == 0
    assert inside["vehicles"] > 500
    assert inside["longest_fill_s"] <= ranged["proof"]["longest_fill_s"]
    assert run({**ranged, "within_s": int(inside["longest_fill_s"]) - 10}, 400)["late"] > 0


@pytest.mark.full
def test_no_vehicle_of_many_runs_inside_a_claim_is_late(ranged):
    assert run(ranged, 100_000, seed=1)["late"] == 0
