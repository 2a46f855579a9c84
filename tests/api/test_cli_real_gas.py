"""`hrs fill` and `hrs validate`, as a user types them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from api.cli.main import app
from station import InputError, StationError
from tests.station.real_gas.referee import FOLDER, measured
from tests.station.real_gas.test_cases import FILL, changed
from tests.warm import run_hrs as hrs


def asked(*arguments: object):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.mark.slow
def test_a_fill_is_printed_written_and_drawn(tmp_path):
    options = ("--tank", "type4-122", "--from", 50, "--ambient", 30, "--json", "f.json", "--plot", "f.png")
    done = hrs("fill", *options, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "ended by state of charge: 95.0 %" in done.stdout
    assert "the worst tank" in done.stdout
    assert (tmp_path / "f.png").read_bytes().startswith(b"\x89PNG")
    found = json.loads((tmp_path / "f.json").read_text())
    assert found["ended_by"] == "state_of_charge"
    assert found["worst_tank"]["binds"] is True
    assert found["nozzle_limited_s"] == 0
    assert 84.5 < found["worst_tank"]["peak_gas_temperature_c"] < 85
    assert found["end"]["state_of_charge_percent"] == pytest.approx(95)
    assert found["peak_gas_temperature_c"] == max(found["series"]["gas_temperature_c"]) < 85
    assert {len(values) for values in found["series"].values()} == {round(found["duration_s"]) + 1}
    assert found["delivered_kg"] == pytest.approx(sum(found["series"]["flow_g_per_s"]) / 1e3)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--ramp", "20"), "MPa/min, gas at most"),
        (("--ramp", "20", "--no-communication"), "the coldest tank would be full (no communication)"),
        (("--ramp", "60", "--delivery", "20", "--ambient", "40"), "ended by temperature: the gas would pass 85 degC"),
        (("--ramp", "20", "--target", "100", "--nwp", "350"), "type4-122 at 350 bar, from 50 bar"),
        (("--flow-max", "10", "--soak", "10", "--cooldown", "30"), "ended by state of charge"),
        (("--flow-max", "10"), "the nozzle's limit of 10 g/s held it back for"),
    ],
)
def test_options_of_a_fill(options, words):
    done = asked("fill", "--tank", "type4-122", "--from", "50", *options)
    assert done.exit_code == 0, done.exception
    assert words in done.output


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--tank", "can-5"), "tank: must be one of type1-<litres> (steel vessel)"),
        (("--tank", "type4-5"), "type4 must have 20 to 500 litres; given 5"),
        (("--from", "0"), "--from: must lie between 1 and 875 bar; given 0"),
        (("--from", "nan"), "--from: must lie between 1 and 875 bar; given nan"),
        (("--from", "800"), "--from: must leave the tank below --target 95 %"),
        (("--ambient", "300"), "--ambient: must lie between -40 and 60 degC; given 300"),
        (("--ramp", "fast"), "--ramp: must be auto or a number of MPa/min; given 'fast'"),
        (("--ramp", "0.1"), "--ramp: must lie between 0.5 and 60 MPa/min; given 0.1"),
        (("--plot", "fill.doc"), "must end in .png"),
        (("--json", "nowhere/fill.json"), "must be a file in a folder that exists"),
        (("--delivery", "60", "--ambient", "60"), "no ramp from 0.5 MPa/min on keeps a type4 tank"),
    ],
)
def test_a_wrong_option_is_one_clear_error(options, message):
    done = asked("fill", "--tank", "type4-122", "--from", "50", *options)
    assert isinstance(done.exception, StationError)
    assert message in str(done.exception)


@measured
def test_measured_cases_are_compared_written_and_drawn(tmp_path):
    cases = [
        Path(FOLDER) / f"{name}.json" for name in ("byrnes-7", "demiguel-type4", "woodfield-fill", "proust-orifice-3mm")
    ]
    done = hrs("validate", *cases, "--json", "v.json", "--plot", "plots", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    for words in (
        "byrnes-7: the area of the orifice was not published: 4.2", "demiguel-type4: compared up to 480 s",
        "woodfield-fill: compared with the mean of low and high", "proust-orifice-3mm: no tank; its flows imply",
    ):  # fmt: skip
        assert words in done.stdout
    document = json.loads((tmp_path / "v.json").read_text())
    assert list(document) == ["cases"]
    keys = ["case", "gas_rms_K", "gas_max_K", "pressure_rms_bar", "pressure_max_bar"]
    assert [list(row) for row in document["cases"]] == [keys] * 4
    first, second, _, last = document["cases"]
    assert 0 < first["pressure_rms_bar"] < 3.5
    assert second["pressure_rms_bar"] is None
    assert [last[key] for key in keys[1:]] == [None] * 4
    drawn = sorted(path.name for path in (tmp_path / "plots").iterdir())
    assert drawn == ["byrnes-7.png", "demiguel-type4.png", "woodfield-fill.png"]


def test_a_case_of_ones_own(tmp_path):
    (tmp_path / "mine.json").write_text(json.dumps(FILL))
    done = asked("validate", tmp_path / "mine.json", "--json", tmp_path / "v.json")
    assert done.exit_code == 0, done.exception
    assert json.loads((tmp_path / "v.json").read_text())["cases"][0]["case"] == FILL["case"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            json.dumps(changed(mass_flow_kg_s=1.0)),
            "given mass_flow_kg_s, pressure_ramp_MPa_per_min",
        ),
        (json.dumps({**FILL, "initial": {"pressure_MPa": 500, "temperature_K": 290.0}}), "initial.pressure_MPa: Input"),
        ("{", "cannot be parsed"),
        ("[]", "must be a table of fields"),
        ('{"case": "\\ud800"}', "half a character"),
    ],
)
def test_a_file_that_is_no_case_is_one_clear_error(text, message, tmp_path):
    (tmp_path / "mine.json").write_text(text)
    done = asked("validate", tmp_path / "mine.json", "--json", tmp_path / "v.json", "--plot", tmp_path / "plots")
    assert isinstance(done.exception, InputError)
    assert message in str(done.exception)
    assert str(tmp_path / "mine.json") in str(done.exception)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.json"]


def test_pictures_need_a_folder(tmp_path):
    (tmp_path / "mine.json").write_text(json.dumps(FILL))
    for place in (tmp_path / "mine.json", tmp_path / "no" / "folder"):
        done = asked("validate", tmp_path / "mine.json", "--plot", place)
        assert isinstance(done.exception, InputError)
        assert "must be a folder" in str(done.exception)
