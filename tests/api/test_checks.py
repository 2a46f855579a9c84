"""Documents that cost much are checked within limits of time and memory, and no longer than somebody waits."""

from __future__ import annotations

import json
import os
import signal
import socket
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import httpx
import pytest

from tests.api.conftest import RunningService
from tests.pace import slowness
from tests.theory.test_hardening import LOOP, document, one
from tests.waiting import wait_until

SLOW_PROOF = {**LOOP, "edges": []}


def _unstable(word, constraint, modes=2, value="1"):
    return document([one("1")] * modes, constraint, {"kind": "unstable", "value": value, "word": word}, SLOW_PROOF)


AVERAGE = _unstable([1, 2], {"kind": "average", "tau": 900, "burst": 200})
"""200 000 levels of a bucket, from each of which a word of two letters is followed until the bucket is full."""

CHAIN = [[0, 1, 0], [0, 2, 0], *([node, mode, node + 1] for node in range(24) for mode in (1, 2) if node or mode == 1)]

SUBSETS = _unstable([1], {"kind": "graph", "initial": [0], "edges": CHAIN})
"""A graph of 25 nodes, in 2^24 sets of which a signal may be."""

NODES = document(
    [one("0.5")], {"kind": "arbitrary"}, {"kind": "infeasible", "value": "1"},
    {"nodes": 1, "edges": [[0, 1, 0]] * 290_000, "jumps": [], "denominator": 1, "multipliers": [[1]] * 290_000},
)  # fmt: skip
"""Of 3.5 MB: 290 000 edges."""

DENSE = document(
    [{"A": [[f"{i}.{'7' * 50}{j}" for j in range(16)] for i in range(16)]}], {"kind": "arbitrary"},
    {"kind": "unstable", "value": f"1.{'3' * 59}", "word": [1] * 3000}, SLOW_PROOF,
)  # fmt: skip
"""A product of 3000 matrices of long fractions: numbers of a million digits."""

HEAVY = {"subsets": SUBSETS, "dense": DENSE}

LIMITS = {"HRS_CHECK_CPU_S": "1", "HRS_CHECK_WALL_S": "30", "HRS_CHECKS_MAX": "2"}


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """A service whose checks may take a second."""
    running = RunningService(tmp_path_factory.mktemp("short"), "--workers", "0", **LIMITS)
    yield running
    running.stop()


@pytest.fixture(scope="module")
def asking(short):
    with httpx.Client(base_url=short.url, timeout=60, trust_env=False) as client:
        yield client


def _checks(service):
    """Checks of a service that are running: those with a limit of time."""
    found = []
    for line in service.group():
        pid = int(line.split()[0])
        if "api.jobs.check" in line:
            with suppress(FileNotFoundError, ProcessLookupError):  # one that has just ended
                limits = Path(f"/proc/{pid}/limits").read_text().splitlines()
                if not any(each.startswith("Max cpu time") and "unlimited" in each for each in limits):
                    found.append(pid)
    return found


@pytest.mark.slow
@pytest.mark.parametrize("name", HEAVY)
def test_a_document_that_takes_too_long_is_refused_and_nothing_is_said_of_it(asking, name):
    assert len(json.dumps(HEAVY[name])) < 2_000 or name == "dense"
    answer = asking.post("/v1/certificates/verify", json=HEAVY[name])
    assert answer.status_code == 422, answer.text
    problem = answer.json()
    assert problem["type"] == "urn:hrs-twin:problem:too-large"
    assert "check_cpu_s" in problem["detail"]
    assert "verified" not in problem


def test_one_of_four_megabytes_with_many_nodes_ends_in_time(asking):
    text = json.dumps(NODES, separators=(",", ":"))
    assert 3_000_000 < len(text) < 4_000_000
    began = time.monotonic()
    answer = asking.post("/v1/certificates/verify", content=text, headers={"content-type": "application/json"})
    assert answer.status_code in {200, 422}
    assert time.monotonic() - began < 20 * slowness()
    assert "true" not in answer.text


