"""`hrs identify`, as a user types it."""

from __future__ import annotations

import json

import numpy as np
import pytest
from pyarrow import parquet
from typer.testing import CliRunner

from api.cli.main import app
from api.identification import day_at, figures, identify_followed, identify_station
from controllers import create_from
from station import InputError, simulate
from station.estimation.interface import Followed
from station.estimation.prediction import day_of, prediction_errors
from station.frames import frames_of_seconds
from station.measured_day import measured_day, tags_of_day
from station.preset_files import load_station, presets
from station.sensor_names import SENSORS
from station.station_files import load_station_file

BUFFERS, VEHICLE = (2.5, 7.0, 12.0), (8.0, 12.0, 18.0)
"""No prediction may be further off, RMS [bar], after 1, 5, 15 minutes and after 60, 120, 180 s."""


def asked(*arguments: object):
    return CliRunner().invoke(app, ["identify", *map(str, arguments)])


@pytest.mark.slow
def test_a_model_is_fitted_judged_and_written(tmp_path):
    done = asked("h70-light", "--json", tmp_path / "f.json", "--out", tmp_path / "f.toml")
    assert done.exit_code == 0, done.exception
    assert "real-gas" in done.stdout
    found = json.loads((tmp_path / "f.json").read_text())
    last = found["models"][-1]
    assert all(error < bar for error, bar in zip(last["rms_bar"]["buffers"], BUFFERS, strict=True))
    assert all(error < bar for error, bar in zip(last["rms_bar"]["vehicle"], VEHICLE, strict=True))
    thesis = next(model for model in found["models"] if model["form"] == "thesis")
    assert thesis["rms_bar"]["vehicle"][2] > VEHICLE[2]
    station = load_station_file(str(tmp_path / "f.toml"))
    assert station.control_model.covolume_l_per_kg == pytest.approx(last["figures"]["covolume_l_per_kg"], rel=1e-4)
    assert station.control_model.buffer_errors_bar == pytest.approx(last["rms_bar"]["buffers"], rel=1e-2)


@pytest.mark.slow
def test_a_model_is_written_into_a_station_of_the_users_own(tmp_path):
    mine = tmp_path / "mine.toml"
    mine.write_text('preset = "h70-light"\nname = "mine"\n[thermal]\nambient_temperature_c = 30.0\n')
    done = asked(mine, "--days", 1, "--out", tmp_path / "fitted.toml")
    assert done.exit_code == 0, done.exception
    known, fitted = load_station_file(str(mine)), load_station_file(str(tmp_path / "fitted.toml"))
    assert fitted.control_model != known.control_model
    assert fitted.model_copy(update={"control_model": known.control_model}) == known


