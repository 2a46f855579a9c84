"""Certificates of service: what is proved holds in runs, what is false is shown, what is changed is refused."""

from __future__ import annotations

import copy
import json

import numpy as np
import pytest

from controllers import create
from controllers.certified.claim import Claim
from controllers.certified.falsify import Falsifier
from controllers.certified.proof import States
from controllers.certified.service import (
    CERTIFIED,
    NOT_CERTIFIED,
    TESTED,
    RefusedError,
    certify,
    check_belongs,
    controller_of,
    verify,
)
from controllers.certified.vehicles import Vehicles
from controllers.reserve.recovery import fullest, kelvin_of
from station import load_station, parse_scenario, simulate
from station.geometry import KELVIN, MEDIUM
from station.plants.interface import P
from station.plants.thesis import begin, rest
from tests.generous import generous


@pytest.fixture(scope="module")
def disproved():
    return certify("minlp2:liveness=false", load_station("thesis-fit-a"))


def _changed(document, path, value):
    found = copy.deepcopy(document)
    *above, last = path
    place = found
    for key in above:
        place = place[key]
    assert place[last] != value
    place[last] = value
    return found


def test_a_proof_covers_the_states_seen_and_keeps_its_word(proved):
    assert proved["verdict"] == CERTIFIED
    seen, box, proof = proved["seen"], proved["box"], proved["proof"]
    assert proved["within_s"] <= 1.5 * seen["worst_fill_s"]
    assert proved["spacing_s"] <= 2 * seen["mean_fill_s"]
    for place, buffer in enumerate(("high", "medium", "low")):
        assert box["pressure_low_bar"][place] <= 0.95 * seen["low"][f"pressure_{buffer}"] * (1 + 1e-12)
        assert box["pressure_high_bar"][place] >= min(1.05 * seen["high"][f"pressure_{buffer}"], 957.4)
        assert box["temperature_low_c"][place] <= seen["low"][f"temperature_{buffer}"]
        assert box["temperature_high_c"][place] >= seen["high"][f"temperature_{buffer}"]
    assert proof["complete"]
    assert proof["longest_fill_s"] <= proved["within_s"] < proved["spacing_s"]
    assert proved["tested"]["worst_fill_s"] <= proof["longest_fill_s"]


def runs_stay_within(document, station, name, options, runs, seed):
    """Two vehicles s or more apart from random states of a proof: fill times, and the buffers when the second comes."""
    random = np.random.default_rng(seed)
    states, proof = States.of_document(document["proof"]["states"]), document["proof"]
    vehicles = Vehicles(*(tuple(document["vehicles"][name]) for name in ("start_pressure_bar", "volume_m3")), 0.0, 0.0)
    bench = Falsifier(station, name, options, Claim(vehicles, document["spacing_s"], document["within_s"]))
    plant = station.constants()
    for _ in range(runs):
        state = np.empty(6)
        for buffer in range(3):
            known = document["proof"]["states"][("high", "medium", "low")[buffer]]
            temperature, floor = known["floor"][random.integers(len(known["floor"]))]
            warmth = min(temperature + random.random(), plant.limits.buffer_temperature_max)
            shrunk = min(1.0, (warmth + KELVIN) / (plant.ambient_temperature + KELVIN))
            top = min(known["top_bar"] * shrunk, plant.compressor_pressure - 1e-6)
            state[buffer], state[3 + buffer] = floor + (top - floor) * random.random() ** 2, warmth
        gap = float(np.ceil(document["spacing_s"] * random.choice([1.0, random.uniform(1, 4)])))
        first, second = (vehicles.drawn(random.random(2)) for _ in range(2))
        scenario = parse_scenario(bench.scenario(state, ((0.0, first), (gap, second))))
        record = simulate(scenario, create(name, **options))
        fills = record.vehicles["finished"] - record.vehicles["connected"]
        assert fills.max() <= proof["longest_fill_s"]
        opened = np.flatnonzero(record["outlet_medium"])
        if len(opened) and record["time"][opened[0]] < gap:  # low has handed the first vehicle on
            time, density = record["time"][opened[0]], record["mass_vehicle"][opened[0]] / first.volume
            least, most = next(row[1:] for row in proof["low_hands_on"] if row[0] == time)
            assert least <= density <= most
        row = np.searchsorted(record["time"], record.vehicles["connected"][1])
        for buffer, label in enumerate(("high", "medium", "low")):
            pressure, temperature = record[f"pressure_{label}"][row], record[f"temperature_{label}"][row]
            assert pressure >= states.floors[buffer, kelvin_of(temperature)]
            assert pressure <= states.tops[buffer]


def test_runs_from_the_states_of_a_proof_stay_within_its_figures(proved):
    runs_stay_within(proved, generous(), "reserve", {}, 40, 4)


def test_a_closed_buffer_stays_below_what_bounds_it():
    """However cold it is handed on, and whether or not it is warmer than the surroundings."""
    random, plant = np.random.default_rng(1), load_station("thesis-fit").constants()
    for _ in range(50):
        pressure, temperature = random.uniform(300.0, 900.0), random.uniform(-50.0, 63.0)
        ends = np.tile(np.array([np.inf, -np.inf, np.inf, -np.inf]), (3, 2, 1))
        ends[1, 0] = pressure, pressure, temperature, temperature
        state, most = np.zeros(12), 0.0
        begin(state, MEDIUM, pressure, temperature, plant.buffer_volume[MEDIUM], 0.0, plant)
        until = int(random.integers(0, 2000))  # the end is that of second 1
        for _ in range(max(until, 1)):
            most = max(most, state[P + MEDIUM])
            rest(state, 1.0, plant)
        assert most <= fullest(ends, float(until), plant) <= most * 1.0001


