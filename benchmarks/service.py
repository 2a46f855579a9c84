"""What the service promises: start, requests, kills, live twins. `hrs bench --service`."""

from __future__ import annotations

import http.client
import os
import random
import signal
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import telemetry
from benchmarks.measure import Bar, Row
from benchmarks.served import Service, served

_KILLS = 30
_SCENARIOS = ("S1", "S2", "S3", "S4")


def rows(*, long: bool, database: str | None) -> Iterator[Row]:
    """Every promise in turn; `database` names a PostgreSQL database that may be filled."""
    yield from start_and_stop(5)
    yield from requests(2000)
    yield from kills("SQLite", None)
    if database is not None:
        yield from kills("PostgreSQL", database)
    yield from telemetry.crowd(100, 120 if long else 20, 100)
    yield from telemetry.disturbed(60 if long else 15)
    yield from telemetry.many(20, 300 if long else 30, None, Bar("at most", 0.5))
    yield from telemetry.crowd(1, 600 if long else 30, 50)


def start_and_stop(repeats: int) -> Iterator[Row]:
    """From the shell to the first answer, and from SIGTERM to the end with a stream open."""
    started, stopped = [], []
    with tempfile.TemporaryDirectory() as data:
        for _ in range(repeats):
            service = Service(data, "--demo")
            started.append(service.start())
            time.sleep(2)
            stream = http.client.HTTPConnection("127.0.0.1", service.port, timeout=10)
            stream.request("GET", "/v1/twins/demo/stream")
            stream.getresponse().read(10)
            stopped.append(service.stop())
            stream.close()
    yield Row("service: from the shell to its first answer", tuple(started), "s", Bar("at most", 4))
    yield Row("service: from SIGTERM to its end, a stream open", tuple(stopped), "s", Bar("at most", 3))


def requests(count: int) -> Iterator[Row]:
    """GET of a run that has ended, one connection and one request after the other."""
    with served("--workers", "1") as service:
        path = f"/v1/runs/{_ended(service, '/v1/runs', {'scenario': 'S1', 'controller': 'minlp1'})['id']}"
        connection = http.client.HTTPConnection("127.0.0.1", service.port)
        rates, slow = [], []
        for _ in range(5):
            times = []
            for _ in range(count):
                before = time.perf_counter()
                connection.request("GET", path)
                answer = connection.getresponse()
                answer.read()
                if answer.status != http.HTTPStatus.OK:
                    raise RuntimeError(f"{path} answered {answer.status}")
                times.append(time.perf_counter() - before)
            rates.append(count / sum(times))
            slow.append(1000 * float(np.quantile(times, 0.99)))
        connection.close()
    yield Row("GET /v1/runs/{id}, one connection", tuple(rates), "requests/s", Bar("at least", 800))
    yield Row("GET /v1/runs/{id}, p99", tuple(slow), "ms")


def kills(name: str, database: str | None) -> Iterator[Row]:
    """Kill server and workers while 16 runs are compared, again and again; the results against undisturbed ones."""
    request = {"scenarios": list(_SCENARIOS), "replications": 1, "seed": 0}
    options = ("--database", database) if database else ()
    with served() as service:
        job = _ended(service, "/v1/comparisons", request)
        expected = _results(service, job["id"])
    chance = random.Random(0)  # noqa: S311  # when to kill
    killed, right = 0, 0.0
    with tempfile.TemporaryDirectory() as data:
        service = Service(data, *options)
        service.start()
        while killed < _KILLS:
            path = f"/v1/comparisons/{service.request('POST', '/v1/comparisons', request)['id']}"
            while killed < _KILLS and service.request("GET", path)["finished"] is None:
                time.sleep(chance.uniform(0.0, 0.4))
                if chance.random() < 0.5:
                    service.kill()
                    service.start()
                else:
                    _kill_a_worker(service, chance)
                killed += 1
            while service.request("GET", path)["finished"] is None:
                time.sleep(0.05)
            right += _results(service, path.rpartition("/")[2]) != expected
        service.stop()
    yield Row(f"{name}: comparisons of 16 runs through {killed} kills -9 that differ from undisturbed", (right,), "1",
              Bar("at most", 0))  # fmt: skip


def _kill_a_worker(service: Service, chance: random.Random) -> None:
    """A process two generations below the server: the fork server's children are the workers."""
    parents = {
        int(fields[0]): int(fields[1])
        for stat in Path("/proc").glob("[0-9]*/stat")
        if (fields := _ids(stat)) is not None
    }
    forkers = [pid for pid, parent in parents.items() if parent == service.process.pid]
    workers = [pid for pid, parent in parents.items() if parent in forkers]
    if workers:
        victim = Path(f"/proc/{chance.choice(workers)}")
        if victim.exists():
            os.kill(int(victim.name), signal.SIGKILL)


def _ids(stat: Path) -> tuple[str, str] | None:
    try:
        return stat.parent.name, stat.read_text().rpartition(")")[2].split()[1]
    except OSError:
        return None  # it has just ended


def _ended(service: Service, path: str, request: dict[str, Any]) -> Any:
    job = service.request("POST", path, request)
    while job["finished"] is None:
        time.sleep(0.05)
        job = service.request("GET", f"{path}/{job['id']}")
    return job


def _results(service: Service, comparison: str) -> Any:
    return service.request("GET", f"/v1/comparisons/{comparison}/results")
