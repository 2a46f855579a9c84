"""Clients who do not give up: each sends its request until it is answered, and notes what it was told."""

from __future__ import annotations

import json
import random
import threading
import time
from collections.abc import Callable
from http import HTTPStatus
from typing import Any

import httpx

from tests.nemesis.arena import PATIENCE_S, LostError
from tests.nemesis.history import History

TWINS = ("calm", "hasty")
SPEEDS = {"calm": 8, "hasty": 40}
"""Simulated seconds a second: the one is seen whole on the event stream, the other is not."""

PACE_S = 0.25
"""A client thinks so long between two requests on the average [s]."""

OPEN_MAX = 12
"""Jobs that wait at once: a client holds back rather than let them pile up."""

CONTROLLERS = ("logic", "minlp1", "minlp1:horizon=2", "minlp3")

Request = dict[str, Any]

Post = Callable[[str, Request], None]


def few(count: int, seed: int) -> Request:
    """A scenario of a few vehicles: some milliseconds of work, some kilobytes of record."""
    arrivals = {"kind": "uniform", "count": count, "period_s": 300.0 * count}
    return {"name": f"few-{count}-{seed}", "arrivals": arrivals}


def a_run(chance: random.Random) -> Request:
    """A run; one of some dozens, so that the same is asked for again and again."""
    scenario = few(chance.randint(1, 3), 0)
    return {
        "scenario": scenario, "controller": chance.choice(CONTROLLERS), "replication": chance.randint(0, 3),
        "seed": chance.randint(0, 1),
    }  # fmt: skip


def a_comparison(chance: random.Random) -> Request:
    """A comparison of some chunks; some of them last for seconds."""
    scenarios = [few(count, 0) for count in (1, 3)]
    controllers = ["logic", chance.choice(["minlp1:horizon=2", "minlp1:horizon=3"])]
    return {
        "scenarios": scenarios, "controllers": controllers, "replications": chance.choice([2, 8, 24]),
        "seed": chance.randint(0, 1),
    }  # fmt: skip


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
            for number, work in enumerate((self._submit, self._submit, self._operate))
        ]

    def start(self) -> None:
        """Start the twins, then everybody."""
        with self._http() as http:
            for twin in TWINS:
                self._post(http, f"twin-{twin}", "/v1/twins", a_twin(twin))
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

    def _http(self) -> httpx.Client:
        return httpx.Client(base_url=self._url, timeout=10, trust_env=False)

    def _guarded(self, work: Callable[[httpx.Client, random.Random], None], number: int) -> None:
        try:
            with self._http() as http:
                work(http, random.Random(f"{self._seed}/{number}"))
        except (AssertionError, KeyError, ValueError) as error:
            self.failures.append(repr(error))

    def _submit(self, http: httpx.Client, chance: random.Random) -> None:
        """Runs and comparisons; some are asked for twice under one key, some are cancelled."""
        name, number = chance.randbytes(4).hex(), 0
        while not self.ending.is_set():
            path, request = (
                ("/v1/runs", a_run(chance)) if chance.random() < 0.8 else ("/v1/comparisons", a_comparison(chance))
            )
            key = f"{name}-{number}"
            number += 1
            place = self._post(http, key, path, request)
            if chance.random() < 0.15:
                self._post(http, key, path, request)
            if chance.random() < 0.1:
                self._cancel(http, place)
            self._hold_back(http, path)
            self.ending.wait(chance.expovariate(1 / PACE_S))

    def _cancel(self, http: httpx.Client, place: str) -> None:
        self._until(http, "cancel", lambda: http.post(f"{place}/cancel"), id=place.rpartition("/")[2])

    def _hold_back(self, http: httpx.Client, path: str) -> None:
        """Wait while there is much to do."""
        while not self.ending.is_set():
            try:
                listed = http.get(path, params={"limit": OPEN_MAX}).json()["items"]
                if sum(job["finished"] is None for job in listed) < OPEN_MAX:
                    return
            except (httpx.HTTPError, KeyError, ValueError):
                pass
            self.ending.wait(PACE_S)

    def _operate(self, http: httpx.Client, chance: random.Random) -> None:
        """Vehicles arrive at the twins."""
        number = 0
        while not self.ending.is_set():
            twin = chance.choice(TWINS)
            self._post(
                http, f"vehicle-{number}", f"/v1/twins/{twin}/vehicles",
                {"start_pressure_bar": 100 + number / 64},  # by which its event is known
            )  # fmt: skip
            number += 1
            self.ending.wait(chance.expovariate(0.25 / PACE_S))

    def _post(self, http: httpx.Client, key: str, path: str, request: Request) -> str:
        """Ask for something under a key until it is there; its place."""
        self._history.note("asked", key=key, path=path, request=request)
        headers = {"idempotency-key": key}
        answer = self._until(http, "acknowledged", lambda: http.post(path, json=request, headers=headers), key=key)
        return answer.headers["location"]

    def _until(self, http: httpx.Client, what: str, ask: Callable[[], httpx.Response], **about: Any) -> httpx.Response:
        """Ask again and again until the answer is good; anything but a server in trouble is a failure."""
        end = time.monotonic() + PATIENCE_S
        last = ""
        while time.monotonic() < end:
            try:
                answer = ask()
            except httpx.HTTPError as error:
                last = repr(error)
            else:
                last = f"{answer.status_code} {answer.text:.300}"
                if answer.is_success:
                    self._history.note(what, status=answer.status_code, body=answer.text, **about)
                    return answer
                self._history.note("refused", status=answer.status_code, body=answer.text, **about)
                if answer.status_code not in TROUBLE:
                    raise LostError(f"{about}: {last}")
            time.sleep(0.1)
        raise LostError(f"{about}: no good answer within {PATIENCE_S:g} s, the last one {last}")


