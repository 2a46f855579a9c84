"""Jobs and runs a second: by worker processes of this machine, and by a Dask cluster of two workers on it."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from tempfile import TemporaryDirectory
from typing import Any

from benchmarks.measure import Row
from benchmarks.served import Service, free_port, served

COMPARED = "S3", "logic"
"""Scenario and controller of the comparison."""


def rows(count: int) -> Iterator[Row]:
    """Jobs of one run of S1, and runs of one comparison, a second: by processes here, and by a cluster of two."""
    for workers in (1, 2):
        with served("--workers", str(workers)) as service:
            yield from _throughput(service, count, f"{workers} worker{'s' if workers > 1 else ''}")
    with cluster(2) as address, served("--executor", f"dask://{address}") as service:
        yield from _throughput(service, count, "Dask, 2 workers")


def _throughput(service: Service, count: int, who: str) -> Iterator[Row]:
    ended(service, [post(service, "S1", "logic") for _ in range(4)])
    rates = []
    for _ in range(3):
        began = time.perf_counter()
        ended(service, [post(service, "S1", "logic") for _ in range(count)])
        rates.append(count / (time.perf_counter() - began))
    yield Row(f"{who}: jobs of one run of S1, from the first POST to the last end", tuple(rates), "jobs/s")
    scenario, controller = COMPARED
    asked = {"scenarios": [scenario], "controllers": [controller], "replications": 10 * count}
    began = time.perf_counter()
    job = service.request("POST", "/v1/comparisons", asked)
    while (job := service.request("GET", f"/v1/comparisons/{job['id']}"))["finished"] is None:
        time.sleep(0.02)
    if job["state"] != "succeeded":
        raise RuntimeError(f"the comparison has {job['state']}")
    rate = 10 * count / (time.perf_counter() - began)
    yield Row(f"{who}: runs of {scenario} with {controller} in one comparison of {10 * count}", (rate,), "runs/s")


def post(service: Service, scenario: str, controller: str) -> dict[str, Any]:
    """A run, as it was accepted."""
    job: dict[str, Any] = service.request("POST", "/v1/runs", {"scenario": scenario, "controller": controller})
    return job


def ended(service: Service, jobs: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """The runs as they are when all have ended, which they must well; asked in turn, the last first."""
    ended = []
    for job in reversed(jobs):
        while (now := service.request("GET", f"/v1/runs/{job['id']}"))["finished"] is None:
            time.sleep(0.01)
        if now["state"] != "succeeded":
            raise RuntimeError(f"a run has {now['state']}")
        ended.append(now)
    return ended


@contextmanager
def cluster(workers: int) -> Iterator[str]:
    """A Dask scheduler and workers of one thread on this machine; its address."""
    address = f"127.0.0.1:{free_port()}"
    host, port = address.split(":")
    with TemporaryDirectory() as folder:

        def start(*command: str) -> subprocess.Popen[bytes]:
            quiet = subprocess.DEVNULL
            return subprocess.Popen([sys.executable, "-m", *command], cwd=folder, stdout=quiet, stderr=quiet)

        scheduler = start("distributed.cli.dask_scheduler", "--host", host, "--port", port, "--no-dashboard")
        there = [
            start("distributed.cli.dask_worker", f"tcp://{address}", "--nthreads", "1", "--no-dashboard")
            for _ in range(workers)
        ]
        try:
            yield address
        finally:
            for process in (*there, scheduler):
                process.terminate()
                process.wait(30)
