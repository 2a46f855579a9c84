"""Servers in processes of their own: a plant that is not the product's, and `hrs opcua serve`."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path

import pytest

from api.client import Service
from tests.api.conftest import RunningService, free_port
from tests.warm import start_hrs

PLANT = Path(__file__).with_name("plant.py")


class Plant:
    """A plant with a server that can be killed and started."""

    def __init__(self, folder, values, *, every_s, step_s, stamp=None, history=True) -> None:
        self.url = f"opc.tcp://127.0.0.1:{free_port()}/plant"
        self.begin = time.time() + 1.0
        self.stamp, self.step_s = self.begin if stamp is None else stamp, step_s
        self._file = folder / "series.json"
        series = {
            "url": self.url, "begin": self.begin, "every_s": every_s, "stamp": self.stamp, "step_s": step_s,
            "values": values, "history": history,
        }  # fmt: skip
        self._file.write_text(json.dumps(series))
        self.start()

    def start(self) -> None:
        """Start its server, and wait until it listens."""
        self.process = subprocess.Popen([sys.executable, PLANT, self._file], stdout=subprocess.PIPE, text=True)
        assert self.process.stdout.readline() == "ready\n"

    def kill(self) -> None:
        """As a power cut would."""
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()

    def tick(self, time_s):
        """The number of the tick with that SourceTimestamp."""
        return round((time_s - self.stamp) / self.step_s)


class Serving:
    """`hrs opcua serve` in a process of its own."""

    def __init__(self, service, twins, *options, port=None, **variables) -> None:
        self.url = f"opc.tcp://127.0.0.1:{port or free_port()}/hrs"
        self._arguments = ("--twins", twins, "--endpoint", self.url, "--url", service.url, *options)
        self._variables = variables
        self.start()

    def start(self) -> None:
        """Start it, and wait until clients can connect."""
        self.process = start_hrs("opcua", "serve", *self._arguments, **self._variables)
        line = self.process.stdout.readline()
        assert line.rstrip().endswith(self.url), line + self.process.stdout.read()

    def kill(self) -> None:
        """As a power cut would."""
        self.process.kill()
        self.process.wait(20)
        self.process.stdout.close()

    def stop(self) -> int:
        """Interrupt it; its status."""
        self.process.terminate()
        status = self.process.wait(20)
        self.process.stdout.close()
        return status


@pytest.fixture
def plant(tmp_path):
    """Makes a plant of values by node."""
    made = []

    def make(values, **options):
        made.append(Plant(tmp_path, values, **options))
        return made[-1]

    yield make
    for each in made:
        if each.process.poll() is None:
            each.kill()


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    """A service that computes no jobs."""
    started = RunningService(tmp_path_factory.mktemp("opcua"), "--workers", "0")
    yield started
    started.stop()


@pytest.fixture
def service(running):
    with Service(url=running.url) as client:
        yield client


@pytest.fixture
def serving(running):
    """Makes servers of twins."""
    made = []

    def make(twins, *options, **more):
        made.append(Serving(running, twins, *options, **more))
        return made[-1]

    yield make
    for each in made:
        if each.process.poll() is None:
            each.kill()
