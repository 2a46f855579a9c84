"""Certificates of service for bursts: fills that begin s apart are proved, arrivals are those of the claim."""

from __future__ import annotations

import copy
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.service_runs import run
from controllers import create
from controllers.certified.claim import BURST_MAX, Asked, Claim
from controllers.certified.reduction import reduced_claim
from controllers.certified.service import CERTIFIED, RefusedError, certify, verify
from controllers.certified.vehicles import vehicles_of
from controllers.slot import parse
from station import InputError, Station, load_station, parse_scenario, simulate
from tests.generous import generous

BURST = 3


@pytest.fixture(scope="module")
def bursting(once, proved):
    rule = f"reserve:space_s={proved['spacing_s']}:liveness_s=7200"
    return once("proved-bursts", lambda: certify(rule, generous(), Asked(burst=BURST)))


def test_bursts_are_certified_from_the_arrival_on(bursting, proved):
    assert bursting["verdict"] == CERTIFIED
    spacing, within = bursting["spacing_s"], bursting["within_s"]
    assert (spacing, within, bursting["box"]) == (proved["spacing_s"], proved["within_s"], proved["box"])
    assert bursting["promised_s"] == 2 * spacing + within + 1
    assert f"in bursts of up to 3, at least {spacing} s apart on the mean" in bursting["claim"]
    assert f"within {bursting['promised_s']} s of its arrival" in bursting["claim"]
    one, hour = bursting["gas_at_most"]["vehicle_kg"], bursting["gas_at_most"]["hour_kg"]
    assert hour == pytest.approx((BURST + 3600 // spacing) * one)
    assert within < bursting["tested"]["worst_fill_s"] <= bursting["promised_s"]


@pytest.mark.slow
def test_a_certificate_of_bursts_verifies_and_cannot_be_changed(bursting):
    assert verify(json.loads(json.dumps(bursting))) == bursting
    changed = copy.deepcopy(bursting)
    changed["asked"]["burst"] = 2
    with pytest.raises(RefusedError, match="burst"):
        verify(changed)
    with pytest.raises(RefusedError, match="promised_s"):
        verify({**bursting, "promised_s": bursting["promised_s"] - 1})


@pytest.mark.slow
def test_runs_inside_a_claim_of_bursts_are_in_time_and_larger_bursts_are_late(bursting):
    inside = run(bursting, 300)
    assert inside["late"] == 0
    assert bursting["within_s"] < inside["longest_fill_s"] <= bursting["promised_s"]
    larger = {**bursting, "burst": 6}
    assert run(larger, 50)["late"] == 0  # six of them are promised more
    promise = Claim(vehicles_of(generous(), None, None), bursting["spacing_s"], bursting["within_s"], 6).promised
    assert run(larger, 50)["longest_fill_s"] > bursting["promised_s"]
    assert promise == 5 * bursting["spacing_s"] + bursting["within_s"] + 1


def test_fills_begin_as_far_apart_as_the_rule_is_told():
    day = {
        "name": "three at once",
        "station": "thesis-fit",
        "arrivals": {"kind": "trace", "vehicles": [{"time_s": 10.5, "start_pressure_bar": 120.0}] * 3},
        "time_limit_s": 20_000,
    }
    record = simulate(parse_scenario(day), create("reserve", space_s=900, liveness_s=7200))
    given_gas = np.zeros(len(record["time"]), bool)
    for buffer in ("high", "medium", "low"):
        given_gas |= record[f"outlet_{buffer}"].astype(bool)
    vehicle = record["vehicle"]
    begun = [float(record["time"][np.flatnonzero(given_gas & (vehicle == number))[0]]) for number in range(3)]
    assert np.diff(begun).tolist() == [900.0, 900.0]


@pytest.mark.parametrize(
    ("controller", "burst", "why"),
    [
        ("reserve", 3, "bursts need fills that begin s apart; try reserve:space_s=800"),
        ("reserve:space_s=700", 2, "try reserve:space_s=800, given 700"),
        ("reserve:space_s=900", 1, "fills begin 900 s apart, and vehicles may come each 800 s"),
        ("guarded", 2, "bursts are proved of the reserve rule alone"),
    ],
)
def test_what_no_proof_covers_is_named(controller, burst, why):
    name, options = parse(controller)
    actor, station = create(name, **options), load_station("thesis-fit")
    actor.start(station)
    assert why in reduced_claim(actor, station, Claim(vehicles_of(station, None, None), 800, 700, burst)).flaw


@pytest.mark.slow
def test_a_wait_that_the_slot_does_not_bear_is_not_certified(proved):
    document = certify(f"reserve:space_s={proved['spacing_s']}:liveness_s=900", generous(), Asked(burst=BURST))
    assert document["verdict"] != CERTIFIED
    assert "logic stands in after 900 s" in document["proof"]["open"]


@pytest.mark.slow
def test_a_wait_after_which_a_fill_ends_incomplete_is_not_certified(proved):
    given = generous().model_dump()
    given["slot"]["incomplete_s"] = 830.0
    rule = f"reserve:space_s={proved['spacing_s']}:liveness_s=7200"
    document = certify(rule, Station.model_validate(given), Asked(burst=BURST))
    assert document["verdict"] != CERTIFIED
    assert "a fill ends incomplete after 830 s" in document["proof"]["open"]


@pytest.mark.slow
def test_a_vehicle_that_changes_its_temperature_as_it_waits_is_not_covered(proved):
    given = generous().model_dump()
    given["vehicle"]["start_temperature_c"] = 20.0
    station = Station.model_validate(given)
    document = certify(f"reserve:space_s={proved['spacing_s']}:liveness_s=7200", station, Asked(burst=2))
    assert document["verdict"] != CERTIFIED
    assert "does not keep its temperature" in document["proof"]["open"]


@pytest.mark.parametrize("burst", [0, -1, BURST_MAX + 1])
def test_bursts_that_cannot_be_are_named(burst):
    with pytest.raises(InputError, match="burst"):
        certify("reserve", load_station("thesis-fit"), Asked(burst=burst))


@given(
    gaps=st.lists(st.floats(0, 5000), min_size=1, max_size=30),
    burst=st.integers(1, 5),
    spacing=st.integers(1, 2000),
)
def test_arrivals_keep_to_the_bound_of_the_claim(gaps, burst, spacing):
    claim = Claim(vehicles_of(load_station("thesis-fit"), None, None), spacing, 100, burst)
    times = claim.times(np.array(gaps))
    for first in range(len(times)):
        for last in range(first, len(times)):
            count = last - first + 1
            assert (count - burst) * spacing <= (times[last] - times[first]) * (1 + 1e-12) + 1e-6
    begun = [0.0]  # fills that begin s apart, and when the vehicle is there
    for time in times[1:]:
        begun.append(max(time, begun[-1] + spacing))
    assert (np.array(begun) - times).max() <= (burst - 1) * spacing + 1e-6


@pytest.mark.slow
def test_no_vehicle_of_many_bursts_inside_a_claim_is_late(bursting):
    assert run(bursting, 10_000, seed=1)["late"] == 0
