"""A store that does not answer: every request is answered all the same, and what lives in memory goes on."""

from __future__ import annotations

import sqlite3
import threading
import time
from contextlib import closing, contextmanager, suppress

import httpx
import pytest

from tests.api.conftest import RunningService, ended
from tests.api.load import Ask, load
from tests.api.test_executors import OnDask, Processes
from tests.nemesis.postgres import Postgres, missing
from tests.pace import slowness
from tests.stalls import Stalls
from tests.waiting import awaited, wait_until

BOUND_S = 3.0
"""Every answer is there by then [s]."""

MEMORY_S = 2.0
"""What needs no store is there by then, on a loaded machine [s]."""

PER_S = 200.0
"""Requests a second while the store is silent, on a usual machine: it bears twice that with a store that answers."""

FROM_MEMORY = ("twin", "metrics", "recent history", "livez")


class Listener(threading.Thread):
    """Reads the event stream of a twin; when each sample came [s, monotonic]."""

    def __init__(self, url: str) -> None:
        super().__init__(daemon=True)
        self._url = url
        self.came: list[float] = []
        self.ending = threading.Event()
        self.start()

    def run(self) -> None:
        with suppress(httpx.HTTPError), httpx.stream("GET", self._url, timeout=30, trust_env=False) as answer:
            for line in answer.iter_lines():
                if line == "event: sample":
                    self.came.append(time.monotonic())
                if self.ending.is_set():
                    return

    def longest_gap_s(self) -> float:
        return max(behind - before for before, behind in zip(self.came, self.came[1:], strict=False))


def _submit(http, key):
    body = {"scenario": "S1", "controller": "logic", "seed": int(key)}
    return http.post("/v1/runs", json=body, headers={"Idempotency-Key": f"run-{key}"})


def _insist(send):
    """The answer when the store is back."""
    for _ in range(100):
        answer = send()
        if answer.status_code < 300:
            return answer
        assert answer.status_code in {409, 503}, answer.text
        time.sleep(0.2)
    raise AssertionError(answer.text)


@contextmanager
def _service(postgres, folder, executor="processes", **more):
    settings = {"HRS_DATABASE": postgres.url, "HRS_EXECUTOR": executor, "HRS_WORKERS": "1", "HRS_LEASE_S": "2"}
    service = RunningService(folder, **settings, **more)
    try:
        yield service
    finally:
        service.kill()


@pytest.fixture(scope="module")
def postgres():
    """A PostgreSQL server that may be frozen."""
    if missing():
        pytest.skip(missing())
    with closing(Postgres()) as server:
        yield server


def _asked(run, history_from):
    """Requests of every kind."""
    again, vehicle = {"Idempotency-Key": "again"}, {"Idempotency-Key": "vehicle"}
    return [
        Ask("twin", "GET", "/v1/twins/t"),
        Ask("metrics", "GET", "/metrics"),
        Ask("recent history", "GET", f"/v1/twins/t/history?from_s={history_from}&columns=pressure_high"),
        Ask("livez", "GET", "/livez"),
        Ask("twins", "GET", "/v1/twins"),
        Ask("run", "GET", f"/v1/runs/{run}"),
        Ask("runs", "GET", "/v1/runs"),
        Ask("series", "GET", f"/v1/runs/{run}/series?step_s=600"),
        Ask("comparisons", "GET", "/v1/comparisons"),
        Ask("event", "GET", "/v1/twins/t/events?after=-1&limit=1"),
        Ask("submit", "POST", "/v1/runs", {"scenario": "S1"}, again),
        Ask("vehicle", "POST", "/v1/twins/u/vehicles", {"start_pressure_bar": 50.5}, vehicle),
        Ask("change", "PATCH", "/v1/twins/u", {"speed": 2}),
        Ask("other twin", "POST", "/v1/twins", {"id": "v", "scenario": "S1"}),
        Ask("cancel", "POST", f"/v1/runs/{run}/cancel"),
    ]


def _check_bounded(answers, stalled_s):
    """Every answer came in time, but for what the machine itself stood still [s]."""
    bound = BOUND_S + stalled_s
    late = [(answer.what, answer.status, round(answer.took_s, 2)) for answer in answers if answer.took_s > bound]
    assert not late, late[:20]
    wrong = [answer for answer in answers if answer.status not in {200, 201, 202, 304, 409, 503}]
    assert not wrong, wrong[:5]
    refused = [answer for answer in answers if answer.status == 503]
    assert refused
    assert all(int(answer.headers["retry-after"]) >= 1 for answer in refused)
    known = [answer for answer in answers if answer.what in FROM_MEMORY]
    assert {answer.status for answer in known} == {200}
    slow = [(answer.what, round(answer.took_s, 2)) for answer in known if answer.took_s > MEMORY_S + stalled_s]
    assert not slow, slow[:20]


