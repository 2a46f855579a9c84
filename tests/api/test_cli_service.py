"""Commands about scenarios of a service, settings in the environment, and files that are written."""

from __future__ import annotations

import csv
import json
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import httpx
import numpy as np
import pytest

from controllers import create
from station import load_scenario, simulate
from tests.api.here import hrs
from tests.api.test_checks import AVERAGE
from tests.api.test_stored_scenarios import DAY
from tests.pace import slowness

HRS = Path(sys.executable).with_name("hrs")
ISO_Z = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d(:\d\d)?Z")


@pytest.mark.slow
def test_a_scenario_is_stored_shown_submitted_and_forgotten(service, tmp_path):
    at = {"HRS_URL": service.url}
    (tmp_path / "mine.json").write_text(json.dumps({**DAY, "name": "another"}))
    done = hrs("scenarios", "put", "my-day", "mine.json", cwd=tmp_path, **at)
    assert (done.returncode, done.stdout) == (0, "my-day is stored: `hrs submit my-day`\n"), done.stderr
    listed = hrs("scenarios", "list", **at).stdout.splitlines()
    assert [line.split()[0] for line in listed] == ["S1", "S2", "S3", "S4", "my-day"]
    assert ISO_Z.search(listed[-1])
    assert hrs("scenarios", "get", "my-day", "--out", "got.json", cwd=tmp_path, **at).returncode == 0
    assert load_scenario(tmp_path / "got.json").about == DAY["about"]
    assert "another name" in hrs("scenarios", "put", "s1", "mine.json", cwd=tmp_path, **at).stderr
    assert hrs("scenarios", "put", "my-day", "S1", "--new", **at).returncode == 2
    submitted = hrs("submit", "my-day", "--wait", **at)
    assert submitted.returncode == 0, submitted.stderr
    assert re.search(r"vehicles +2\n", submitted.stdout)
    assert ISO_Z.search(hrs("jobs", **at).stdout)
    assert hrs("scenarios", "delete", "my-day", **at).returncode == 0
    gone = hrs("submit", "my-day", **at)
    assert gone.returncode == 2
    assert "no scenario is called 'my-day'" in gone.stderr


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("scenarios", "pt", "x", "y"), "Did you mean 'put'"),
        (("scenarios", "lst"), "did you mean `hrs scenarios list`"),
        (("simulte", "S1"), "Did you mean 'simulate'"),
        (("keys", "creat", "x"), "Did you mean 'create'"),
        (("simulate", "S1", "--contoller", "logic"), "--controller"),
        (("serve", "--prot", "1"), "--port"),
        (("bench", "--qick"), "--quick"),
    ],
)
def test_a_mistyped_command_or_option_is_told_its_neighbour(arguments, says, capfd):
    done = hrs(*arguments)
    assert done.returncode == 2
    assert says in done.stderr + capfd.readouterr().err


@pytest.mark.parametrize(
    ("variables", "says"),
    [
        ({"HRS_ZENOH_PLAINTEX": "1"}, "HRS_ZENOH_PLAINTEX: is no setting; the nearest is HRS_ZENOH_PLAINTEXT"),
        ({"HRS_TWIN_MAX": "1"}, "the nearest is HRS_TWINS_MAX"),
        ({"HRS_APIKEY": "1", "HRS_HOSTS": "x"}, "HRS_HOSTS: is no setting; the nearest is HRS_HOST"),
        ({"HRS_DATABASE": "mysql://u:secret@h/x"}, "database: must be postgresql://"),
        ({"HRS_DATABASE": "u:secret@h/x"}, "database: must be postgresql://"),
        ({"HRS_DATABASE": "postgresql://u:sec/ret@h/x"}, "database: must have a number as its port"),
        ({"HRS_DATABASE": "sqlite://"}, "database: must be postgresql://"),
    ],
)
def test_a_setting_that_is_none_is_named_before_anything_starts(tmp_path, variables, says):
    for command in (("serve", "--data", tmp_path / "d"), ("keys", "list", "--data", tmp_path / "d")):
        done = hrs(*command, **variables)
        assert done.returncode == 2
        assert done.stderr.startswith("error: ")
        assert says in done.stderr
        assert "sec" not in done.stderr.replace("second", "")
        assert not (tmp_path / "d").exists()


