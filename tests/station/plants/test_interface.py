"""The seam for plants: another plant is added by its functions and one entry, and is refused where it must be."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numba
import numpy as np
import pytest

from controllers.certified import Estimator
from controllers.certified.service import certify as certify_service
from station import InputError, Station, load_scenario, load_station, parse_scenario
from station.bounds import bounds
from station.errors import PlantError
from station.limit_figures import LimitFigures
from station.margins import certify
from station.plants import interface
from station.plants.thesis import THESIS, PlantConstants
from station.uncertainty import Uncertainty
from tests.station.plants.other import Other

ROOT = Path(__file__).parents[3]


def leaking(state, volume, command, period, plant):
    """A plant that loses gas while it is advanced, and counts what it lost in an entry of its own."""
    for buffer in range(3):
        lost = plant.leak * state[interface.M + buffer] * period
        state[interface.M + buffer] -= lost
        state[interface.OWN] += lost
    return interface.Spent(1.0 * command, volume)


@pytest.fixture
def other(monkeypatch):
    monkeypatch.setattr(interface, "_PLANTS", dict(interface._PLANTS))
    monkeypatch.setattr(interface, "_BY_CONSTANTS", dict(interface._BY_CONSTANTS))
    constants = Other(*THESIS.sample, 0.5)
    plant = replace(
        THESIS, name="other", constants=Other, sample=constants, own=1, advance=leaking,
        constants_of=lambda station, *, communication: Other(*station.constants(), 0.5),
    )  # fmt: skip
    interface.register(plant)
    return constants


@pytest.mark.slow
def test_a_kernel_is_compiled_for_the_plant_of_its_constants(other):
    @numba.njit
    def advanced(state, plant):
        return interface.advance(state, 0.0, 0, 1.0, plant)

    state = np.ones(interface.OWN + 1)
    assert tuple(advanced(state, other)) == tuple(interface.advance(state.copy(), 0.0, 0, 1.0, other)) == (0.0, 0.0)
    assert state[interface.M : interface.M + 3].tolist() == [0.5] * 3
    assert state[interface.OWN] == 2.5
    before = state.copy()
    advanced(state, THESIS.sample)
    assert state[interface.OWN] == before[interface.OWN]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"constants": NamedTuple("Few", [("limits", LimitFigures)])},
            "its constants lack compressor_pressure, outlet_coefficient",
        ),
        ({"advance": lambda state, plant: None}, "arguments of advance must be those of the interface"),
        ({}, "there is one of that name"),
        ({"name": "same"}, "or with those constants"),
    ],
)
def test_a_plant_that_does_not_fit_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        interface.register(replace(THESIS, **changes))


def test_the_plant_of_a_station_is_no_news_where_it_is_the_usual_one():
    station = Station.model_validate({**load_station("thesis-fit").model_dump(), "plant": "thesis"})
    assert station == load_station("thesis-fit")
    assert "plant" not in station.model_dump() | json.loads(station.model_dump_json())
    for mode in ("validation", "serialization"):
        schema = Station.model_json_schema(mode=mode)
        assert "plant" in schema["properties"]
        assert "plant" not in schema["required"]


def test_a_plant_that_nobody_registered_is_named():
    with pytest.raises(InputError, match="must be one of real-gas, thesis; given 'steam'"):
        parse_scenario({**load_scenario("S1").model_dump(), "station": {"preset": "thesis-fit", "plant": "steam"}})


def test_what_is_proved_for_the_thesis_alone_refuses_another(other):
    station = load_station("thesis-fit").model_copy(update={"plant": "other"})
    scenario = load_scenario("S1").on(station)
    assert scenario.station.plant == "other"
    assert json.loads(scenario.model_dump_json())["station"]["plant"] == "other"
    assert scenario.plant() == Other(*load_station("thesis-fit").constants(), 0.5)
    assert isinstance(station.constants(), PlantConstants)  # the model that controllers have
    for refused in (
        lambda: certify(station, Uncertainty()),
        lambda: bounds(scenario),
        lambda: Estimator(station),
        lambda: certify_service("reserve", station),
        lambda: certify_service("logic", station),
    ):
        with pytest.raises(PlantError, match="must be 'thesis', for which alone they are proved; given 'other'"):
            refused()
    with pytest.raises(InputError, match=r"(?s)margins.*given 'other'"):
        parse_scenario({**scenario.model_dump(), "disturbance": {}})


@pytest.mark.full
def test_another_plant_runs_whole(tmp_path):
    """In a process of its own with kernels of its own: they are compiled for every plant that is registered."""
    script = ROOT / "tests" / "station" / "plants" / "other.py"
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path), "PYTHONPATH": str(ROOT)}
    environment.pop("NUMBA_CACHE_DIR", None)
    done = subprocess.run(
        [sys.executable, script], cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["thesis"] == found["same"]  # another class, the same equations: the same bytes
    assert found["seconds"] == found["advanced"]  # its own entry of the state was kept
