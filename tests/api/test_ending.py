"""SIGTERM ends the service within 10 s whatever it does, and everything that it has started."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import sqlite3
import time

import httpx
import pytest

from tests.api.conftest import RunningService

STOP_MAX_S = 10.0


@pytest.fixture
def service(tmp_path):
    """A service that is gone after the test, however that ends: it computes for hours."""
    running = RunningService(tmp_path)
    yield running
    with contextlib.suppress(ProcessLookupError):
        os.killpg(running.process.pid, signal.SIGKILL)


def _connected(service, request):
    made = socket.create_connection(("127.0.0.1", service.port), 10)
    made.sendall(request.encode())
    return made


def _get(path):
    return f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"


def _busy(service):
    """Open streams, half-sent requests, answers nobody reads, a proof, and workers that compute."""
    slow = {"scenario": "S4", "controller": "minlp1:horizon=10:node_limit=1000000000"}
    twin = {"id": "live", "scenario": "S1", "controller": "logic", "at_end": "repeat", "speed": "max"}
    with httpx.Client(base_url=service.url, timeout=120, trust_env=False) as http:
        for _ in range(2):
            path = http.post("/v1/runs", json=slow).headers["location"]
        while http.get(path).json()["state"] == "queued":
            time.sleep(0.05)
        assert http.post("/v1/twins", json=twin).status_code == 201
        assert http.post("/v1/controllers/reserve/certificate").status_code == 202
    half = (
        "POST /v1/runs HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\nContent-Length: 100000\r\n\r\n{"
    )
    opened = [_connected(service, _get("/v1/twins/live/stream")) for _ in range(5)]
    opened += [_connected(service, half) for _ in range(20)]
    opened += [_connected(service, half[:40]) for _ in range(20)]
    opened += [_connected(service, _get("/openapi.json") * 12) for _ in range(5)]
    return opened


def _ends(service):
    took = service.stop()
    assert took < STOP_MAX_S
    until = time.monotonic() + 2.0
    while service.group() and time.monotonic() < until:
        time.sleep(0.05)
    assert service.group() == []


@pytest.mark.slow
def test_a_busy_service_ends_in_time(service):
    opened = _busy(service)
    _ends(service)
    assert service.process.returncode == 0
    for each in opened:
        each.close()


def test_a_service_whose_store_is_locked_ends_in_time(service, tmp_path):
    opened = _busy(service)
    holder = sqlite3.connect(tmp_path / "hrs.db", isolation_level=None)
    holder.execute("BEGIN IMMEDIATE")
    time.sleep(0.5)
    _ends(service)
    holder.close()
    for each in opened:
        each.close()


@pytest.mark.slow
def test_a_stopped_service_has_its_twins_again(service):
    opened = _busy(service)
    with httpx.Client(base_url=service.url, timeout=120, trust_env=False) as http:
        before = http.get("/v1/twins/live").json()["samples"]
    _ends(service)
    for each in opened:
        each.close()
    service.start()
    with httpx.Client(base_url=service.url, timeout=120, trust_env=False) as http:
        assert json.loads(http.get("/v1/twins/live").text)["samples"] >= before
    _ends(service)