def test_the_thesis_plant_gives_its_own_figures(tmp_path):
    done = asked("light-duty-700", "--days", 1, "--seed", 3, "--json", tmp_path / "f.json")
    assert done.exit_code == 0, done.exception
    found = json.loads((tmp_path / "f.json").read_text())
    assert [model["form"] for model in found["models"]] == ["as it is", "thesis"]
    known, fitted = (model["figures"] for model in found["models"])
    for name in ("inlet_coefficient_g_per_s_bar", "outlet_coefficient_g_per_s_bar", "vehicle_heating_k_per_s"):
        assert fitted[name] == pytest.approx(known[name], rel=1e-5)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("thesis-fit", "--out", "f.toml"), "keeps the thesis's form"),
        (("nowhere",), "no preset is called 'nowhere'"),
        (("h70-light", "--out", "f.csv"), "must end in .toml"),
        (("h70-light", "--record", "day.csv"), "--tags: must be given"),
        (("h70-light", "--tags", "tags.toml"), "--record: must be given"),
        (
            ("h70-light", "--record", "day.csv", "--tags", "t.toml", "--days", 1),
            "--days: must be left out with --record",
        ),
        (("h70-light", "--record", "day.csv", "--tags", "t.toml"), "t.toml"),
    ],
)
def test_what_cannot_be_is_refused(arguments, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = asked(*arguments)
    assert isinstance(done.exception, InputError)
    assert words in str(done.exception)
    assert not list(tmp_path.iterdir())


REAL = [name for name in presets() if load_station(name).real_gas is not None]


@pytest.mark.parametrize("name", REAL)
def test_presets_ship_with_a_model_within_the_bars(name):
    given = load_station(name).control_model
    assert all(error < bar for error, bar in zip(given.buffer_errors_bar, BUFFERS, strict=True))
    assert all(error < bar for error, bar in zip(given.vehicle_errors_bar, VEHICLE, strict=True))


@pytest.mark.slow
@pytest.mark.parametrize("name", REAL)
@pytest.mark.parametrize("controller", ["logic", "minlp1", "minlp2", "reserve", "switched"])
def test_what_ships_predicts_a_day_of_any_controller(name, controller):
    station = load_station(name)
    day = day_of(simulate(day_at(station), create_from(controller), replication=1, seed=23))
    found = prediction_errors([day], station.control_constants())
    assert all(error < bar for error, bar in zip(found.buffers, BUFFERS, strict=True)), found
    assert all(error < bar for error, bar in zip(found.vehicle, VEHICLE, strict=True)), found


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """A measured day of mixed tanks at h70-light, and its tags."""
    place = tmp_path_factory.mktemp("measured")
    scenario = day_at(load_station("h70-light")).model_copy(update={"name": "measured"})
    record = simulate(scenario, create_from("reserve"), replication=1, seed=5)
    parquet.write_table(measured_day(record, seed=3), place / "day.parquet")
    (place / "tags.toml").write_text(
        "".join(f'[[tags]]\ntag = "{t.tag}"\ncolumn = "{t.column}"\nsensor = "{t.sensor}"\nsource = "{t.source}"\n'
                for t in tags_of_day().tags)
    )  # fmt: skip
    return place


@pytest.mark.slow
def test_a_model_is_fitted_to_a_measured_record(measured, tmp_path):
    given = ("--record", measured / "day.parquet", "--tags", measured / "tags.toml", "--json", tmp_path / "f.json")
    done = asked("h70-light", *given, "--out", tmp_path / "mine.toml")
    assert done.exit_code == 0, done.exception
    found = json.loads((tmp_path / "f.json").read_text())
    assert found["record"] == "day.parquet"
    assert "seed" not in found
    last = found["models"][-1]["rms_bar"]
    assert all(error < bar for error, bar in zip(last["buffers"], BUFFERS, strict=True))
    assert all(error < bar for error, bar in zip(last["vehicle"], VEHICLE, strict=True))
    fitted = load_station_file(str(tmp_path / "mine.toml"))
    day = day_of(simulate(day_at(fitted), create_from("reserve"), replication=2, seed=5))
    assert prediction_errors([day], fitted.control_constants()).buffers[1] < BUFFERS[1]


@pytest.mark.slow
def test_a_record_that_the_station_does_not_fit_gives_no_model(measured, tmp_path):
    station = tmp_path / "mine.toml"
    station.write_text('preset = "h70-light"\n[buffers.medium]\nvolume_m3 = 0.35\n')
    given = ("--record", measured / "day.parquet", "--tags", measured / "tags.toml", "--out", tmp_path / "f.toml")
    done = asked(station, *given)
    assert done.exit_code == 3
    assert "model refused" in done.stderr
    assert not (tmp_path / "f.toml").exists()


def test_a_record_that_lacks_a_sensor_is_refused_by_name():
    frames = frames_of_seconds(0.0, np.zeros((10, len(SENSORS))), tags_of_day().tags)
    frames["outlet_low"][:] = np.nan
    frames["vehicle"][:] = np.nan
    with pytest.raises(InputError, match="must measure outlet_low, vehicle"):
        identify_followed(load_station("thesis-fit"), frames, Followed.empty(10, 14, 6.0))


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow if name == "h70-light" else pytest.mark.full) for name in REAL]
)
def test_a_fit_anew_gives_what_ships(name):
    station = load_station(name)
    found = identify_station(station, days=2, seed=0)[-1]
    assert found.errors.buffers == pytest.approx(station.control_model.buffer_errors_bar, rel=0.02)
    assert found.errors.vehicle == pytest.approx(station.control_model.vehicle_errors_bar, rel=0.02)
    shipped = figures(station.control_constants())
    for field in ("covolume_l_per_kg", "delivered_k"):
        assert figures(found.model)[field] == pytest.approx(shipped[field], rel=0.02)
