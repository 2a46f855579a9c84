"""What operators look at: request ids, health, metrics, logs."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import time

import httpx
import pytest
import sqlalchemy as sa
from prometheus_client.parser import text_string_to_metric_families

from api.jobs.worker import NICENESS
from api.server.gauges import KEPT_S
from api.settings import Settings
from api.store.database import Database
from api.telemetry.session import open_session
from tests.api.conftest import RunningService, ended, free_port
from tests.api.here import hrs

CHECKS = {"database", "migrations", "zenoh", "workers"}


def _get(service, path, **headers):
    return httpx.get(service.url + path, timeout=30, trust_env=False, headers=headers)


def _metrics(service, **headers):
    """Value by name and labels."""
    found = text_string_to_metric_families(_get(service, "/metrics", **headers).text)
    return {(s.name, *sorted(s.labels.items())): s.value for family in found for s in family.samples}


def _ready(service, seconds=20.0):
    """The answer of /readyz once it is ready."""
    until = time.monotonic() + seconds
    while (answer := _get(service, "/readyz")).status_code != 200:
        assert time.monotonic() < until, answer.text
        time.sleep(0.1)
    return answer


def _failing(service, name, again=lambda: None, seconds=20.0):
    """The problem of /readyz once it names `name`."""
    until = time.monotonic() + seconds
    while True:
        again()
        answer = _get(service, "/readyz")
        if answer.status_code == 503 and name in [error["field"] for error in answer.json()["errors"]]:
            return answer
        assert time.monotonic() < until, answer.text
        time.sleep(0.1)


@pytest.mark.parametrize("path", ["/v1/scenarios", "/v1/nothing", "/v1/runs/run-0", "/", "/static/app.js", "/livez"])
def test_every_answer_has_the_id_of_its_request(http, path):
    assert re.fullmatch(r"[0-9a-f]{16}", http.get(path).headers["x-request-id"])
    mine = http.get(path, headers={"X-Request-ID": "mine-1.a:b/c=d+e"})
    assert mine.headers["x-request-id"] == "mine-1.a:b/c=d+e"
    if mine.status_code >= 400:
        assert mine.json()["request_id"] == "mine-1.a:b/c=d+e"
    for insane in ("two words", "a" * 129, "", 'quote"', "semi;colon", "<script>"):
        given = http.get(path, headers={"X-Request-ID": insane}).headers["x-request-id"]
        assert re.fullmatch(r"[0-9a-f]{16}", given), insane


def test_problems_of_the_guard_have_it_too(http):
    refused = http.get("/v1/runs", headers={"host": "elsewhere.example", "x-request-id": "one"})
    assert (refused.status_code, refused.headers["x-request-id"], refused.json()["request_id"]) == (421, "one", "one")


def test_a_service_that_works_lives_and_is_ready(service, http):
    alive = http.get("/livez").json()
    assert alive["status"] == "alive"
    assert alive["sent"] == pytest.approx(time.time(), abs=5)
    ready = _ready(service).json()
    store = ready.pop("store")
    assert ready == {"status": "ready", "checks": dict.fromkeys(CHECKS, "ok")}
    assert store["bytes"] > 0
    assert store["disk_free_bytes"] > 0
    assert (store["bytes_max"], store["full"]) == (None, False)


@pytest.mark.slow
def test_metrics_count_what_happened(service, http):
    _ready(service)
    before = _metrics(service)
    path = http.post("/v1/runs", json={"scenario": "S1"}).headers["location"]
    ended(http, path)
    http.get("/v1/runs/run-0")
    http.get("/v1/nowhere/at/all")
    http.request("SEARCH", "/v1/runs")
    http.post("/v1/twins", json={"id": "counted", "scenario": "S1", "speed": 1, "at_end": "idle"})
    time.sleep(KEPT_S + 0.1)  # figures of the store are that old at most
    after = _metrics(service)

    def grown(name, **labels):
        key = (name, *sorted(labels.items()))
        return after[key] - before.get(key, 0)

    asked = {"route": "/v1/runs/{run_id}", "method": "GET"}
    assert grown("hrs_http_requests_total", **asked, status="404") == 1
    assert grown("hrs_http_requests_total", **asked, status="200") >= 1
    assert grown("hrs_http_answer_seconds_count", **asked) >= 2
    assert grown("hrs_http_requests_total", route="/v1/runs", method="POST", status="202") == 1
    assert grown("hrs_http_requests_total", route="(none)", method="GET", status="404") == 1
    assert not any("SEARCH" in part for key in after for part in map(str, key))
    assert grown("hrs_jobs", kind="run", state="succeeded") == 1
    assert grown("hrs_chunk_seconds_count", kind="run", outcome="done") == 1
    assert grown("hrs_twins", state="running") == 1
    assert after["hrs_chunks_waiting",] == 0
    assert after["hrs_lease_takeovers_total",] == before["hrs_lease_takeovers_total",]
    for name in ("hrs_twin_late_ticks_total", "hrs_samples_dropped_total", "hrs_database_errors_total", "hrs_workers",
                 "hrs_twins_subscribed", "process_resident_memory_bytes", "process_open_fds"):  # fmt: skip
        assert (name,) in after, name
    http.post("/v1/twins/counted/stop")
    openmetrics = http.get("/metrics", headers={"accept": "application/openmetrics-text"})
    assert openmetrics.text.endswith("# EOF\n")


@pytest.mark.slow
def test_a_worker_that_dies_is_missed_and_its_chunk_taken_over(tmp_path):
    service = RunningService(tmp_path, "--workers", "1")
    try:
        _ready(service)
        slow = {"scenario": "S1", "controller": "minlp1:horizon=5:node_limit=5000"}  # some 2.5 s
        path = httpx.post(service.url + "/v1/runs", json=slow, trust_env=False).headers["location"]
        while _get(service, path).json()["state"] == "queued":
            time.sleep(0.02)

        def kill_workers():
            children = subprocess.run(
                ["/bin/ps", "-o", "pid=,ni=", "-s", str(service.process.pid)],
                capture_output=True,
                text=True,
                check=True,
            )
            for line in children.stdout.splitlines():
                pid, nice = line.split()
                if nice == str(NICENESS):  # workers yield; nothing else of the service does
                    os.kill(int(pid), signal.SIGKILL)

        base = os.getpriority(os.PRIO_PROCESS, 0)
        if base:
            pytest.skip("runs under nice: workers cannot be told apart by it")
        problem = _failing(service, "workers", kill_workers).json()
        assert problem["type"] == "urn:hrs-twin:problem:not-ready"
        assert problem["errors"] == [{"field": "workers", "message": "0 of 1 run"}]
        assert _get(service, "/livez").status_code == 200
        _ready(service)
        while _get(service, path).json()["finished"] is None:
            time.sleep(0.05)
        found = _metrics(service)
        assert found["hrs_lease_takeovers_total",] == 1
        assert found["hrs_workers_replaced_total",] >= 1
    finally:
        service.stop()


@pytest.mark.slow
def test_readiness_names_the_database_and_its_migrations(postgres_url, tmp_path):
    service = RunningService(tmp_path, "--workers", "0", "--database", postgres_url)
    database = Database(postgres_url)
    try:
        _ready(service)
        with database.write() as connection:
            connection.execute(sa.text("UPDATE alembic_version SET version_num = '9999'"))
        assert [error["field"] for error in _failing(service, "migrations").json()["errors"]] == ["migrations"]
        with database.write() as connection:
            connection.execute(sa.text("DROP TABLE alembic_version"))
        _failing(service, "migrations")
        database.close()
        name = sa.make_url(postgres_url).database
        server = sa.create_engine(sa.make_url(postgres_url).set(database="postgres"), isolation_level="AUTOCOMMIT")
        with server.connect() as connection:
            connection.execute(sa.text(f"DROP DATABASE {name} WITH (FORCE)"))
        answer = _failing(service, "database")
        assert name not in answer.text
        assert "127.0.0.1" not in answer.text
        assert _get(service, "/livez").status_code == 200
        found = _metrics(service)
        assert found["hrs_database_errors_total",] > 0
        with server.connect() as connection:
            connection.execute(sa.text(f"CREATE DATABASE {name}"))  # the fixture drops it
        server.dispose()
    finally:
        service.kill()


@pytest.mark.slow
def test_readiness_names_a_router_that_is_gone(tmp_path):
    router = f"tcp/127.0.0.1:{free_port()}"
    with open_session(Settings(zenoh_listen=router)):
        service = RunningService(tmp_path, "--workers", "0", HRS_ZENOH_CONNECT=router)
        _ready(service)
    try:
        problem = _failing(service, "zenoh").json()
        assert [error["field"] for error in problem["errors"]] == ["zenoh"]
        with open_session(Settings(zenoh_listen=router)):
            _ready(service)
    finally:
        service.kill()


@pytest.mark.slow
def test_health_is_open_and_metrics_need_a_key(tmp_path):
    key = hrs("keys", "create", "ann", "--data", tmp_path).stdout.strip()
    service = RunningService(tmp_path, "--workers", "0", "--host", "0.0.0.0")  # noqa: S104  # what needs the key
    try:
        assert _get(service, "/livez").status_code == 200
        assert str(tmp_path) not in _ready(service).text
        refused = _get(service, "/metrics")
        assert refused.status_code == 401
        assert refused.headers["x-request-id"] == refused.json()["request_id"]
        assert _metrics(service, authorization=f"Bearer {key}")["hrs_http_requests_total", ("method", "GET"),
            ("route", "(none)"), ("status", "401")] == 1  # fmt: skip
    finally:
        service.stop()


@pytest.mark.slow
def test_json_logs_are_an_object_a_line_and_tell_no_secret(postgres_url, tmp_path):
    secret = sa.make_url(postgres_url).set(password="s3cret-of-mine").render_as_string(hide_password=False)  # noqa: S106  # of nobody
    key = hrs("keys", "create", "ann", "--database", secret).stdout.strip()
    assert key.startswith("hrs_")
    headers = {"authorization": f"Bearer {key}", "x-request-id": "traced-1"}
    service = RunningService(
        tmp_path, "--workers", "1", "--host", "0.0.0.0", "--database", secret, HRS_LOG_FORMAT="json",  # noqa: S104  # what needs the key
        HRS_ACCESS_LOG="true",
    )  # fmt: skip
    try:
        assert _get(service, "/v1/scenarios/S1", **headers).status_code == 200
        assert _get(service, f"/v1/scenarios/{key}", **headers).status_code == 404
        assert _get(service, f"/v1/runs?key={key}", authorization=f"Basic {key}").status_code == 401
        bad = {"scenario": "S1", "controller": "minlp1:horizon=2"}
        database = Database(postgres_url)
        with database.write() as connection:
            connection.execute(sa.text("ALTER TABLE jobs RENAME TO gone"))
        failed = httpx.post(service.url + "/v1/runs", json=bad, headers=headers, trust_env=False)
        assert failed.status_code == 500
        with database.write() as connection:
            connection.execute(sa.text("ALTER TABLE gone RENAME TO jobs"))
        database.close()
    finally:
        service.stop()
    lines = [json.loads(line) for line in service.said]
    assert all({"time", "level", "logger", "message"} <= set(line) for line in lines)
    asked = [line for line in lines if line["logger"] == "api.http.request_log"]
    assert {(line["route"], line["status"]) for line in asked} >= {
        ("/v1/scenarios/{name}", 200), ("/v1/scenarios/{name}", 404), ("(none)", 401), ("/v1/runs", 500),
    }  # fmt: skip
    assert all(line["request_id"] == "traced-1" for line in asked if line["status"] != 401)
    error = next(line for line in lines if line["message"] == "a request failed")
    assert (error["level"], error["request_id"]) == ("error", "traced-1")
    assert "Traceback" in error["exception"]
    said = "".join(service.said)
    for hidden in (key, key[10:30], "s3cret-of-mine", "Basic hrs_"):
        assert hidden not in said


@pytest.mark.slow
def test_text_logs_name_the_request(tmp_path):
    service = RunningService(tmp_path, "--workers", "0", HRS_ACCESS_LOG="true")
    try:
        _get(service, "/v1/scenarios/S1", **{"x-request-id": "traced-2"})
        _get(service, "/v1/scenarios/S1%0Aforged")
    finally:
        service.stop()
    assert "GET /v1/scenarios/S1 200 [request traced-2]\n" in service.said
    assert not any(line.startswith("forged") for line in service.said)
    assert any(line.startswith("GET /v1/scenarios/S1%0Aforged 404") for line in service.said)
