"""A real Prometheus and Alertmanager with our files: metrics by a reading key, and a twin's alarm that arrives."""

from __future__ import annotations

import re
import shutil
import subprocess
from contextlib import contextmanager

import httpx
import pytest

from tests.api.conftest import RunningService, free_port
from tests.api.here import hrs
from tests.api.monitored import ALARMED, ALERTMANAGER, ALERTS, PROMETHEUS, QUERIES, filled_in
from tests.waiting import wait_until

pytestmark = pytest.mark.slow


def _program(*names):
    found = next(filter(None, map(shutil.which, names)), None)
    return found or pytest.skip(f"{names[0]} is not installed (Debian: prometheus, prometheus-alertmanager)")


@contextmanager
def _running(log, *command):
    """A program that is ended behind; its output is in `log`."""
    with log.open("w") as said:
        process = subprocess.Popen([*map(str, command)], stdout=said, stderr=subprocess.STDOUT)
        try:
            yield process
        finally:
            process.terminate()
            process.wait(20)


def _answers(url):
    try:
        return httpx.get(url, trust_env=False, timeout=5).status_code == 200
    except httpx.HTTPError:
        return False


def _get(url, **query):
    answer = httpx.get(url, params=query, trust_env=False, timeout=30)
    answer.raise_for_status()
    return answer.json()


@pytest.fixture
def alertmanager(tmp_path):
    """Address of an Alertmanager with our file."""
    program = _program("prometheus-alertmanager", "alertmanager")
    address = f"127.0.0.1:{free_port()}"
    command = (
        program, f"--config.file={ALERTMANAGER}", f"--storage.path={tmp_path / 'alertmanager'}",
        "--cluster.listen-address=", f"--web.listen-address={address}",
    )  # fmt: skip
    with _running(tmp_path / "alertmanager.log", *command):
        wait_until(lambda: _answers(f"http://{address}/-/ready"), 60)
        yield f"http://{address}"


@pytest.fixture
def monitored(tmp_path, alertmanager):
    """HTTP to a service that asks for keys, and the address of a Prometheus that watches it by our files."""
    program = _program("prometheus")
    data = tmp_path / "data"
    create = ("keys", "create", "--data", data, "--scope")
    made = {scope: hrs(*create, scope, scope).stdout.strip() for scope in ("read", "operate")}
    key = tmp_path / "hrs.key"
    key.write_text(made["read"] + "\n")
    service = RunningService(data, "--workers", "0", "--host", "0.0.0.0")  # noqa: S104  # it asks for keys
    text = PROMETHEUS.read_text().replace(": 15s", ": 1s")
    here = {"hrs:8000": f"127.0.0.1:{service.port}", "alertmanager:9093": alertmanager.removeprefix("http://")}
    for given, ours in {**here, "/run/secrets/hrs_key": str(key)}.items():
        assert given in text
        text = text.replace(given, ours)
    (tmp_path / "prometheus.yml").write_text(text)
    (tmp_path / "alerts.yml").write_text(ALERTS.read_text())
    address = f"127.0.0.1:{free_port()}"
    command = (
        program, f"--config.file={tmp_path / 'prometheus.yml'}", f"--storage.tsdb.path={tmp_path / 'prometheus'}",
        f"--web.listen-address={address}",
    )  # fmt: skip
    try:
        with (
            httpx.Client(base_url=service.url, trust_env=False, timeout=30) as client,
            _running(tmp_path / "prometheus.log", *command),
        ):
            client.headers["authorization"] = f"Bearer {made['operate']}"
            wait_until(lambda: _answers(f"http://{address}/-/ready"), 60)
            yield client, f"http://{address}"
    finally:
        service.stop()


