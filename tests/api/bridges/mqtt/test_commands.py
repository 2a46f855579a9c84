"""`hrs mqtt` as a user types it."""

from __future__ import annotations

import json
import signal
import subprocess
import sys

import pytest

from api.client import Service
from tests.api.bridges.mqtt.conftest import Listener
from tests.api.conftest import RunningService
from tests.api.here import hrs
from tests.api.test_cli_send import HRS
from tests.waiting import wait_until


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("publish", "demo", "http://127.0.0.1"), "URL: must be mqtt://"),
        (("publish", "demo", "mqtt://station.example"), "or --plaintext be given"),
        (("publish", "demo", "mqtt://127.0.0.1", "--sparkplug", "a", "--place", "p.json"), "--place: must be left out"),
        (("publish", "demo", "mqtt://127.0.0.1", "--sparkplug", "a/b"), "--sparkplug: must be a group without"),
        (("subscribe", "demo", "mqtt://127.0.0.1", "--topic", "a", "--source", "a b"), "--source: must be 1 to 64"),
        *(
            (
                ("subscribe", "demo", "mqtt://127.0.0.1", "--topic", topic),
                "--topic: must be a filter of MQTT, as plant/+",
            )
            for topic in ("", "plant/#/x", "plant/a#", "plant+", "a" * 65_536)
        ),
        (("publish", "demo", "mqtt://127.0.0.1", "--url", "http://127.0.0.1:9"), "no service answers at"),
    ],
)
def test_what_is_wrong_is_named(arguments, named, monkeypatch):
    monkeypatch.setattr(signal, "signal", lambda *_: None)  # of the process of the tests
    done = hrs("mqtt", *arguments)
    assert (done.returncode, named in done.stderr) == (2, True), done.stderr


def test_without_the_extra_it_is_named(monkeypatch):
    for name in [name for name in sys.modules if name.startswith("api.bridges.mqtt")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "paho", None)
    for name in [name for name in sys.modules if name.startswith("paho.")]:
        monkeypatch.delitem(sys.modules, name)
    done = hrs("mqtt", "publish", "demo", "mqtt://127.0.0.1")
    assert (done.returncode, "pip install hrs-twin[mqtt]" in done.stderr) == (2, True), done.stderr


@pytest.mark.slow
def test_the_command_publishes_until_it_is_interrupted(tmp_path, broker):
    running = RunningService(tmp_path / "data", "--workers", "0")
    listener = Listener(broker, "hrs/v1/typed/#")
    try:
        with Service(url=running.url) as service:
            twin = service.start("S1", id="typed", speed=50, at_end="repeat")
            where = ("--place", tmp_path / "place.json", "--url", running.url)
            command = [HRS, "mqtt", "publish", "typed", broker.url, *where]
            publishing = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
            wait_until(lambda: len(listener.heard) > 100)
            publishing.send_signal(signal.SIGINT)
            _, errors = publishing.communicate(timeout=60)
            assert publishing.returncode == 0, errors
            wait_until(lambda: listener.heard[-1][1] == b"offline")
            seconds = [json.loads(payload)["seq"] for topic, payload, _ in listener.heard if topic.endswith("/sample")]
            assert seconds == list(range(seconds[0], seconds[-1] + 1))
            assert json.loads((tmp_path / "place.json").read_text())["sample"] == seconds[-1] + 1
            twin.stop()
    finally:
        listener.close()
        running.stop()
