"""Everything at once: floods of errors, half-sent requests, clients that do not read; probes and live twins go on."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path

import httpx
import pytest

from tests.api.conftest import RunningService
from tests.api.test_bodies import FLOODS
from tests.api.test_connections import FEW_FILES, HEAD

PROBER = Path(__file__).with_name("prober.py")
PATHS = {"wrong matrices": "certificates", "edges": "certificates", "controllers": "comparisons"}
TWINS = 4


class Attack:
    """Threads that do all of it until the end."""

    def __init__(self, service):
        self._service = service
        self._floods = {name: content() for name, content in FLOODS.items()}
        self._ending = threading.Event()
        self.answered = 0
        work = [self._flood, self._flood, self._half_send, self._drip, self._pipeline, self._deafen]
        self._threads = [threading.Thread(target=self._over_and_over, args=(each,)) for each in work]

    def __enter__(self):
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_error):
        self._ending.set()
        for thread in self._threads:
            thread.join()

    def _over_and_over(self, what):
        while not self._ending.is_set():
            opened: list[socket.socket] = []
            try:
                with suppress(OSError, httpx.TransportError):
                    what(opened)
            finally:
                for made in opened:
                    made.close()

    def _connect(self, opened, count=1):
        for _ in range(count):
            opened.append(socket.create_connection(("127.0.0.1", self._service.port), 10))
        return opened[-1]

    def _flood(self, _opened):
        with httpx.Client(base_url=self._service.url, timeout=60, trust_env=False) as http:
            for name, content in self._floods.items():
                if self._ending.is_set():
                    return
                path = "scenarios/trace" if "trace" in name else PATHS.get(name, "runs")
                answer = http.post(f"/v1/{path}", content=content, headers={"content-type": "application/json"})
                assert len(answer.content) <= 64_000
                self.answered += 1

    def _half_send(self, opened):
        for number in range(2000):
            made = self._connect(opened)
            made.sendall(HEAD.encode() if number % 2 else f"{HEAD}Content-Length: 100000\r\n\r\n{{".encode())
        self._ending.wait(10)

    def _drip(self, opened):
        self._connect(opened, 50)
        while not self._ending.wait(0.2):
            for number, made in enumerate(opened):
                made.sendall(b"x: 1\r\n" if number % 2 else b"\r\n")

    def _pipeline(self, opened):
        self._connect(opened).sendall(b"GET /v1/scenarios HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n" * 5000)
        self._ending.wait(0.5)

    def _deafen(self, opened):
        self._connect(opened, 20)
        for made in opened:
            made.settimeout(1)
            made.sendall(b"GET /openapi.json HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n" * 14)
        self._ending.wait(5)


def _attacked(folder, seconds):
    """What a prober waited [s], the twins behind it, and how many floods were answered."""
    service = RunningService(folder, "--workers", "0", prefix=FEW_FILES)
    with httpx.Client(base_url=service.url, timeout=60, trust_env=False) as http:
        for number in range(TWINS):
            twin = {"id": f"t{number}", "scenario": "S1", "controller": "logic", "at_end": "repeat"}
            made = http.post("/v1/twins", json=twin)
            assert made.status_code == 201, made.text
        time.sleep(2)
        with Attack(service) as attack:
            time.sleep(0.5)
            command = [sys.executable, PROBER, str(service.port)]
            prober = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
            time.sleep(seconds)
            waits = json.loads(prober.communicate("\n", timeout=60)[0])
        twins = [http.get(f"/v1/twins/t{number}").json() for number in range(TWINS)]
    assert service.stop() < 10
    said = "".join(service.said)
    assert "Traceback" not in said, said[-4000:]
    assert "Too many open files" not in said
    return waits, twins, attack.answered


def _quantile(values, share):
    return sorted(values)[int(share * (len(values) - 1))]


def _told(waits, twins, answered):
    """The figures in a line, printed."""
    told = {}
    for kind in ("kept", "new"):
        quantiles = {f"p{share}": round(_quantile(waits[kind], share / 100), 4) for share in (50, 99, 100)}
        told[kind] = {"n": len(waits[kind]), **quantiles}
    worst = max(twin["lateness_max_s"] for twin in twins)
    late = {"ticks_late": sum(twin["ticks_late"] for twin in twins), "lateness_max_s": worst}
    print(json.dumps({**told, **late, "floods": answered, "failed": waits["failed"][:3]}))
    return late


@pytest.mark.timed
@pytest.mark.slow
def test_an_attack_of_some_seconds_is_survived(tmp_path):
    waits, twins, answered = _attacked(tmp_path, 6)
    _told(waits, twins, answered)
    assert waits["failed"] == []
    assert answered > 3
    assert all(_quantile(waits[kind], 0.5) < 0.25 for kind in ("kept", "new"))
    assert all(twin["state"] == "running" and twin["samples"] >= 6 for twin in twins)


if __name__ == "__main__":
    # What a minute of it costs: `python -m tests.api.test_attack`. No test holds these figures against a bar,
    # since other tests run beside it.
    with tempfile.TemporaryDirectory() as folder:
        _told(*_attacked(Path(folder), 60))
