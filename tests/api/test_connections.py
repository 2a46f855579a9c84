"""Clients that send half a request, too much of one, or take no answer: they are shown out, and others are served."""

from __future__ import annotations

import json
import os
import signal
import socket
import time
from contextlib import ExitStack, suppress

import httpx
import pytest

from api.server.connections import connections_max
from api.settings import Settings
from tests.api.conftest import RunningService
from tests.pace import slowness
from tests.waiting import wait_until

ROOM = connections_max(Settings(), 1024)
ASKED = "GET /livez HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
HEAD = "POST /v1/runs HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\n"


@pytest.fixture(scope="module")
def hasty(tmp_path_factory):
    """A service with short deadlines that may open 1024 files."""
    limits = {"headers_max_s": "2", "idle_max_s": "2", "unread_max_s": "3", "body_rate_min": "5000"}
    variables = {f"HRS_{name.upper()}": value for name, value in limits.items()}
    service = RunningService(tmp_path_factory.mktemp("hasty"), "--workers", "0", prefix=FEW_FILES, **variables)
    yield service
    service.stop()


@pytest.fixture
def few_files(tmp_path):
    """A service that may open 1024 files and waits a minute for who sends half a request."""
    service = RunningService(tmp_path, "--workers", "0", prefix=FEW_FILES, HRS_HEADERS_MAX_S="60")
    yield service
    service.stop()


FEW_FILES = ("/bin/sh", "-c", 'ulimit -n 1024; exec "$0" "$@"')


def _connected(service, text=""):
    made = socket.create_connection(("127.0.0.1", service.port), 10)
    made.sendall(text.encode())
    made.settimeout(10)
    return made


def _is_answered(connection):
    """Whether the answer to ASKED comes."""
    said = b""
    with suppress(ConnectionResetError):
        while not said.endswith(b"}") and (piece := connection.recv(4096)):
            said += piece
    return b" 200 " in said[:20]


def _rest(connection):
    """Everything that comes until the connection ends."""
    said = b""
    with suppress(ConnectionResetError):
        while piece := connection.recv(65536):
            said += piece
    return said


@pytest.mark.slow
@pytest.mark.parametrize("begun", [HEAD[:50], HEAD, HEAD + "Content-Length: 9\r\n\r\n{", "\r\n", "G"])
def test_who_stops_in_the_middle_is_told_and_shown_out(hasty, begun):
    began = time.monotonic()
    with _connected(hasty, begun) as made:
        said = _rest(made)
    assert 1.5 < time.monotonic() - began < 8
    assert said.startswith(b"HTTP/1.1 408 ")
    assert b"urn:hrs-twin:problem:timeout" in said


@pytest.mark.slow
def test_who_says_nothing_is_shown_out(hasty):
    began = time.monotonic()
    with _connected(hasty) as made:
        assert _rest(made) == b""
    with _connected(hasty, "GET /livez HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n") as made:
        assert b'"alive"' in _rest(made)
    assert 3 < time.monotonic() - began < 12


@pytest.mark.slow
def test_nobody_is_late_by_what_the_service_stood_still_for(hasty):
    ask = "GET /livez HTTP/1.1\r\nHost: 127.0.0.1\r\n"
    with ExitStack() as open_ones:
        made = [open_ones.enter_context(_connected(hasty, begun)) for begun in ("", ask) for _ in range(5)]
        time.sleep(0.5)
        os.kill(hasty.process.pid, signal.SIGSTOP)
        time.sleep(4.0)  # twice what headers may take
        os.kill(hasty.process.pid, signal.SIGCONT)
        time.sleep(0.2)  # the deadlines are looked at first
        for number, each in enumerate(made):
            rest = ask if number < 5 else ""
            each.sendall(f"{rest}Connection: close\r\n\r\n".encode())
        assert {_rest(each).split(b"\r\n")[0] for each in made} == {b"HTTP/1.1 200 OK"}


def _drips(connection, drop):
    """Send a little again and again; how long it took to be cut off [s]."""
    began = time.monotonic()
    with suppress(BrokenPipeError, ConnectionResetError):
        while time.monotonic() - began < 15:
            connection.sendall(drop)
            time.sleep(0.1)
    return time.monotonic() - began


@pytest.mark.slow
@pytest.mark.parametrize(
    ("head", "drop"), [(HEAD, b"x: 1\r\n"), (HEAD + "Content-Length: 100000\r\n\r\n", b" "), ("", b"\r\n")]
)
def test_dripping_does_not_help(hasty, head, drop):
    with _connected(hasty, head) as made:
        assert 1.5 < _drips(made, drop) < 12


@pytest.mark.slow
def test_a_slow_body_above_the_least_rate_is_taken(hasty):
    body = b'"S1"'.ljust(30_000)
    head = HEAD.replace("runs", "scenarios/resolve") + f"Content-Length: {len(body)}\r\n\r\n"
    with _connected(hasty, head) as made:
        for begin in range(0, len(body), 2000):
            made.sendall(body[begin : begin + 2000])
            time.sleep(0.25)
        assert made.recv(100).startswith(b"HTTP/1.1 200 ")