def test_an_alarm_of_a_twin_reaches_alertmanager_and_ends_there_when_it_is_acknowledged(monitored, alertmanager):
    client, prometheus = monitored

    def value(query):
        found = _get(f"{prometheus}/api/v1/query", query=query)["data"]["result"]
        return float(found[0]["value"][1]) if found else None

    def firing(**labels):
        chosen = [f'{name}="{text}"' for name, text in labels.items()]
        return _get(f"{alertmanager}/api/v2/alerts", filter=chosen, active="true")

    wait_until(lambda: value('up{job="hrs-twin"}') == 1.0, 60)
    assert firing(alertname="HrsTwinAlarm") == []
    client.post("/v1/twins", json=ALARMED).raise_for_status()
    wait_until(lambda: client.get("/v1/twins/alarmed/alarms").json()["items"], 60)
    client.patch("/v1/twins/alarmed", json={"paused": True}).raise_for_status()
    wait_until(lambda: firing(alertname="HrsTwinAlarm"), 60)
    (alert,) = firing(alertname="HrsTwinAlarm")
    told = {name: alert["labels"][name] for name in ("twin", "alarm", "priority", "severity", "job")}
    assert told == {"twin": "alarmed", "alarm": "filled", "priority": "high", "severity": "critical", "job": "hrs-twin"}
    assert alert["annotations"]["summary"] == "alarmed: filled"
    assert value('hrs_twin_alarms{twin="alarmed",priority="high",state="unacknowledged"}') == 1.0
    asked = [_program("amtool"), f"--alertmanager.url={alertmanager}", "alert", "query"]
    shown = subprocess.run(asked, capture_output=True, text=True, check=True).stdout
    assert re.search(r"^HrsTwinAlarm +[0-9-]+ [0-9:]+ UTC +alarmed: filled +active *$", shown, re.MULTILINE), shown
    for query in QUERIES:
        answer = _get(f"{prometheus}/api/v1/query", query=filled_in(query))
        assert answer["status"] == "success", query
    client.post("/v1/twins/alarmed/alarms/filled", json={"action": "acknowledge"}).raise_for_status()
    wait_until(lambda: value('hrs_twin_alarms{twin="alarmed",priority="high",state="acknowledged"}') == 1.0, 60)
    wait_until(lambda: not firing(alertname="HrsTwinAlarm"), 60)


def test_without_its_key_prometheus_sees_that_it_is_refused(monitored, tmp_path):
    client, prometheus = monitored

    def health():
        found = _get(f"{prometheus}/api/v1/targets")["data"]["activeTargets"]  # none before it has looked for them
        return (found[0]["health"], found[0]["lastError"]) if found else ("", "")

    wait_until(lambda: health()[0] == "up", 60)
    assert client.get("/metrics", headers={"authorization": ""}).status_code == 401
    (tmp_path / "hrs.key").write_text("none of ours\n")  # which is read again at each scrape
    wait_until(lambda: health()[0] == "down", 60)
    assert "401" in health()[1]


def test_an_alert_on_old_data_silences_the_alarm_of_the_twin_that_says_the_same(alertmanager):
    alarm = {"alertname": "HrsTwinAlarm", "instance": "hrs:8000", "alarm": "data_silent", "severity": "critical"}
    given = [
        {"alertname": "HrsTwinDataOld", "instance": "hrs:8000", "twin": "old", "severity": "critical"},
        {**alarm, "twin": "old"}, {**alarm, "twin": "other"}, {**alarm, "twin": "old", "alarm": "leak_high"},
        {"alertname": "HrsStoreSilent", "instance": "hrs:8000", "severity": "critical"},
        {"alertname": "HrsDatabaseErrors", "instance": "hrs:8000", "severity": "warning"},
        {"alertname": "HrsDatabaseErrors", "instance": "elsewhere:8000", "severity": "warning"},
    ]  # fmt: skip
    posted = httpx.post(f"{alertmanager}/api/v2/alerts", json=[{"labels": each} for each in given], trust_env=False)
    posted.raise_for_status()

    def states():
        shown = {
            tuple(sorted(each["labels"].items())): each["status"] for each in _get(f"{alertmanager}/api/v2/alerts")
        }
        return [shown[tuple(sorted(labels.items()))]["state"] for labels in given]

    expected = ["active", "suppressed", "active", "active", "active", "suppressed", "active"]
    wait_until(lambda: states() == expected, 60)  # those that wait for their group are `unprocessed`
