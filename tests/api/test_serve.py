"""The service as a process: killed, stopped, guarded by keys, on both databases."""

from __future__ import annotations

import json
import random
import shutil
import time

import httpx
import pytest

from api.comparisons.service import as_document, compare
from api.settings import Settings
from api.telemetry.session import connect, open_session
from station import load_scenario
from station.kernel_cache import CACHE_FOLDER
from tests.api.conftest import RunningService, ended, free_port
from tests.api.here import hrs
from tests.pace import slowness
from tests.warm import run_hrs

FOUR = ["logic", "minlp1", "minlp2", "minlp3"]


def _get(service, path):
    return httpx.get(service.url + path, timeout=30, trust_env=False)


def _gone(service, seconds=5.0):
    until = time.monotonic() + seconds
    while service.group() and time.monotonic() < until:
        time.sleep(0.05)
    return service.group()


@pytest.mark.slow
def test_a_comparison_survives_kills_of_the_server(database_url, tmp_path):
    service = RunningService(tmp_path, "--database", database_url)
    chance = random.Random(3)
    request = {"scenarios": ["S1", "S2"], "controllers": FOUR, "replications": 60, "seed": 9}
    path = httpx.post(service.url + "/v1/comparisons", json=request, trust_env=False).headers["location"]
    kills = 0
    while kills < 4 and _get(service, path).json()["finished"] is None:
        time.sleep(chance.uniform(0.1, 0.5))
        service.kill()
        assert _gone(service) == []
        kills += 1
        service.start()
    with httpx.Client(base_url=service.url, trust_env=False) as http:
        job = ended(http, path)
        results = http.get(f"{path}/results").json()
    service.stop()
    assert kills > 0
    assert (job["state"], job["runs_done"]) == ("succeeded", 480)
    scenarios = [load_scenario("S1"), load_scenario("S2")]
    expected = as_document(compare(scenarios, FOUR, replications=60, seed=9))
    assert results == json.loads(json.dumps(expected))


@pytest.mark.slow
def test_a_first_start_answers_while_controllers_are_compiled(tmp_path):
    kernels = tmp_path / "kernels"
    shutil.copytree(CACHE_FOLDER, kernels, ignore=shutil.ignore_patterns("controllers"))
    service = RunningService(tmp_path, NUMBA_CACHE_DIR=str(kernels))
    with httpx.Client(base_url=service.url, timeout=30, trust_env=False) as http:
        listed = http.get("/v1/controllers").json()
        late = [each["name"] for each in listed if not each["ready"]]
        assert "guarded" in late  # the thesis's four are first
        assert http.get("/v1/controllers/guarded").json()["options"] == {}
        refused = http.post("/v1/runs", json={"scenario": "S1", "controller": "guarded"})
        assert (refused.status_code, refused.json()["title"]) == (503, "Being compiled")
        assert int(refused.headers["retry-after"]) > 0
        until = time.monotonic() + 120
        while not all(each["ready"] for each in http.get("/v1/controllers").json()):
            assert time.monotonic() < until
            time.sleep(0.5)
        done = ended(http, http.post("/v1/runs", json={"scenario": "S1", "controller": "guarded"}).headers["location"])
        assert done["state"] == "succeeded"
    service.stop()
    assert any("  compiling " in line and "guarded" in line for line in service.said)


@pytest.mark.slow
def test_the_service_stops_soon_and_leaves_nothing(tmp_path):
    service = RunningService(tmp_path)
    slow = {"scenario": "S4", "controller": "minlp1:horizon=10:node_limit=1000000000"}
    path = httpx.post(service.url + "/v1/runs", json=slow, trust_env=False).headers["location"]
    while _get(service, path).json()["state"] != "running":
        time.sleep(0.05)
    told = len(service.said)
    assert service.stop(group=True) < 3 * slowness()
    assert service.process.returncode == 0
    assert _gone(service) == []
    assert service.said[told:] == []  # no worker was taken for dead


@pytest.mark.slow
def test_a_taken_port_and_an_open_router_are_refused(tmp_path, service):
    used = _serve("--port", service.url.rpartition(":")[2], "--data", tmp_path / "a")
    assert used.returncode == 2
    assert "is in use" in used.stderr
    router = _serve("--port", "0", "--data", tmp_path / "b", "--zenoh-listen", "tcp/0.0.0.0:7447")
    assert router.returncode == 2
    assert "zenoh_listen: must be a loopback endpoint" in router.stderr
    for refused in (used, router):
        assert "Traceback" not in refused.stderr


def _serve(*options):
    return run_hrs("serve", *options)


@pytest.mark.slow
def test_other_machines_need_a_key(tmp_path):
    options = ("--host", "0.0.0.0", "--port", "0", "--data", tmp_path)  # noqa: S104  # what is refused
    refused = _serve(*options)
    assert refused.returncode == 2
    assert "hrs keys create" in refused.stderr
    key = hrs("keys", "create", "ann", "--data", tmp_path).stdout.strip()
    other = hrs("keys", "create", "bob", "--data", tmp_path).stdout.strip()
    assert hrs("keys", "create", "bob", "--data", tmp_path).returncode == 2
    service = RunningService(tmp_path, "--host", "0.0.0.0")  # noqa: S104  # what needs the key
    try:
        for headers in ({}, {"authorization": "Bearer hrs_no"}, {"authorization": f"Basic {key}"}):
            refusal = httpx.get(service.url + "/v1/runs", headers=headers, trust_env=False)
            assert refusal.status_code == 401
            assert refusal.headers["content-type"] == "application/problem+json"
            assert refusal.headers["www-authenticate"] == "Bearer"
        for valid in (key, other):
            answer = httpx.get(service.url + "/v1/runs", headers={"authorization": f"Bearer {valid}"}, trust_env=False)
            assert answer.status_code == 200
        assert hrs("keys", "revoke", "bob", "--data", tmp_path).returncode == 0
        assert hrs("keys", "revoke", "bob", "--data", tmp_path).returncode == 2
        late = httpx.get(service.url + "/v1/runs", headers={"authorization": f"Bearer {other}"}, trust_env=False)
        assert late.status_code == 401
    finally:
        service.stop()
    listed = hrs("keys", "list", "--data", tmp_path).stdout
    assert "ann" in listed
    assert "revoked" in listed
    stored = b"".join(path.read_bytes() for path in tmp_path.iterdir())
    assert key.encode() not in stored + "".join(service.said).encode()


