"""Everybody who asks the service for something: clients who want results, and those who operate twins."""

from __future__ import annotations

import random
import threading
from collections.abc import Callable
from contextlib import closing

import httpx

from tests.nemesis.arena import PATIENCE_S, LostError
from tests.nemesis.client import Client
from tests.nemesis.history import History
from tests.nemesis.operators import TWINS, host, send, start, steer
from tests.nemesis.requests import a_comparison, a_run

PACE_S = 0.25
"""A client thinks so long between two requests on the average [s]."""

OPEN_MAX = 12
"""Jobs that wait at once: a client holds back rather than let them pile up."""

Work = Callable[[Client, random.Random, threading.Event], None]
"""What a client does until it is told to end."""


class Clients:
    """Threads that ask the service for things, until they are told to stop."""

    def __init__(self, url: str, history: History, seed: int) -> None:
        self._url = url
        self._history = history
        self._seed = seed
        self.ending = threading.Event()
        self.failures: list[str] = []
        self._threads = [
            threading.Thread(target=self._guarded, args=(work, number), name=work.__name__)
            for number, work in enumerate((submit, submit, send, steer, host))
        ]

    def start(self) -> None:
        """Start the twins, then everybody."""
        with closing(Client(self._url, self._history)) as client:
            for twin in TWINS:
                start(client, twin, f"twin-{twin}")
        for thread in self._threads:
            thread.start()

    def stop(self) -> None:
        """Let everybody come to the end of what they ask."""
        self.ending.set()
        for thread in self._threads:
            thread.join(2 * PATIENCE_S)
            if thread.is_alive():
                raise LostError(f"client {thread.name} still waits for an answer")
        if self.failures:
            raise LostError("; ".join(self.failures))

    def _guarded(self, work: Work, number: int) -> None:
        try:
            with closing(Client(self._url, self._history)) as client:
                work(client, random.Random(f"{self._seed}/{number}"), self.ending)
        except (AssertionError, KeyError, ValueError) as error:
            self.failures.append(repr(error))


def submit(client: Client, chance: random.Random, ending: threading.Event) -> None:
    """Runs and comparisons; some are asked for twice under one key, some are cancelled."""
    name, number = chance.randbytes(4).hex(), 0
    while not ending.is_set():
        path, request = (
            ("/v1/runs", a_run(chance)) if chance.random() < 0.8 else ("/v1/comparisons", a_comparison(chance))
        )
        key = f"{name}-{number}"
        number += 1
        place = client.post(key, path, request)
        if chance.random() < 0.15:
            client.post(key, path, request)
        if chance.random() < 0.1:
            _cancel(client, place)
        _hold_back(client, path, ending)
        ending.wait(chance.expovariate(1 / PACE_S))


def _cancel(client: Client, place: str) -> None:
    client.until("cancel", lambda: client.http.post(f"{place}/cancel"), id=place.rpartition("/")[2])


def _hold_back(client: Client, path: str, ending: threading.Event) -> None:
    """Wait while there is much to do."""
    while not ending.is_set():
        try:
            listed = client.http.get(path, params={"limit": OPEN_MAX}).json()["items"]
            if sum(job["finished"] is None for job in listed) < OPEN_MAX:
                return
        except (httpx.HTTPError, KeyError, ValueError):
            pass
        ending.wait(PACE_S)
