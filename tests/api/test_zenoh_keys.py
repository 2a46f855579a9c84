"""Keys on zenoh: who shows one gets what its scopes say, who shows none gets nothing."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from dataclasses import astuple
from pathlib import Path

import httpx
import pytest
import trustme

from api.scopes import Scope, allows
from api.settings import Settings
from api.store.database import open_database
from api.store.keys import KeyRepository
from api.telemetry.access import Login, read_secret
from station import Status
from tests.api.conftest import RunningService, free_port
from tests.api.here import hrs
from tests.api.stranger import stranger, told
from tests.waiting import wait_until
from tests.warm import run_hrs

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples" / "telemetry"
TWIN = "guarded"
ASKED = [f"hrs/v1/{TWIN}/{name}" for name in ("sample", "signal/pressure_high", "event", "history")]
COMMAND = f"hrs/v1/{TWIN}/command"
MEASUREMENT = f"hrs/v1/{TWIN}/measurement"
PUBLISHED = [f"hrs/v1/{TWIN}/{name}" for name in ("sample", "event", "signal/pressure_high", "alive", "measurement")]
ANSWERED = [f"hrs/v1/{TWIN}/{name}" for name in ("history", "sample", "event", "command", "measurement", "decide")]


class Guarded(RunningService):
    """A service whose zenoh router others reach with a key, and what opens it."""

    def __init__(self, folder, **variables):
        authority = trustme.CA()
        shown = authority.issue_cert("localhost", "127.0.0.1")
        self.ca, self.certificate, self.private_key = (
            folder / f"{name}.pem" for name in ("ca", "certificate", "private")
        )
        authority.cert_pem.write_to_path(self.ca)
        for number, part in enumerate(shown.cert_chain_pems):
            part.write_to_path(self.certificate, append=number > 0)
        shown.private_key_pem.write_to_path(self.private_key)
        self.data = folder / "data"
        self.keys, self.logins = {}, {}
        for scope in Scope:
            self.make(scope, scope)
        port = free_port()
        self.tls = f"tls/127.0.0.1:{port}"
        self.tcp = f"tcp/127.0.0.1:{port}"
        options = (
            "--zenoh-listen", f"tls/0.0.0.0:{port}", "--zenoh-certificate", self.certificate, "--zenoh-private-key",
            self.private_key, "--workers", "0",
        )  # fmt: skip
        super().__init__(self.data, *map(str, options), **variables)

    def make(self, name, scope):
        """Make a key and remember what it opens."""
        with open_database(f"sqlite:///{self.data / 'hrs.db'}") as database:
            database.migrate()
            keys = KeyRepository(database)
            self.keys[name] = keys.create(name, [scope])
            (held,) = (key for key in keys.all() if key.name == name)
        self.login(name, *astuple(Login.of(held, read_secret(Settings(data=self.data))))[:2])

    def login(self, name, user, password):
        """Remember what a key opens zenoh with."""
        self.logins[name] = {"user": user, "password": password}

    def meet(self, name, **wish):
        """Start a client with somebody's key."""
        return stranger(**{"endpoint": self.tls, "ca": str(self.ca), **self.logins[name], **wish})


@pytest.fixture(scope="module")
def guarded(tmp_path_factory):
    running = Guarded(tmp_path_factory.mktemp("guarded"), HRS_ACCESS_LOG="true")
    with httpx.Client(base_url=running.url, timeout=30, trust_env=False) as http:
        twin = {"id": TWIN, "scenario": "S1", "speed": 10, "at_end": "repeat"}
        assert http.post("/v1/twins", json=twin).status_code == 201
    yield running
    running.stop()


def _twin(guarded, **changes):
    return httpx.patch(f"{guarded.url}/v1/twins/{TWIN}", json=changes, timeout=30, trust_env=False)


@pytest.mark.slow
@pytest.mark.parametrize("scope", Scope)
def test_a_key_hears_and_asks_what_its_scopes_say(guarded, scope):
    operates = allows([scope], Scope.OPERATE)
    said = told(guarded.meet(scope, seconds=2, ask=[*ASKED, "hrs/v1/*/sample", COMMAND, MEASUREMENT, "hrs/v1/**"]))
    assert said["opened"]
    assert any('"values"' in text for text in said["heard"])
    assert said["alive"] == [f"hrs/v1/{TWIN}/alive"]
    for place in (*ASKED, "hrs/v1/*/sample"):
        assert said["answers"][place], place
    assert bool(said["answers"][COMMAND]) == operates  # a problem document: it was asked without a payload
    # a problem document, too: this twin is simulated
    assert bool(said["answers"][MEASUREMENT]) == allows([scope], Scope.MEASURE)
    assert said["answers"]["hrs/v1/**"] == []