@pytest.mark.parametrize(
    "preset",
    [pytest.param("thesis-fit", marks=pytest.mark.slow), pytest.param("thesis-fit-a", marks=pytest.mark.full)],
)
def test_reserve_is_certified_at_a_preset(preset):
    station = load_station(preset)
    document = certify("reserve", station)
    assert document["verdict"] == CERTIFIED
    assert document["proof"]["longest_fill_s"] <= document["within_s"] <= 1.5 * document["seen"]["worst_fill_s"]
    assert document["spacing_s"] <= 2 * document["seen"]["mean_fill_s"]
    runs_stay_within(document, station, "reserve", {}, 60, 7)
    assert verify(json.loads(json.dumps(document))) == document


@pytest.mark.slow
def test_a_proof_verifies_and_belongs_to_its_station_alone(proved):
    assert verify(json.loads(json.dumps(proved))) == proved
    check_belongs(proved, "reserve", generous())
    with pytest.raises(RefusedError, match="station"):
        check_belongs(proved, "reserve", load_station("thesis-fit"))
    with pytest.raises(RefusedError, match="controller"):
        check_belongs(proved, "reserve:gap_bar=120", generous())
    with pytest.raises(RefusedError, match="controller"):
        check_belongs(proved, "logic", generous())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("within_s",), 100),
        (("spacing_s",), 10),
        (("box", "pressure_low_bar", 0), 500.0),
        (("box", "temperature_low_c", 1), 24.9),
        (("proof", "longest_fill_s"), 1),
        (("proof", "cells"), 1),
        (("proof", "cell_bar"), 0.0),
        (("proof", "states", "high", "top_bar"), 700.0),
        (("proof", "states", "low", "floor", 3, 1), 850.0),
        (("proof", "low_hands_on", 0, 1), 1.0),
        (("controller", "options"), {"gap_bar": 180.0}),
        (("station", "parameters", "vehicle", "volume_m3"), 0.2),
        (("station", "sha256"), "0" * 64),
        (("limits", "bounds", 0, "margin"), "0"),
        pytest.param(("asked", "volume_m3"), [0.1, 0.25], marks=pytest.mark.slow),
        (("asked", "within_s"), 7300),
        (("vehicles", "volume_m3", 0), 0.1),
        (("gas_at_most", "hour_kg"), 1.0),
        (("proof", "cell_volume"), 1.0),
        (("claim",), "everything is fine"),
        (("sha256",), "0" * 64),
        (("version",), 2),
    ],
)
def test_a_changed_proof_is_refused(proved, path, value):
    with pytest.raises(RefusedError):
        verify(_changed(proved, path, value))


@pytest.mark.slow
def test_states_must_hold_the_box(proved):
    floor = proved["proof"]["states"]["medium"]["floor"]
    with pytest.raises(RefusedError):
        verify(_changed(proved, ("proof", "states", "medium", "floor"), floor[1:]))


@pytest.mark.parametrize("name", ["minlp2", "minlp3"])
@pytest.mark.parametrize("preset", ["thesis-fit-a", "thesis-fit-cascade", "light-duty-700"])
def test_minlp_without_liveness_starves_and_a_run_shows_it(preset, name):
    document = certify(f"{name}:liveness=false:liveness_s=0", load_station(preset))
    assert document["verdict"] == NOT_CERTIFIED
    found = document["counterexample"]
    assert found["kind"] == "starves"
    record = simulate(parse_scenario(found["scenario"]), create(name, liveness=False, liveness_s=0))
    assert np.isnan(record.vehicles["finished"]).any()
    outlets = sum(record[f"outlet_{buffer}"] for buffer in ("high", "medium", "low"))
    assert outlets[-3600:].sum() == 0
    for options in ({"liveness": True}, {"liveness": False, "liveness_s": 600}):
        alive = simulate(parse_scenario(found["scenario"]), create(name, **options))
        assert np.isfinite(alive.vehicles["finished"]).all()


@pytest.mark.slow
def test_a_counterexample_verifies_and_cannot_be_made_a_proof(disproved):
    assert verify(disproved) == disproved
    assert controller_of(disproved) == "minlp2:liveness=false"
    for path, value in [
        (("verdict",), CERTIFIED),
        (("counterexample", "state", 0), 900.0),
        (("counterexample",), None),
        (("controller", "options", "liveness"), True),
    ]:
        with pytest.raises(RefusedError):
            verify(_changed(disproved, path, value))


@pytest.mark.slow
def test_what_is_only_tested_says_so():
    document = certify("logic", load_station("thesis-fit"))
    assert document["verdict"] == TESTED
    assert document["proof"] is None
    assert document["claim"].startswith("not proved, only tested")
    assert document["tested"]["worst_fill_s"] <= document["within_s"]
    assert document["tested"]["simulations"] > 400
    with pytest.raises(RefusedError, match="verdict"):
        check_belongs(document, "logic", load_station("thesis-fit"))