def test_variables_of_tests_and_the_real_settings_are_no_slips(tmp_path):
    variables = {"HRS_TEST_POSTGRES": "x", "HRS_BENCH_POSTGRES": "x", "HRS_MEASURED": "x", "hrs_log_format": "json"}
    assert hrs("keys", "list", "--data", tmp_path, **variables).returncode == 0


def test_a_run_is_written_as_its_ending_says(tmp_path):
    done = hrs("simulate", "S1", "--out", "run.csv", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    rows = list(csv.DictReader((tmp_path / "run.csv").read_text().splitlines()))
    record = simulate(load_scenario("S1"), create("logic"))
    for name in ("time", "pressure_high", "pressure_vehicle", "vehicle"):
        read = np.array([float(row[name]) if row[name] else np.nan for row in rows])
        np.testing.assert_array_equal(read, record[name])
    for wrong in ("run.txt", "run", "run.CSV"):
        done = hrs("simulate", "S1", "--out", wrong, cwd=tmp_path)
        assert (done.returncode, "must end in .parquet or .csv" in done.stderr) == (2, True)
        assert "t_total" not in done.stdout


def test_a_station_may_be_a_file_wherever_one_is_named(tmp_path):
    (tmp_path / "two.toml").write_text('preset = "thesis-fit"\nname = "two compressors"\ncompressor = {count = 2}\n')
    (tmp_path / "bad.toml").write_text('preset = "thesis-fit"\ncompressor = {count = "2"}\n')
    done = hrs("simulate", "S1", "--station", "two.toml", cwd=tmp_path)
    assert done.stdout.startswith("S1 at two compressors"), done.stderr
    done = hrs("compare", "S1", "--controllers", "logic", "--station", "two.toml", cwd=tmp_path)
    assert "station two compressors" in done.stdout
    for command in (("simulate", "S1"), ("compare", "S1"), ("scenarios", "S1"), ("bound", "S1")):
        done = hrs(*command, "--station", "bad.toml", cwd=tmp_path)
        assert done.returncode == 2
        assert "compressor.count: Input should be a valid integer" in done.stderr, command


INTERRUPTIBLE = """
import os, signal, sys
signal.signal(signal.SIGINT, signal.SIG_DFL)
os.execv(sys.argv[1], sys.argv[1:])
"""
"""A shell lets what it starts in the background ignore SIGINT, and tests may be started so."""


@pytest.mark.slow
def test_a_long_check_can_be_interrupted(tmp_path):
    (tmp_path / "long.json").write_text(json.dumps(AVERAGE))
    with subprocess.Popen(
        [sys.executable, "-c", INTERRUPTIBLE, HRS, "verify", tmp_path / "long.json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:
        try:
            time.sleep(2 * slowness())
            assert process.poll() is None
            process.send_signal(signal.SIGINT)
            _, said = process.communicate(timeout=60)
        finally:
            process.kill()
    assert process.returncode == 130
    assert b"Traceback" not in said


def test_times_end_in_z_wherever_they_are_told(service, tmp_path):
    """Every text that is a moment, in every answer of the service and in a backup."""
    with httpx.Client(base_url=service.url, timeout=30, trust_env=False) as http:
        http.post("/v1/twins", json={"id": "z", "scenario": "S1", "paused": True})
        http.post("/v1/runs", json={"scenario": "S1"})
        texts = [http.get(path).text for path in ("/v1/twins", "/v1/runs", "/v1/scenarios", "/v1/twins/z/events")]
        http.post("/v1/twins/z/stop")
        http.delete("/v1/twins/z")
    moments = re.findall(r"\d{4}-\d\d-\d\dT[^\"]*", " ".join(texts))
    assert len(moments) >= 2
    assert all(each.endswith("Z") for each in moments), moments