@pytest.mark.slow
def test_one_that_needs_too_much_memory_is_refused_alone_and_with_a_twin(tmp_path, proved):
    service = RunningService(tmp_path, "--workers", "0", HRS_CHECK_MEMORY_BYTES="16000000")
    good = document([one("0.5")], {"kind": "arbitrary"}, {"kind": "stability", "value": "1"}, LOOP)
    try:
        with httpx.Client(base_url=service.url, timeout=60, trust_env=False) as client:
            scenario = {**client.get("/v1/scenarios/S1").json(), "station": proved["station"]["parameters"]}
            twin = {"scenario": scenario, "controller": "reserve", "certificate": proved}
            for path, body in (("/v1/certificates/verify", AVERAGE), ("/v1/twins", twin)):
                answer = client.post(path, json=body)
                assert (answer.status_code, answer.json()["type"]) == (422, "urn:hrs-twin:problem:too-large")
                assert "check_memory_bytes" in answer.json()["detail"]
            assert client.get("/v1/twins").json()["items"] == []
            assert client.post("/v1/certificates/verify", json=good).json()["verified"] is True
    finally:
        service.stop()


@pytest.mark.slow
def test_only_so_many_are_checked_at_once_and_others_come_again(short, asking):
    def post(_):
        return httpx.post(f"{short.url}/v1/certificates/verify", json=AVERAGE, timeout=60, trust_env=False)

    with ThreadPoolExecutor(5) as pool:
        answers = list(pool.map(post, range(5)))
    kinds = sorted(answer.json()["type"].rpartition(":")[2] for answer in answers)
    assert set(kinds) == {"full", "too-large"}
    assert kinds.count("too-large") >= 2
    refused = next(answer for answer in answers if answer.status_code == 429)
    assert int(refused.headers["retry-after"]) > 0
    assert "checks_max" in refused.json()["detail"]
    assert asking.get("/livez").status_code == 200


@pytest.mark.slow
def test_a_process_that_dies_while_it_waits_costs_nobody_an_answer(short, asking):
    good = document([one("0.5")], {"kind": "arbitrary"}, {"kind": "stability", "value": "1"}, LOOP)
    for _ in range(2):
        waiting = [int(line.split()[0]) for line in short.group() if "api.jobs.check" in line]
        assert len(waiting) == 1
        os.kill(waiting[0], signal.SIGKILL)
        wait_until(lambda: not [line for line in short.group() if "api.jobs.check" in line])
        answer = asking.post("/v1/certificates/verify", json=good).json()
        assert answer.get("verified") is True, answer


@pytest.fixture
def long(tmp_path):
    """A service whose checks may take an hour."""
    running = RunningService(tmp_path, "--workers", "0", HRS_CHECK_CPU_S="3600", HRS_CHECK_WALL_S="3600")
    yield running
    if running.process.poll() is None:
        running.stop()


def _send(service):
    """A connection on which a check was asked for that takes minutes, once it runs."""
    body = json.dumps(AVERAGE).encode()
    head = f"POST /v1/certificates/verify HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: {len(body)}\r\n"
    connection = socket.create_connection(("127.0.0.1", service.port), 10)
    connection.sendall(head.encode() + b"Content-Type: application/json\r\n\r\n" + body)
    wait_until(lambda: _checks(service))
    return connection


def test_a_check_ends_when_its_client_goes(long):
    with _send(long):
        assert len(_checks(long)) == 1
    wait_until(lambda: not _checks(long))
    with _send(long):  # and there is room for others
        assert len(_checks(long)) == 1


def test_a_check_ends_with_sigterm(long):
    with _send(long) as connection:
        took = long.stop()
        assert took < 10
        assert long.group() == []
        assert connection.recv(1000).startswith((b"HTTP/1.1 503", b""))


def test_a_check_ends_with_a_server_that_is_killed(long):
    with _send(long):
        os.kill(long.process.pid, signal.SIGKILL)
        long.process.wait(10)
        wait_until(lambda: not [line for line in long.group() if "api.jobs.check" in line])