@pytest.mark.slow
def test_the_command_line_uses_a_running_service(service, http):
    submitted = hrs("submit", "S1", "--controllers", "minlp1", "--wait", "--url", service.url)
    assert submitted.returncode == 0, submitted.stderr
    assert "t_total                         846 s" in submitted.stdout
    compared = hrs("submit", "S1", "S2", "--controllers", "logic,minlp1", "--wait", "--url", service.url)
    assert "Table 7.5" in compared.stdout
    listed = hrs("jobs", "--url", service.url).stdout
    assert "4/4" in listed
    assert "S1 x minlp1" in listed
    assert json.loads(hrs("jobs", "--json", "--url", service.url).stdout)[0]["runs_done"] == 4
    wrong = hrs("submit", "S1", "--controllers", "nobody", "--url", service.url)
    assert wrong.returncode == 2
    assert "none is called 'nobody'" in wrong.stderr
    nowhere = hrs("jobs", "--url", "http://127.0.0.1:1")
    assert nowhere.returncode == 2
    assert "hrs serve" in nowhere.stderr


@pytest.mark.parametrize("value", ["0", "ten"])
def test_a_wrong_setting_is_named(monkeypatch, value):
    monkeypatch.setenv("HRS_LEASE_S", value)
    refused = _serve("--port", "0")
    assert refused.returncode == 2
    assert "lease_s" in refused.stderr


@pytest.mark.slow
def test_the_demonstration_prints_the_table_of_its_first_job(tmp_path):
    service = RunningService(tmp_path, "--demo")
    try:
        until = time.monotonic() + 60
        while not any("36 of 36 signs" in line for line in service.said):
            assert time.monotonic() < until, service.said
            time.sleep(0.1)
        for title in ("Table 7.4", "Table 7.5", "Table 7.6", "Table 7.7"):
            assert any(title in line for line in service.said)
        twin = _get(service, "/v1/twins/demo").json()
        assert (twin["state"], twin["speed"], twin["at_end"]) == ("running", 1, "repeat")
        watched = run_hrs("watch", "demo", "--endpoint", service.zenoh, "--seconds", "1")
        assert watched.returncode == 0, watched.stderr
        assert "pressure" in watched.stdout
        nobody = hrs("watch", "nobody", "--endpoint", service.zenoh)
        assert nobody.returncode == 2
        assert "there are demo" in nobody.stderr
    finally:
        with httpx.stream("GET", service.url + "/v1/twins/demo/stream", trust_env=False) as stream:
            next(stream.iter_lines())
            assert service.stop() < 3
    assert _gone(service) == []


@pytest.mark.slow
def test_jobs_and_twins_have_limits(tmp_path):
    service = RunningService(tmp_path, "--workers", "0", HRS_JOBS_MAX="1", HRS_TWINS_MAX="0")
    try:
        for path, limit in (("/v1/runs", "jobs"), ("/v1/twins", "twins_max = 0")):
            if path == "/v1/runs":
                assert httpx.post(service.url + path, json={"scenario": "S1"}, trust_env=False).status_code == 202
            refused = httpx.post(service.url + path, json={"scenario": "S1"}, trust_env=False)
            assert refused.status_code == 429
            assert refused.headers["content-type"] == "application/problem+json"
            assert int(refused.headers["retry-after"]) > 0
            assert limit in refused.json()["detail"]
    finally:
        service.stop()


@pytest.mark.slow
def test_it_runs_with_what_is_there_already(postgres_url, tmp_path):
    """PostgreSQL, a zenoh router of somebody's, an address others reach, a key."""
    router = f"tcp/127.0.0.1:{free_port()}"
    environment = {"HRS_DATABASE": postgres_url, "HRS_ZENOH_CONNECT": router, "HRS_DATA": str(tmp_path)}
    lonely = run_hrs("serve", "--port", "0", **environment)
    assert lonely.returncode == 2
    assert f"no router answers at {router}" in lonely.stderr
    made = hrs("keys", "create", "me", **environment)
    headers = {"authorization": f"Bearer {made.stdout.strip()}"}
    with open_session(Settings(zenoh_listen=router)):
        service = RunningService(tmp_path, "--host", "0.0.0.0", **environment)  # noqa: S104  # what needs the key
        try:
            with httpx.Client(base_url=service.url, headers=headers, trust_env=False) as http:
                request = {"id": "boxed", "scenario": "S1", "speed": 20, "at_end": "repeat"}
                assert http.post("/v1/twins", json=request).status_code == 201
                place = http.post("/v1/runs", json={"scenario": "S1"}).headers["location"]
                assert ended(http, place)["state"] == "succeeded"
            with connect(router) as session:
                replies = list(session.get("hrs/v1/boxed/sample", timeout=10))
            assert json.loads(replies[0].ok.payload.to_bytes())["twin"] == "boxed"
            assert httpx.get(service.url + "/", trust_env=False).status_code == 200
            assert httpx.get(service.url + "/v1/twins", trust_env=False).status_code == 401
        finally:
            service.stop()
