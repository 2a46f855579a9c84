"""`hrs watch` as a user sees it, and what its screen makes of every sample of a run."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest
from rich.console import Console

from api.telemetry import watch
from api.telemetry.session import connect
from api.twins.messages import COLUMNS, Event, EventKind, Sample
from controllers import create
from station import load_scenario, simulate
from tests.api.conftest import free_port
from tests.warm import run_hrs

WORKERS = 0


def _shown(view):
    console = Console(width=120, record=True, file=open(os.devnull, "w"))  # noqa: SIM115, PTH123  # closed below
    with console.file:
        console.print(view.draw())
        return console.export_text()


def test_every_sample_of_a_run_can_be_drawn():
    record = simulate(load_scenario("S1"), create("minlp1"))
    view = watch.View("demo")
    assert "no sample for 0 s" in _shown(view)
    rows = list(zip(*(record[name].tolist() for name in COLUMNS), strict=True))
    for seq in (*range(0, len(rows), 50), len(rows) - 1):
        view.sample(Sample("demo", 1, seq, 0.0, rows[seq]).document())
        screen = _shown(view)
        assert f"{record['pressure_high'][seq]:.1f}" in screen
        vehicle = record["vehicle"][seq]
        assert ("vehicle none" if vehicle < 0 else f"vehicle number {vehicle}") in screen
        assert screen.count("open") == sum(record[f"{s}_{b}"][seq] for s in ("inlet", "outlet") for b in watch.BUFFERS)


def test_silence_is_told(monkeypatch):
    view = watch.View("demo")
    view.sample(Sample("demo", 1, 5, 0.0, (5.0,) * len(COLUMNS)).document())
    assert "no sample" not in _shown(view)
    now = time.monotonic()
    monkeypatch.setattr(watch.time, "monotonic", lambda: now + 12)
    assert "no sample for 12 s" in _shown(view)


def test_what_an_event_tells_is_shown_as_it_is():
    view = watch.View("demo")
    view.sample(Sample("demo", 1, 5, 0.0, (5.0,) * len(COLUMNS)).document())
    view.event(Event("demo", 1, 0, 0.0, 0.0, EventKind.RESUMED, {"memory": "[/red] anew [bold]"}).document())
    screen = _shown(view)
    assert "memory [/red] anew [bold]" in screen
    assert "pressure [bar]" in screen
    assert "temperature [degC]" in screen


def test_events_stand_once_and_in_order():
    view = watch.View("demo")
    view.sample(Sample("demo", 1, 5, 0.0, (5.0,) * len(COLUMNS)).document())
    for seq in (3, 4, 2, 3, *range(5, 12), 11):
        view.event(Event("demo", 1, seq, 0.0, 100.0 + seq, EventKind.ARRIVAL, {"vehicle": seq}).document())
    lines = [line for line in _shown(view).splitlines() if "arrival" in line]
    assert [int(line.split("vehicle")[1].split()[0]) for line in lines] == list(range(4, 12))


def _watch(*arguments):
    return run_hrs("watch", *arguments)


HEEDS_CTRL_C = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
from api.cli.main import main
main()
"""
# A shell lets what it starts in the background ignore SIGINT, and tests may be started so.


@pytest.mark.slow
def test_a_live_twin_is_shown_and_ctrl_c_ends_it(service, http):
    assert http.post("/v1/twins", json={"id": "seen", "scenario": "S1", "speed": 5}).status_code == 201
    done = _watch("seen", "--endpoint", service.zenoh, "--seconds", "2")
    assert done.returncode == 0, done.stderr
    assert "pressure [bar]" in done.stdout
    assert "fill start" in done.stdout
    command = [sys.executable, "-c", HEEDS_CTRL_C, "watch", "seen", "--endpoint", service.zenoh]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    with connect(service.zenoh) as session, session.declare_publisher("hrs/v1/seen/sample") as publisher:
        until = time.monotonic() + 30
        while not publisher.matching_status.matching:  # until it listens
            assert time.monotonic() < until
            time.sleep(0.05)
    time.sleep(0.5)
    assert process.poll() is None
    process.send_signal(signal.SIGINT)
    said, wrong = process.communicate(timeout=20)
    assert process.returncode in {0, 130}
    assert "Traceback" not in said + wrong


@pytest.mark.parametrize("twin", ["nobody", "*", "a/b"])
def test_no_such_twin_is_told(service, twin):
    done = _watch(twin, "--endpoint", service.zenoh)
    assert done.returncode == 2
    assert f"no twin called '{twin}' is live" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_no_router_is_told():
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    done = _watch("demo", "--endpoint", endpoint)
    assert done.returncode == 2
    assert f"no router answers at {endpoint}" in done.stderr
    assert "Traceback" not in done.stderr