def _frozen_under_load(postgres, service, seconds):
    """Freeze the store under load; nothing is lost or doubled behind."""
    with httpx.Client(base_url=service.url, timeout=30, trust_env=False) as http:
        run = _insist(lambda: _submit(http, "0")).json()["id"]
        ended(http, f"/v1/runs/{run}")
        for twin in ("t", "u"):
            http.post("/v1/twins", json={"id": twin, "scenario": "S1", "at_end": "repeat"}).raise_for_status()
        wait_until(lambda: http.get("/v1/twins/t").json()["samples"] > 2)
        listener = Listener(f"{service.url}/v1/twins/t/stream")
        wait_until(lambda: len(listener.came) > 1)
        queued = [_insist(lambda key=key: _submit(http, key)).json()["id"] for key in "123"]
        sent = int(http.get("/v1/twins/t").json()["samples"])
        began = time.monotonic()
        with Stalls() as stalls, postgres.frozen():
            asked = _asked(run, sent + 1)
            answers = awaited(load(service.url, asked, seconds, PER_S / slowness()))
            assert service.process.poll() is None, service.said
            gaps, heard = listener.longest_gap_s(), sum(came > began for came in listener.came)
            listed = http.get("/v1/twins").json()
            assert http.get("/readyz").status_code == 503
        assert (listed["complete"], [item["id"] for item in listed["items"]][:2]) == (False, ["t", "u"])
        _check_bounded(answers, stalls.worst)
        assert (heard >= seconds - 2, gaps < BOUND_S + stalls.worst) == (True, True), (heard, gaps)
        wait_until(lambda: http.get("/readyz").status_code == 200)
        _check_whole(http, queued)
        listener.ending.set()


def _check_whole(http, queued):
    """What was asked for is there once, whatever was answered meanwhile."""
    again = [_insist(lambda key=key: _submit(http, key)).json()["id"] for key in "123"]
    assert again == queued
    kept = {"Idempotency-Key": "again"}
    last = _insist(lambda: http.post("/v1/runs", json={"scenario": "S1"}, headers=kept)).json()["id"]
    _insist(
        lambda: http.post(
            "/v1/twins/u/vehicles", json={"start_pressure_bar": 50.5}, headers={"Idempotency-Key": "vehicle"}
        )
    )
    for job in (*queued, last):
        assert ended(http, f"/v1/runs/{job}")["state"] == "succeeded"
    runs = http.get("/v1/runs").json()["items"]
    assert len(runs) == 5  # the first, three that waited, and the one that many asked for under one key
    assert http.get("/v1/twins").json()["complete"]
    for twin in ("t", "u"):
        times = http.get(f"/v1/twins/{twin}/history?columns=time").json()["columns"]["time"]
        assert times == list(range(len(times)))
        events = _events(http, twin)
        assert [event["seq"] for event in events] == list(range(len(events)))
    added = [event for event in _events(http, "u") if event["kind"] == "vehicle_added"]
    assert len(added) == 1


def _events(http, twin):
    return http.get(f"/v1/twins/{twin}/events?limit=1000").json()["items"]


@pytest.mark.timed
@pytest.mark.slow
def test_a_frozen_postgresql_holds_nobody_up(postgres, tmp_path):
    with _service(postgres, tmp_path) as service:
        _frozen_under_load(postgres, service, 5.0)
        with postgres.frozen():
            assert service.stop() < 10
        assert service.process.returncode == 0
        assert not [line for line in service.said if "Traceback" in line]


@pytest.mark.timed
@pytest.mark.full
@pytest.mark.parametrize("executor", [Processes, pytest.param(OnDask, marks=pytest.mark.full)])
def test_a_postgresql_frozen_for_a_minute_loses_and_doubles_nothing(executor, tmp_path):
    if missing():
        pytest.skip(missing())
    made = executor(tmp_path) if executor is OnDask else executor()
    try:
        with closing(Postgres()) as server, _service(server, tmp_path / "data", made.executor) as service:
            _frozen_under_load(server, service, 60.0)
    finally:
        made.close()


@contextmanager
def _locked(path, how="BEGIN IMMEDIATE"):
    """Another process's write transaction."""
    with closing(sqlite3.connect(path, timeout=30, isolation_level=None)) as holder:
        holder.execute(how)
        yield
        holder.execute("ROLLBACK")


@pytest.mark.timed
def test_a_locked_sqlite_file_holds_nobody_up(tmp_path):
    service = RunningService(tmp_path, HRS_WORKERS="1")
    try:
        with httpx.Client(base_url=service.url, timeout=30, trust_env=False) as http:
            run = _insist(lambda: _submit(http, "0")).json()["id"]
            ended(http, f"/v1/runs/{run}")
            for twin in ("t", "u"):
                http.post("/v1/twins", json={"id": twin, "scenario": "S1", "at_end": "repeat"}).raise_for_status()
            queued = [_insist(lambda key=key: _submit(http, key)).json()["id"] for key in "123"]
            sent = int(http.get("/v1/twins/t").json()["samples"])
            with Stalls() as stalls, _locked(tmp_path / "hrs.db"):
                answers = awaited(load(service.url, _asked(run, sent + 1), 4.0, PER_S / slowness()))
            _check_bounded(answers, stalls.worst)
            assert {answer.status for answer in answers if answer.what in {"run", "runs", "series", "twins"}} == {200}
            wait_until(lambda: http.get("/readyz").status_code == 200)
            _check_whole(http, queued)
            with _locked(tmp_path / "hrs.db"):
                assert service.stop() < 10
            assert service.process.returncode == 0
    finally:
        service.kill()
