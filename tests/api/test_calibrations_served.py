"""Calibrations as a user gets them: over REST and from the command line, done once whoever is killed on the way."""

from __future__ import annotations

import json
import time

import httpx
import pytest

from api.measurements.written import parquet_of
from station.station_files import load_station_file
from tests.api.calibrating import HIDDEN, ORDER, TAGS, readings
from tests.api.conftest import RunningService, ended
from tests.api.here import hrs
from tests.waiting import wait_until

PARQUET = {"content-type": "application/vnd.apache.parquet"}


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    """A service whose twin `field` has followed a station for seven hours."""
    running = RunningService(tmp_path_factory.mktemp("served"), "--workers", "1")
    with httpx.Client(base_url=running.url, timeout=30, trust_env=False) as http:
        assert http.post("/v1/twins", json={**ORDER, "id": "field"}).status_code == 201
        for number, batch in enumerate(readings()):
            sent = {"params": {"source": "plc", "sequence": number}, "content": parquet_of(batch, TAGS)}
            path = "/v1/twins/field/measurements"
            wait_until(lambda path=path, sent=sent: http.post(path, headers=PARQUET, **sent).status_code == 202)
        wait_until(lambda: http.get("/v1/twins/field").json()["samples"] >= 25_000)
        yield running, http
    running.stop()


def problem(answer, status):
    assert answer.status_code == status, answer.text
    found = answer.json()
    return found["type"].rpartition(":")[2], found.get("errors", [{"message": found["detail"]}])[0]["message"]


@pytest.mark.slow
def test_a_calibration_is_done_once_whoever_is_killed(served):
    running, http = served
    key = {"idempotency-key": "calibrate-1"}
    first = http.post("/v1/calibrations", json={"twin": "field"}, headers=key)
    assert first.status_code == 202
    assert (first.json()["from_s"], first.json()["twin"], first.json()["result"]) == (0, "field", None)
    place = first.headers["location"]
    wait_until(lambda: http.get(place).json()["state"] == "running")
    wait_until(lambda: http.get(place).json()["progress"] > 0)
    running.kill()
    running.start()
    again = http.post("/v1/calibrations", json={"twin": "field"}, headers=key)
    assert (again.content, again.headers["idempotency-replayed"]) == (first.content, "true")
    job = ended(http, place, 120)
    assert job["state"] == "succeeded", job
    result = job["result"]
    assert (result["verdict"], result["refused"], job["progress"]) == ("accepted", [], 1.0)
    pressure = result["parameters"]["compressor.pressure_bar"]
    assert pressure["low"] < HIDDEN.compressor.pressure_bar < pressure["high"]
    assert len(http.get("/v1/calibrations").json()["items"]) == 1
    assert http.get("/v1/calibrations").json()["items"][0]["result"]["station"] is None
    etag = http.get(place).headers["etag"]
    assert http.get(place, headers={"if-none-match": etag}).status_code == 304

    tag = http.get("/v1/twins/field").headers["etag"]
    moved = http.post("/v1/twins/field/station", json={"calibration": job["id"]}, headers={"if-match": tag})
    assert (moved.status_code, moved.json()["calibration"]) == (200, job["id"])
    changed = http.post("/v1/twins/field/station", json={"calibration": job["id"]}, headers={"if-match": tag})
    assert problem(changed, 412)[0] == "changed"
    running.kill()
    running.start()
    state = http.get("/v1/twins/field").json()
    assert (state["calibration"], state["station"]) == (job["id"], "thesis-fit-calibrated")
    assert http.get("/v1/twins/field/scenario").json()["station"] == result["station"]
    kinds = [event["kind"] for event in http.get("/v1/twins/field/events?limit=1000").json()["items"]]
    assert kinds.count("station_changed") == 1


@pytest.mark.slow
def test_the_command_line_calibrates_a_twin_and_uses_what_was_found(served, tmp_path):
    running, http = served
    asked = ("calibrate", "--twin", "field", "--url", running.url)
    done = hrs(*asked, "--to", 24_000, "--out", "mine.toml", "--json", "c.json", "--use", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "verdict: accepted" in done.stdout
    assert "twin field follows with station thesis-fit-calibrated from now on" in done.stdout
    found = json.loads((tmp_path / "c.json").read_text())
    job = done.stdout.partition(":")[0]
    result = http.get(f"/v1/calibrations/{job}").json()["result"]
    assert found["parameters"]["compressor.pressure_bar"] == result["parameters"]["compressor.pressure_bar"]
    assert load_station_file(str(tmp_path / "mine.toml")).model_dump(mode="json") == result["station"]
    assert http.get("/v1/twins/field").json()["calibration"] == job
    shown = hrs("jobs", job, "--url", running.url)
    assert "compressor.pressure_bar" in shown.stdout
    listed = hrs("jobs", "--url", running.url).stdout
    assert "field, seconds 0 to 24000" in listed
    short = hrs(*asked, "--from", 10, "--to", 20)
    assert (short.returncode, "must be 21600 to 86400 seconds" in short.stderr) == (2, True)


@pytest.mark.slow
def test_a_calibration_is_cancelled_and_forgotten(served):
    _, http = served
    place = http.post("/v1/calibrations", json={"twin": "field"}).headers["location"]
    wait_until(lambda: http.get(place).json()["state"] == "running")
    assert http.post(f"{place}/cancel").json()["state"] == "cancelled"
    used = http.post("/v1/twins/field/station", json={"calibration": place.rpartition("/")[2]})
    assert problem(used, 409) == (
        "conflict",
        f"calibration {place.rpartition('/')[2]!r} is cancelled: it has no station",
    )
    after = http.post("/v1/calibrations", json={"twin": "field"}).headers["location"]
    began = time.monotonic()
    assert ended(http, after, 120)["state"] == "succeeded"
    assert time.monotonic() - began < 60, "the worker that was told to stop has gone on to it"
    assert http.delete(place).status_code == 204
    assert http.get(place).status_code == 404


def test_what_makes_no_sense_is_refused_by_name(http_alone):
    http = http_alone
    assert problem(http.post("/v1/calibrations", json={"twin": "none"}), 422) == (
        "invalid", "no twin is called 'none'"
    )  # fmt: skip
    assert problem(http.post("/v1/calibrations", json={"twin": "sim"}), 409)[0] == "conflict"
    assert problem(http.post("/v1/twins/sim/station", json={"calibration": "calibration-x"}), 409)[0] == "conflict"
    assert problem(http.post("/v1/twins/none/station", json={"calibration": "calibration-x"}), 404)[0] == "not-found"
    assert problem(http.post("/v1/twins/field/station", json={"calibration": "calibration-x"}), 422) == (
        "invalid", "no calibration is called 'calibration-x'"
    )  # fmt: skip
    assert problem(http.get("/v1/calibrations/calibration-x"), 404)[0] == "not-found"
    assert problem(http.post("/v1/twins", json={"id": "x", "source": "replay", "of": "none"}), 422)[0] == "invalid"
    for wrong in (
        {"twin": 1},
        {"twin": "field", "from_s": 0.5},
        {"twin": "field", "to_s": "9"},
        {"twin": "field", "x": 1},
    ):
        assert http.post("/v1/calibrations", json=wrong).status_code == 422


@pytest.fixture
def http_alone(service, http):
    """A service with a measured twin and a simulated one."""
    assert http.post("/v1/twins", json={**ORDER, "id": "field"}).status_code == 201
    assert http.post("/v1/twins", json={"id": "sim", "scenario": "S1", "paused": True}).status_code == 201
    return http