@pytest.mark.slow
@pytest.mark.parametrize(
    "wish",
    [
        pytest.param({"password": "0" * 64}, id="wrong password"),
        pytest.param({"password": ""}, id="empty password"),
        pytest.param({"password": "KEY"}, id="the key as password"),
        pytest.param({"user": None}, id="no user"),
        pytest.param({"user": "nobody"}, id="unknown user"),
        pytest.param({"user": ""}, id="empty user"),
        pytest.param({"mode": "peer", "user": None}, id="no user, as a peer"),
        pytest.param({"mode": "router", "user": None}, id="no user, as a router"),
        pytest.param({"ca": None}, id="public authorities"),
        pytest.param({"ca": "OTHER"}, id="another authority"),
        pytest.param({"endpoint": "PLAIN"}, id="without TLS"),
    ],
)
def test_others_are_refused(guarded, tmp_path, wish):
    other = tmp_path / "other.pem"
    trustme.CA().cert_pem.write_to_path(other)
    meant = {"OTHER": str(other), "PLAIN": guarded.tcp, "KEY": guarded.keys["admin"]}
    wish = {name: meant.get(value, value) for name, value in wish.items()}
    whole = {"endpoint": guarded.tls, "ca": str(guarded.ca), **guarded.logins["admin"], **wish}
    said = told(stranger(**whole, seconds=1, ask=ASKED[:1]))
    # A router or a peer may open without anybody to talk to; it must then be alone.
    assert not said["opened"] or not (said["routers"] or said["heard"] or said["alive"] or said["answers"][ASKED[0]])


@pytest.mark.slow
@pytest.mark.parametrize(
    "mode", ["client", *(pytest.param(mode, marks=pytest.mark.slow) for mode in ("peer", "router"))]
)
@pytest.mark.parametrize("scope", [pytest.param(Scope.READ, marks=pytest.mark.slow), Scope.OPERATE])
def test_nobody_publishes_or_answers_in_the_place_of_the_service(guarded, scope, mode):
    forger = guarded.meet(scope, mode=mode, seconds=6, put=PUBLISHED, answer=ANSWERED)
    time.sleep(2)
    hearer = told(guarded.meet("admin", seconds=2, ask=ASKED))
    said = told(forger)
    assert said["opened"]
    assert said["heard"], "it was there"
    assert hearer["heard"]
    assert hearer["forged"] == []
    assert all(len(answers) == 1 and "forged" not in answers[0] for answers in hearer["answers"].values())
    assert said["asked"] == []


@pytest.mark.slow
def test_only_who_operates_decides(guarded):
    assert _twin(guarded, controller="remote", speed=5).status_code == 200
    try:
        for scope in Scope:
            said = told(guarded.meet(scope, seconds=3, answer=[f"hrs/v1/{TWIN}/decide"]))
            assert bool(said["asked"]) == allows([scope], Scope.OPERATE), scope
    finally:
        _twin(guarded, controller="logic", speed=10)


@pytest.mark.slow
def test_keys_count_and_stop_counting_while_the_service_runs(guarded):
    """A key made later opens zenoh; a revoked one is cut off, and its neighbour comes back by itself."""
    name = "late: ann/ö"
    made = hrs("keys", "create", name, "--scope", "read", "--data", guarded.data)
    guarded.keys[name] = made.stdout.strip()
    guarded.login(name, *hrs("keys", "zenoh", name, "--data", guarded.data).stdout.split())
    assert guarded.logins[name]["user"] == "late%3A%20ann%2F%C3%B6"
    wait_until(lambda: told(guarded.meet(name, ask=ASKED[:1]))["opened"])
    cut, neighbour = (guarded.meet(who, seconds=14) for who in (name, "read"))
    time.sleep(3)
    assert hrs("keys", "revoke", name, "--data", guarded.data).returncode == 0
    lost, kept = (json.loads(told(process)["heard"][-1]) for process in (cut, neighbour))
    assert kept["seq"] > lost["seq"] + 20  # some 2 s at 10x
    assert not told(guarded.meet(name))["opened"]
    assert told(guarded.meet("read", ask=ASKED))["answers"][ASKED[0]]