TROUBLE = (HTTPStatus.SERVICE_UNAVAILABLE, HTTPStatus.CONFLICT, HTTPStatus.TOO_MANY_REQUESTS)
"""What a service in trouble may answer: 503, 409 while the first request is answered, 429 when it is busy.

500 is none of them: whatever is done to it, the service knows what is the matter.
"""


def a_twin(name: str) -> Request:
    """A twin that never comes to an end by itself."""
    return {
        "id": name, "scenario": few(3, 0), "controller": "minlp1", "speed": SPEEDS[name], "at_end": "repeat",
    }  # fmt: skip


class Stream:
    """A browser on a twin's event stream, which comes again with Last-Event-ID whenever it is cut off."""

    def __init__(self, url: str, twin: str, history: History) -> None:
        self._url, self._twin, self._history = url, twin, history
        self._ending = threading.Event()
        self._last = ""
        self.seen = -1  # number of the last event
        self._thread = threading.Thread(target=self._run, name=f"stream of {twin}", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """Hear no more."""
        self._ending.set()
        self._thread.join(PATIENCE_S)

    def _run(self) -> None:
        while not self._ending.is_set():
            headers = {"last-event-id": self._last} if self._last else {}
            path = f"{self._url}/v1/twins/{self._twin}/stream"
            try:
                with httpx.stream("GET", path, headers=headers, timeout=5, trust_env=False) as answer:
                    if answer.is_success:
                        self._history.note("connected", twin=self._twin, after=self._last)
                        self._listen(answer)
            except httpx.HTTPError:
                pass
            self._ending.wait(0.1)

    def _listen(self, answer: httpx.Response) -> None:
        fields: dict[str, str] = {}
        for line in answer.iter_lines():
            if self._ending.is_set():
                return
            if line:
                name, _, value = line.partition(": ")
                fields[name] = value
                continue
            if "data" in fields:
                self._history.note(f"streamed {fields.get('event', '')}", document=json.loads(fields["data"]))
                self._last = fields["id"]
                if fields["event"] == "event":
                    self.seen = json.loads(fields["data"])["seq"]
            fields = {}