@pytest.mark.parametrize(
    "head",
    [
        "GET /" + "x" * 70_000 + " HTTP/1.1\r\n", "GET / HTTP/1.1\r\nx: " + "x" * 70_000,
        "GET / HTTP/1.1\r\n" + "x: 1\r\n" * 200, "GET / HTTP/1.1\r\n" + "x" * 70_000,
    ],
)  # fmt: skip
def test_large_headers_are_refused(hasty, head):
    with _connected(hasty) as made:
        with suppress(BrokenPipeError, ConnectionResetError):
            made.sendall(head.encode())
        said = _rest(made)
    assert said == b"" or said.startswith(b"HTTP/1.1 431 ")  # a reset may overtake the answer
    assert hasty.process.poll() is None


def test_a_flood_of_pipelined_requests_ends_the_connection(hasty):
    with _connected(hasty) as made:
        with suppress(BrokenPipeError, ConnectionResetError):
            made.sendall(b"GET /livez HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n" * 5_000)
        assert _rest(made).count(b"HTTP/1.1 200") < 5_000


def _deaf(service):
    """A client that asks for more than the system takes on its behalf, and reads nothing of it."""
    vehicles = [{"time_s": float(k), "start_pressure_bar": 120.0} for k in range(20_000)]
    scenario = {"name": "x", "about": "x", "arrivals": {"kind": "trace", "vehicles": vehicles}, "time_limit_s": 6e5}
    body = json.dumps(scenario)
    asked = HEAD.replace("runs", "scenarios/resolve") + f"Content-Length: {len(body)}\r\n\r\n" + body
    made = _connected(service)
    made.settimeout(3)
    with suppress(TimeoutError, ConnectionError):  # it may be cut off while it asks
        for _ in range(12):
            made.sendall(asked.encode())
    return made


@pytest.mark.slow
def test_who_does_not_read_is_cut_off_and_an_event_stream_is_not(hasty):
    with httpx.Client(base_url=hasty.url, timeout=30, trust_env=False) as http:
        twin = {"id": "calm", "scenario": "S1", "controller": "logic", "at_end": "repeat"}
        assert http.post("/v1/twins", json=twin).status_code == 201
        with http.stream("GET", "/v1/twins/calm/stream", timeout=30) as calm:
            lines = calm.iter_lines()
            deaf = _deaf(hasty)
            until = time.monotonic() + 8
            told = 0
            while time.monotonic() < until:
                told += next(lines).startswith("event: sample")
            assert told >= 4
        name = 'hrs_connections_ended_total{reason="unread"}'
        wait_until(lambda: name in http.get("/metrics").text, 20)
        deaf.close()
        http.post("/v1/twins/calm/stop")


@pytest.mark.timed
def test_two_thousand_half_sent_requests_leave_room(few_files):
    waits, half = [], []
    for k in range(2000):
        half.append(_connected(few_files, HEAD if k % 2 else HEAD + "Content-Length: 100000\r\n\r\n{"))
        if k % 100 == 99:
            began = time.monotonic()
            assert httpx.get(f"{few_files.url}/livez", trust_env=False, timeout=10).status_code == 200
            assert httpx.get(f"{few_files.url}/v1/twins", trust_env=False, timeout=10).status_code == 200
            waits.append(time.monotonic() - began)
    for each in half:
        each.close()
    assert sorted(waits)[len(waits) // 2] < 1.0 * slowness()
    told = httpx.get(f"{few_files.url}/metrics", trust_env=False).text
    assert 'hrs_connections_ended_total{reason="room"}' in told
    assert not any("Too many open files" in line for line in few_files.said)


def test_a_flood_of_half_sent_requests_ends_nobody_who_was_answered(few_files):
    known = _connected(few_files, ASKED)
    assert _is_answered(known)
    half = [_connected(few_files, HEAD) for _ in range(2 * ROOM)]
    known.sendall(ASKED.encode())
    assert _is_answered(known)
    told = httpx.get(f"{few_files.url}/metrics", trust_env=False).text
    assert 'hrs_connections_ended_total{reason="room"}' in told
    for each in (known, *half):
        each.close()


def test_those_who_were_answered_leave_room_for_others(few_files):
    """As many as there is room for, that ask for nothing more; then strangers, of whom one is slow."""
    known = [_connected(few_files, ASKED) for _ in range(ROOM)]
    assert all(_is_answered(each) for each in known)
    slow = _connected(few_files, ASKED[:-2])
    half = [_connected(few_files, HEAD) for _ in range(ROOM // 4)]
    slow.sendall(ASKED[-2:].encode())
    assert _is_answered(slow)
    for each in (slow, *known, *half):
        each.close()


def test_connections_leave_files_to_the_store():
    assert connections_max(Settings(), 1024) == 640
    assert connections_max(Settings(), 256) == 64
    assert connections_max(Settings(), 65_536) == 10_000
    assert connections_max(Settings(connections_max=50), 65_536) == 50