@pytest.mark.slow
def test_who_makes_a_key_over_rest_is_told_what_it_opens(guarded):
    made = httpx.post(f"{guarded.url}/v1/keys", json={"name": "screen", "scopes": ["read"]}, trust_env=False).json()
    guarded.keys["screen"] = made["key"]
    guarded.login("screen", **made["zenoh"])
    assert hrs("keys", "zenoh", "screen", "--data", guarded.data).stdout.split() == list(made["zenoh"].values())
    wait_until(lambda: told(guarded.meet("screen", ask=ASKED[:1]))["opened"])
    nobody = hrs("keys", "zenoh", "nobody", "--data", guarded.data)
    assert (nobody.returncode, "no valid key is called 'nobody'" in nobody.stderr) == (2, True)


@pytest.mark.slow
def test_watch_shows_a_twin_to_who_has_a_key(guarded, monkeypatch):
    login = guarded.logins["read"]
    asked = ("watch", TWIN, "--endpoint", guarded.tls, "--seconds", "1", "--ca", guarded.ca, "--user", login["user"])
    monkeypatch.setenv("HRS_ZENOH_PASSWORD", login["password"])
    watched = run_hrs(*asked)
    monkeypatch.setenv("HRS_ZENOH_PASSWORD", login["password"][1:])
    refused = run_hrs(*asked)
    assert watched.returncode == 0, watched.stderr
    assert "pressure" in watched.stdout
    assert refused.returncode == 2
    assert "may have refused this user" in refused.stderr


def test_the_examples_show_a_key(guarded, tmp_path):
    """`rebuild.py` writes a record down with a key that reads, `controller.py` decides with one that operates."""
    elsewhere = "--endpoint", guarded.tls, "--ca", str(guarded.ca)

    def example(name, scope, *options):
        login = guarded.logins[scope]
        command = [sys.executable, EXAMPLES / name, TWIN, *options, *elsewhere, "--user", login["user"]]
        return subprocess.Popen(command, env={**os.environ, "HRS_ZENOH_PASSWORD": login["password"]})

    decider = example("controller.py", Scope.OPERATE)
    try:
        assert _twin(guarded, controller="remote", speed=5).status_code == 200
        wait_until(lambda: _values(guarded)["decision_status"] == Status.RULE)
    finally:
        _twin(guarded, controller="logic", speed=10)
        decider.kill()
        decider.wait()
    record = tmp_path / "record.jsonl"
    assert example("rebuild.py", Scope.READ, record, "--until", "5").wait(60) == 0
    assert [json.loads(line)["seq"] for line in record.read_text().splitlines()][:6] == list(range(6))


def _values(guarded):
    return httpx.get(f"{guarded.url}/v1/twins/{TWIN}", timeout=30, trust_env=False).json()["values"]


@pytest.mark.slow
def test_nothing_secret_is_told(guarded):
    """The log, with every request, a refusal and keys that change; the metrics; files that others may read."""
    made = httpx.post(f"{guarded.url}/v1/keys", json={"name": "new", "scopes": ["read"]}, trust_env=False).json()
    guarded.keys["new"] = made["key"]
    guarded.login("new", **made["zenoh"])
    wait_until(lambda: told(guarded.meet("new"))["opened"])
    assert not told(guarded.meet("new", password="0" * 64))["opened"]
    metrics = httpx.get(f"{guarded.url}/metrics", trust_env=False).text
    assert "hrs_http_requests_total" in metrics
    assert any("keys have changed" in line for line in guarded.said)
    secret = guarded.data / "zenoh.secret"
    private = guarded.private_key.read_text().splitlines()[1]
    told_to_all = metrics + "".join(guarded.said)
    hidden = [*guarded.keys.values(), *(login["password"] for login in guarded.logins.values()), private]
    hidden.append(secret.read_text().strip())
    for text in hidden:
        assert text not in told_to_all
    assert secret.stat().st_mode & 0o777 == 0o600
    stored = b"".join(path.read_bytes() for path in guarded.data.iterdir() if path != secret)
    for text in hidden:
        assert text.encode() not in stored
