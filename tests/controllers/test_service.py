"""Certificates of service: what is proved holds in runs, what is false is shown, what is changed is refused."""

from __future__ import annotations

import copy
import json

import numpy as np
import pytest

from controllers import create
from controllers.certified.box import look
from controllers.certified.cells import Box, covers, task_of
from controllers.certified.falsify import Bench
from controllers.certified.fill import CELL, FILL, OUTCOME, OUTCOMES, RESULT, SERVED, prove_all
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
from controllers.reserve import Reserve
from station import load_station, parse_scenario, simulate
from station.parameters import Station

GENEROUS = {"volume": 3.0, "inlet_heating": 0.03, "outlet_cooling": 0.01, "vehicle_heating": 0.12, "compressor": 2.0}


def generous() -> Station:
    """thesis-fit with more storage, cooled inlets and twice the compressor: its service takes few cells to prove."""
    given = load_station("thesis-fit").model_dump()
    given["name"] = "generous"
    for buffer in given["buffers"].values():
        buffer["volume_m3"] *= GENEROUS["volume"]
        buffer["inlet_heating_k_per_s"] = GENEROUS["inlet_heating"]
        buffer["outlet_cooling_k_per_s"] = GENEROUS["outlet_cooling"]
    given["vehicle"]["heating_k_per_s"] = GENEROUS["vehicle_heating"]
    given["compressor"]["inlet_coefficient_g_per_s_bar"] *= GENEROUS["compressor"]
    return Station.model_validate(given)


@pytest.fixture(scope="module")
def proved():
    return certify("reserve", generous())


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


def test_runs_from_the_cells_of_a_proof_stay_within_its_figures(proved):
    """Two vehicles s apart, from random states of the cells and any second of the turns."""
    station, random = generous(), np.random.default_rng(4)
    bench = Bench(station, "reserve", {}, proved["within_s"])
    cells, fills = np.array(proved["proof"]["cells"]), proved["proof"]["fills_s"]
    for row in random.choice(len(cells), 40):
        ends = cells[row].reshape(3, 4)
        share = random.random((3, 2))
        pressure = ends[:, 0] + share[:, 0] * (ends[:, 1] - ends[:, 0])
        temperature = ends[:, 2] + share[:, 1] * (ends[:, 3] - ends[:, 2])
        state = np.concatenate((np.minimum(pressure, station.compressor.pressure_bar - 1e-6), temperature))
        begins = float(random.integers(60))
        times = bench.fills(state, (begins, begins + proved["spacing_s"]))
        if begins == 0:
            assert times[0] <= fills[row]
        assert times.max() <= proved["proof"]["longest_fill_s"]


@pytest.mark.parametrize("preset", ["thesis-fit", "thesis-fit-a", "thesis-fit-cascade"])
def test_enclosures_of_small_cells_hold_in_runs(preset):
    """Whatever an enclosure calls served is served in time, whether or not the whole box is proved."""
    station, random = load_station(preset), np.random.default_rng(7)
    seen = look(station, "reserve", {})
    task = task_of(Reserve(), station, seen, seen.low[:3])
    bench = Bench(station, "reserve", {}, seen.within)
    served = 0
    for _ in range(30):
        at = np.array(seen.low) + random.random(6) * (np.array(seen.high) - np.array(seen.low))
        cell = np.array([(at[b] - 1, at[b] + 1, at[3 + b] - 0.2, at[3 + b] + 0.2) for b in range(3)]).reshape(1, CELL)
        result = np.empty((1, RESULT))
        prove_all(cell, task, station.constants(), result)
        if result[0, OUTCOME] == SERVED:
            served += 1
            ends = cell.reshape(3, 4)
            for corner in (0, 1):
                state = np.concatenate((ends[:, corner], ends[:, 2 + corner]))
                state[3:] = np.minimum(state[3:], station.thermal.buffer_temperature_max_c)
                state[:3] = np.minimum(state[:3], station.compressor.pressure_bar - 1e-6)
                assert bench.fills(state)[0] <= result[0, FILL]
    assert served > 0, OUTCOMES[int(result[0, OUTCOME])]


def test_a_proof_verifies_and_belongs_to_its_station_alone(proved):
    assert verify(json.loads(json.dumps(proved))) == proved
    check_belongs(proved, "reserve", generous())
    with pytest.raises(RefusedError, match="station"):
        check_belongs(proved, "reserve", load_station("thesis-fit"))
    with pytest.raises(RefusedError, match="controller"):
        check_belongs(proved, "reserve:gap_bar=120", generous())
    with pytest.raises(RefusedError, match="controller"):
        check_belongs(proved, "logic", generous())


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("within_s",), 100),
        (("spacing_s",), 10),
        (("box", "pressure_low_bar", 0), 500.0),
        (("box", "temperature_low_c", 1), 24.9),
        (("proof", "fills_s", 0), 1),
        (("proof", "closest_gap_bar"), 250.0),
        (("proof", "cells"), []),
        (("controller", "options"), {"gap_bar": 180.0}),
        (("station", "parameters", "vehicle", "volume_m3"), 0.2),
        (("station", "sha256"), "0" * 64),
        (("limits", "bounds", 0, "margin"), "0"),
        (("claim",), "everything is fine"),
        (("sha256",), "0" * 64),
        (("version",), 2),
    ],
)
def test_a_changed_proof_is_refused(proved, path, value):
    with pytest.raises(RefusedError):
        verify(_changed(proved, path, value))


def test_cells_must_cover_the_box(proved):
    given = proved["box"]
    box = Box(*(tuple(given[f"{name}"]) for name in given))
    cells = np.array(proved["proof"]["cells"])
    assert covers(cells, box)
    assert not covers(cells[1:], box)
    assert not covers(np.concatenate((cells, cells[:1])), box)
    with pytest.raises(RefusedError):
        verify(_changed(proved, ("proof", "cells"), cells[1:].tolist()))


@pytest.mark.parametrize("controller", ["minlp2:liveness=false", "minlp3:liveness=false"])
@pytest.mark.parametrize("preset", ["thesis-fit-a", "thesis-fit-cascade", "light-duty-700"])
def test_minlp_without_liveness_starves_and_a_run_shows_it(preset, controller):
    document = certify(controller, load_station(preset))
    assert document["verdict"] == NOT_CERTIFIED
    found = document["counterexample"]
    assert found["kind"] == "starves"
    name, _, option = controller.partition(":")
    record = simulate(parse_scenario(found["scenario"]), create(name, liveness=json.loads(option.partition("=")[2])))
    assert np.isnan(record.vehicles["finished"]).any()
    outlets = sum(record[f"outlet_{buffer}"] for buffer in ("high", "medium", "low"))
    assert outlets[-3600:].sum() == 0
    alive = simulate(parse_scenario(found["scenario"]), create(name, liveness=True))
    assert np.isfinite(alive.vehicles["finished"]).all()


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


def test_what_is_only_tested_says_so():
    document = certify("logic", load_station("thesis-fit"))
    assert document["verdict"] == TESTED
    assert document["proof"] is None
    assert document["claim"].startswith("not proved, only tested")
    assert document["tested"]["worst_fill_s"] <= document["within_s"]
    assert document["tested"]["simulations"] > 400
    with pytest.raises(RefusedError, match="verdict"):
        check_belongs(document, "logic", load_station("thesis-fit"))
