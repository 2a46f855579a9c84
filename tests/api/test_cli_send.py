"""`hrs send` as a user types it: a record goes to a measured twin, by either way, and nothing counts twice."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import csv, parquet

from station.batches import batches_of
from tests.api.measured import BEGIN, NAMES, TAG_MAP, batches, followed
from tests.api.test_measurements import _rows
from tests.waiting import wait_until

WORKERS = 0
HRS = Path(sys.executable).with_name("hrs")
TOML = "".join(f'[[tags]]\ntag = "T.{name}"\ncolumn = "{name}"\nsensor = "{name}"\n' for name in NAMES)
SECONDS = 300
(WHOLE,) = batches(SECONDS, SECONDS)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A record of some minutes, its rows in disorder, and its tags."""
    folder = tmp_path_factory.mktemp("record")
    cells = WHOLE.value.reshape(SECONDS, len(NAMES))
    table = pa.table({"time_s": BEGIN + 0.1 + np.arange(SECONDS), **dict(zip(NAMES, cells.T, strict=True))})
    table = table.take(np.random.default_rng(1).permutation(SECONDS))
    blank = [table["time_s"], *(pa.array(table[name].to_numpy(), from_pandas=True) for name in NAMES)]
    csv.write_csv(pa.table(blank, ["time_s", *NAMES]), folder / "day.csv")
    parquet.write_table(table, folder / "day.parquet")
    (folder / "tags.toml").write_text(TOML)
    return folder


@pytest.fixture
def twin(measured_twin):
    """The id of a measured twin that nobody has used."""
    return measured_twin


def _command(twin, *options, record="day.csv"):
    return [HRS, "send", record, "--tags", "tags.toml", "--twin", twin, *map(str, options)]


def _hrs(folder, twin, *options, record="day.csv"):
    command = _command(twin, *options, record=record)
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder, timeout=180)


def _expected():
    return followed([WHOLE.part(np.flatnonzero(~np.isnan(WHOLE.value)))], finish=True)


@pytest.mark.slow
@pytest.mark.parametrize("way", ["rest", "zenoh"])
def test_a_record_is_sent_once_and_followed_as_it_is(service, http, folder, twin, way):
    where = ("--url", service.url) if way == "rest" else ("--endpoint", service.zenoh)
    samples = int(np.isfinite(WHOLE.value).sum())
    done = _hrs(folder, twin, *where, "--batch", 60, record="day.csv" if way == "rest" else "day.parquet")
    assert done.returncode == 0, done.stderr
    assert "has 5 batches of source record-" in done.stdout
    assert f"now {samples} samples more" in done.stdout
    again = _hrs(folder, twin, *where, "--batch", 60, record="day.csv" if way == "rest" else "day.parquet")
    assert (again.returncode, "now 0 samples more; 5 batches were there already" in again.stdout) == (0, True)
    other = _hrs(folder, twin, *where, "--batch", 50, record="day.csv" if way == "rest" else "day.parquet")
    assert (other.returncode, "other content" in other.stderr, "--source" in other.stderr) == (2, True, True)
    assert http.post(f"/v1/twins/{twin}/stop").json()["samples"] == SECONDS + 1
    assert _rows(http, f"/v1/twins/{twin}").tobytes() == _expected().tobytes()


@pytest.mark.slow
def test_a_sender_that_is_killed_goes_on_where_it_was(service, http, folder, twin):
    where = ("--url", service.url, "--batch", 10)
    first = subprocess.Popen(_command(twin, *where, "--speed", 10), cwd=folder)  # it takes 30 s
    try:
        wait_until(lambda: _highest(http, twin) >= 4)
    finally:
        first.send_signal(signal.SIGKILL)
        first.wait()
    had = _highest(http, twin)
    assert had < 29, "it was interrupted"
    done = _hrs(folder, twin, *where)
    assert done.returncode == 0, done.stderr
    assert f"; {had + 1} batches were there already" in done.stdout
    assert http.get(f"/v1/twins/{twin}/measurements").json()["sources"][0]["sequence"] == 29
    assert http.post(f"/v1/twins/{twin}/stop").json()["samples"] == SECONDS + 1
    assert _rows(http, f"/v1/twins/{twin}").tobytes() == _expected().tobytes()


def _highest(http, twin):
    found = http.get(f"/v1/twins/{twin}/measurements").json()["sources"]
    return found[0]["sequence"] if found else -1


@pytest.mark.slow
def test_speed_is_that_of_the_clock(service, folder, twin):
    began = time.monotonic()
    done = _hrs(folder, twin, "--url", service.url, "--speed", 40, "--batch", 20, "--start", BEGIN + 180)
    assert done.returncode == 0, done.stderr
    assert "has 6 batches" in done.stdout
    assert time.monotonic() - began >= 119 / 40


@pytest.mark.slow
def test_what_is_wrong_is_named(service, http, folder, twin):
    where = ("--url", service.url)
    for options, named in (
        (("--speed", 0), "--speed: must be a number above 0; given 0"),
        (("--batch", "nan"), "--batch: must be a number above 0; given nan"),
        (("--source", "a b"), "--source: must be 1 to 64 letters"),
        (("--start", BEGIN + 1e6), "must hold at least one sample"),
        (("--endpoint", service.zenoh), "--endpoint: must be left out"),
    ):
        done = _hrs(folder, twin, *where, *options)
        assert (done.returncode, named in done.stderr) == (2, True), done.stderr
    nobody = _hrs(folder, "nobody", *where)
    assert (nobody.returncode, "no twin is called 'nobody'" in nobody.stderr) == (2, True), nobody.stderr
    nobody = _hrs(folder, "nobody", "--endpoint", service.zenoh)
    assert (nobody.returncode, "no live twin 'nobody' takes measurements here" in nobody.stderr) == (2, True)
    away = _hrs(folder, twin, "--url", "http://127.0.0.1:9")
    assert (away.returncode, "no service answers" in away.stderr) == (2, True)
    assert http.get(f"/v1/twins/{twin}/measurements").json() == {"sources": []}
    (folder / "odd.toml").write_text(TOML.replace('tag = "T.vehicle"', 'tag = "T.odd"'))
    command = [HRS, "send", "day.csv", "--tags", "odd.toml", "--twin", twin, *where]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder)
    assert (done.returncode, 'given "T.odd"' in done.stderr) == (2, True), done.stderr


def test_batches_are_cut_by_time_and_by_size():
    seconds = 1500
    table = pa.table({"time_s": np.arange(float(seconds)), **{name: np.zeros(seconds) for name in NAMES}})
    found = batches_of(table, TAG_MAP, 1300.0)
    assert [len(each) for each in found] == [20_000, 2_100, 3_400]
    assert np.concatenate([each.time for each in found]).tolist() == np.repeat(np.arange(1500.0), 17).tolist()
    assert len(batches_of(table, TAG_MAP, 1300.0, start_s=1400.0)) == 1
