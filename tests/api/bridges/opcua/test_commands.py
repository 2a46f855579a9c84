"""`hrs opcua` as a user types it, and what its page shows."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from station.measurement import TagMap
from tests.api.bridges.opcua.test_follow import from_the_start, station_values
from tests.api.here import hrs
from tests.api.measured import BEGIN, NAMES, ORDER
from tests.waiting import wait_until
from tests.warm import start_hrs

PAGE = (Path(__file__).parents[4] / "docs" / "opcua.md").read_text()
TAGS = "".join(
    f'[[tags]]\ntag = "T.{name}"\ncolumn = "{name}"\nsensor = "{name}"\nnode = "ns=2;s={name}"\n' for name in NAMES
)
FOLLOW = ("follow", "--twin", "field", "--tags", "tags.toml", "--from")


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("serve", "--twins", "a", "--endpoint", "http://127.0.0.1"), "--endpoint: must be opc.tcp://"),
        (("serve", "--twins", "a", "--certificate", "a.der"), "--private-key: must be given, too"),
        (("serve", "--twins", "a", "--certificate", "a.der", "--private-key", "b"), "--certificate: must be a file"),
        (("serve", "--twins", "a", "--url", "http://127.0.0.1:9"), "no service answers at"),
        (("serve", "--twins", "a", "--endpoint", "opc.tcp://0.0.0.0:4840"), "--certificate: must be given where"),
        ((*FOLLOW, "opc.tcp://plc.example"), "--certificate: must be given for another machine's server"),
        ((*FOLLOW, "opc.tcp://127.0.0.1", "--source", "a b"), "--source: must be 1 to 64"),
        ((*FOLLOW, "opc.tcp://127.0.0.1", "--url", "http://127.0.0.1:9"), "no service answers at"),
    ],
)
def test_what_is_wrong_is_named(arguments, named, monkeypatch, tmp_path):
    monkeypatch.setattr(signal, "signal", lambda *_: None)  # of the process of the tests
    (tmp_path / "tags.toml").write_text(TAGS)
    done = hrs("opcua", *arguments, cwd=tmp_path)
    assert (done.returncode, named in done.stderr) == (2, True), done.stderr


def test_without_the_extra_it_is_named(monkeypatch):
    for name in [name for name in sys.modules if name.startswith("api.bridges.opcua")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "asyncua", None)
    for name in [name for name in sys.modules if name.startswith("asyncua.")]:
        monkeypatch.delitem(sys.modules, name)
    done = hrs("opcua", "serve", "--twins", "demo")
    assert (done.returncode, "pip install hrs-twin[opcua]" in done.stderr) == (2, True), done.stderr


@pytest.mark.slow
def test_the_command_follows_until_it_is_interrupted(service, running, plant, tmp_path):
    made = plant(station_values(20), every_s=0.02, step_s=1.0, stamp=BEGIN + 0.1)
    twin = service.start(**{**ORDER, "id": "typed"})
    (tmp_path / "tags.toml").write_text(TAGS)
    following = start_hrs(
        "opcua", "follow", "--twin", "typed", "--from", made.url, "--tags", tmp_path / "tags.toml", "--place",
        from_the_start(tmp_path), "--url", running.url, stderr_apart=True,
    )  # fmt: skip
    place = tmp_path / "place.json"
    wait_until(lambda: f"{BEGIN + 19.1:.1f}" in place.read_text())
    following.send_signal(signal.SIGINT)
    said, errors = following.communicate(60)
    assert following.wait(20) == 0, errors
    told = f"twin typed has {20 * len(NAMES)} readings by 1 connections; the server was away 0 times"
    assert said == f"{told} for longer than 10 s\n"
    twin.stop()


@pytest.mark.slow
def test_the_client_of_the_page_reads_a_twin(service, serving):
    """In a process of its own, with nothing of ours."""
    (client,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    twin = service.start("S1", id="demo", speed=1000, at_end="idle")
    wait_until(lambda: twin.state()["samples"] > 100)
    twin.change(paused=True)
    serve = serving("demo")
    script = client.replace("opc.tcp://127.0.0.1:4840/hrs", serve.url)
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert re.fullmatch(r"[0-9.]+ Good [0-9-]+ [0-9:.]+\+00:00\n61 values of the last minute\n", done.stdout)
    twin.stop()


def test_the_tag_of_the_page_is_one():
    (shown,) = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    tag = tomllib.loads(shown)["tags"][0]
    assert TagMap.model_validate({"tags": [tag, *(each for each in ORDER["tags"]["tags"]
                                                  if each["sensor"] != tag["sensor"])]}).tags[0].node  # fmt: skip
