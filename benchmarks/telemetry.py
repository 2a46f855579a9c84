"""What subscribers see of a live twin: nothing lost, how late, and that a bad one harms nobody."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator

import numpy as np

from benchmarks.measure import Bar, Row
from benchmarks.served import Service, served

SUBSCRIBERS = 10
LATE = 0.99
"""Quantile of the lateness that bars are held against."""


class Subscriber:
    """A subscriber process."""

    def __init__(self, service: Service, twin: str, delay: float = 0.0) -> None:
        command = [sys.executable, "-m", "benchmarks.subscriber", service.zenoh, twin, str(delay)]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        if self.process.stdout is None or self.process.stdout.readline() != "ready\n":
            raise RuntimeError("a subscriber did not start")

    def result(self) -> tuple[list[int], list[float]]:
        """Numbers and lateness [s] of what it heard."""
        found = json.loads(self.process.communicate("\n", timeout=60)[0])
        return [seq for seq, _ in found], [late for _, late in found]


def lost(numbers: list[int]) -> int:
    """Samples missing between the first and the last heard."""
    return numbers[-1] - numbers[0] + 1 - len(set(numbers))


def crowd(speed: float, seconds: float, bar_ms: float) -> Iterator[Row]:
    """Ten subscribers at one twin."""
    with served() as service:
        service.request("POST", "/v1/twins", {"id": "bench", "scenario": "S1", "speed": speed, "at_end": "repeat"})
        subscribers = [Subscriber(service, "bench") for _ in range(SUBSCRIBERS)]
        time.sleep(seconds)
        results = [subscriber.result() for subscriber in subscribers]
    what = f"twin at {speed:g}x, {SUBSCRIBERS} subscribers, {seconds:g} s"
    heard = sum(len(numbers) for numbers, _ in results)
    yield Row(f"{what}: samples lost of {heard}", (float(sum(lost(numbers) for numbers, _ in results)),), "1",
              Bar("at most", 0))  # fmt: skip
    p99 = tuple(1000 * float(np.quantile(lateness, LATE)) for _, lateness in results)
    yield Row(f"{what}: p99 of sample to callback, each subscriber", p99, "ms", Bar("at most", bar_ms))


def disturbed(seconds: float) -> Iterator[Row]:
    """One subscriber frozen, one too slow, eight others, at 100x."""
    with served() as service:
        service.request("POST", "/v1/twins", {"id": "bench", "scenario": "S1", "speed": 100, "at_end": "repeat"})
        others = [Subscriber(service, "bench") for _ in range(SUBSCRIBERS - 2)]
        frozen, slow = Subscriber(service, "bench"), Subscriber(service, "bench", 0.02)
        frozen.process.send_signal(signal.SIGSTOP)
        time.sleep(seconds)
        late = service.request("GET", "/v1/twins/bench")["lateness_max_s"]
        _, stale = slow.result()
        results = [subscriber.result() for subscriber in others]
        frozen.process.kill()
        frozen.process.communicate()
    what = f"twin at 100x, one frozen and one slow subscriber, {seconds:g} s"
    missing = float(sum(lost(numbers) for numbers, _ in results))
    yield Row(f"{what}: samples the other {len(others)} lost", (missing,), "1", Bar("at most", 0))
    p99 = tuple(1000 * float(np.quantile(lateness, LATE)) for _, lateness in results)
    yield Row(f"{what}: p99 of sample to callback, each of the others", p99, "ms", Bar("at most", 100))
    yield Row(f"{what}: latest tick of the twin", (1000 * late,), "ms", Bar("at most", 100))
    behind = 1000 * float(np.quantile(stale, LATE))
    yield Row(f"{what}: p99 of the age of what the slow one sees (ring of one)", (behind,), "ms", Bar("at most", 100))


def many(twins: int, seconds: float, latest: Bar | None, share: Bar) -> Iterator[Row]:
    """Many live twins at 1x in one process; bars of the latest tick [ms] and of the server's CPU [cores]."""
    with served("--workers", "0") as service:
        for number in range(twins):
            request = {"id": f"bench-{number}", "scenario": "S1", "controller": "minlp1", "at_end": "repeat"}
            service.request("POST", "/v1/twins", request)
        time.sleep(2)
        cpu, began = service.cpu(), time.perf_counter()
        time.sleep(seconds)
        used = (service.cpu() - cpu) / (time.perf_counter() - began)
        states = service.request("GET", "/v1/twins")["items"]
    what = f"{twins} twins at 1x in one process, {seconds:g} s"
    yield Row(f"{what}: ticks more than 100 ms late", (float(sum(state["ticks_late"] for state in states)),), "1",
              Bar("at most", 0))  # fmt: skip
    yield Row(f"{what}: latest tick", (max(1000 * state["lateness_max_s"] for state in states),), "ms", latest)
    yield Row(f"{what}: CPU of the server", (used,), "cores", share)
