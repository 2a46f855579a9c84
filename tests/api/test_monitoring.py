"""api/bridges/monitoring/: what Prometheus, Alertmanager and Grafana are told exists in a service that runs."""

from __future__ import annotations

import csv
import json
import re
import shutil
import subprocess

import httpx
import pytest
import yaml
from grafana_foundation_sdk.cog import plugins
from grafana_foundation_sdk.cog.encoder import JSONEncoder
from grafana_foundation_sdk.models.dashboard import Dashboard
from prometheus_client.parser import text_string_to_metric_families

from tests.api.conftest import RunningService
from tests.api.measured import ORDER
from tests.api.monitored import (
    ALARMED,
    ALERTMANAGER,
    ALERTS,
    DASHBOARD,
    FOLDER,
    PANELS,
    PROMETHEUS,
    QUERIES,
    REST,
    ROOT,
    filled_in,
    own_names,
    rules,
    variables,
)
from tests.waiting import wait_until

COMPOSE = yaml.safe_load((ROOT / "docker-compose.yml").read_text())
OF_PROMETHEUS = {"job", "instance", "le", "alertname", "alertstate"}
"""Labels that Prometheus gives, or a histogram has."""


def _provisioned():
    found = yaml.safe_load((FOLDER / "grafana/provisioning/datasources/hrs-twin.yml").read_text())
    return {each["uid"]: each for each in found["datasources"]}


@pytest.fixture(scope="module")
def http(tmp_path_factory):
    """HTTP to a service with a limit of its store, a twin with an alarm and one that follows measurements."""
    running = RunningService(tmp_path_factory.mktemp("monitored"), "--workers", "0", HRS_STORE_BYTES_MAX="1000000000")
    with httpx.Client(base_url=running.url, timeout=30, trust_env=False) as client:
        client.post("/v1/twins", json=ALARMED).raise_for_status()
        client.post("/v1/twins", json={**ORDER, "id": "followed"}).raise_for_status()
        wait_until(lambda: client.get("/v1/twins/alarmed/alarms").json()["items"])
        client.patch("/v1/twins/alarmed", json={"paused": True}).raise_for_status()
        yield client
    running.stop()


@pytest.fixture(scope="module")
def labels(http):
    """The labels of each metric that the service shows, by the name of its samples."""
    found = {}
    for family in text_string_to_metric_families(http.get("/metrics").text):
        for sample in family.samples:
            found.setdefault(sample.name, set()).update(sample.labels)
    return found


@pytest.mark.parametrize(
    "expression", [*(rule["expr"] for rule in rules()), *QUERIES, *(each for each, _ in variables())]
)
def test_every_metric_of_a_query_is_there_with_its_labels(labels, expression):
    names = own_names(expression)
    assert names or re.search(r"\b(up|ALERTS)\b", expression)
    for name, selected in names:
        grouped = re.findall(r"\bby \(([^)]*)\)", expression)
        grouped = {label.strip() for labels_ in grouped for label in labels_.split(",")}
        assert selected | grouped <= labels[name] | OF_PROMETHEUS, name


def test_names_that_are_not_there_are_found(labels):
    assert own_names('rate(hrs_gone_total[5m]) / hrs_twins{state="x"}') == [
        ("hrs_gone_total", set()),
        ("hrs_twins", {"state"}),
    ]
    assert "hrs_gone_total" not in labels
    assert all(label in labels[own_names(metric)[0][0]] for metric, label in variables())


@pytest.mark.parametrize("target", REST, ids=[target["url"].split("?")[0] for target in REST])
def test_every_address_answers_with_its_columns(http, target):
    assert target["url_options"] == {"method": "GET"}
    answer = http.get(filled_in(target["url"]))
    assert answer.status_code == 200, answer.text
    wanted = {column["selector"] for column in target["columns"]}
    if target["type"] == "csv":
        header, *rows = csv.reader(answer.text.splitlines())
        assert wanted == set(header)
        assert rows or "$followed" in target["url"]
        return
    part = answer.json()[target["root_selector"]]
    for row in part if isinstance(part, list) else [part]:
        assert wanted <= set(row)
    assert part


def test_every_panel_has_its_unit():
    for panel in PANELS:
        units = {name: properties.get("unit") for name, properties in _overrides(panel).items()}
        unit = panel["fieldConfig"]["defaults"].get("unit")
        assert panel["description"]
        if unit is None:
            shown = {column["text"] for target in panel["targets"] for column in target["columns"]}
            assert shown == set(units), panel["title"]
            assert all(units.values()), panel["title"]
        for target in panel["targets"]:
            assert set(units) <= {column["text"] for column in target.get("columns", [])} or "expr" in target


def _overrides(panel):
    return {
        each["matcher"]["options"]: {one["id"]: one["value"] for one in each["properties"]}
        for each in panel["fieldConfig"]["overrides"]
    }


UNITS = {"bar": "pressurebar", "s": "s", "kg": "masskg", "kWh": "kwatth", "kW": "kwatt", "EUR": "currencyEUR",
         "EUR/kg": "suffix: EUR/kg", "vehicles": "suffix: vehicles", "index": "none"}  # fmt: skip
"""The unit of Grafana for each of ours."""


def test_units_of_the_dashboard_are_those_of_the_service(http):
    figures = http.get("/v1/twins/alarmed/figures?by=day").json()["units"]
    checked = 0
    for panel in PANELS:
        own = {name: properties.get("unit") for name, properties in _overrides(panel).items()}
        for target in panel["targets"]:
            units = figures
            if target.get("type") == "csv":
                path = filled_in(target["url"]).replace("format=csv", "format=json")
                units = http.get(path).json()["units"]
            for column in target.get("columns", []):
                ours = units.get(column["selector"])
                if ours in UNITS:
                    assert own.get(column["text"]) or panel["fieldConfig"]["defaults"]["unit"] == UNITS[ours]
                    assert own.get(column["text"], UNITS[ours]) == UNITS[ours], column
                    checked += 1
    assert checked > 20


def test_panels_ask_data_sources_that_are_provisioned():
    sources = _provisioned()
    asked = {target["datasource"]["uid"] for panel in PANELS for target in [panel, *panel["targets"]]}
    assert asked == {"prometheus", "hrs-twin"}
    for panel in PANELS:
        assert panel["datasource"]["type"] == sources[panel["datasource"]["uid"]]["type"]
    numbers = [panel["id"] for panel in DASHBOARD["panels"]]
    assert len(set(numbers)) == len(numbers)


def _lost(given, kept, where="dashboard"):
    """Where a document has what another has not, or has otherwise."""
    if isinstance(given, dict) and isinstance(kept, dict):
        return [
            each
            for name, part in given.items()
            for each in (_lost(part, kept[name], f"{where}.{name}") if name in kept else [f"{where}.{name}"])
        ]
    if isinstance(given, list) and isinstance(kept, list) and len(given) == len(kept):
        return [
            each for place, part in enumerate(given) for each in _lost(part, kept[place], f"{where}[{place}]")
        ]  # fmt: skip
    return [] if given == kept else [where]


def test_grafanas_own_models_read_the_dashboard_and_lose_nothing_that_is_shown():
    plugins.register_default_plugins()
    kept = json.loads(JSONEncoder().encode(Dashboard.from_json(DASHBOARD)))
    texts = [f"dashboard.templating.list[{place}].definition" for place in range(2)]  # of the editor's list alone
    assert [each for each in _lost(DASHBOARD, kept) if each not in texts] == []
    wrong = json.loads(json.dumps(DASHBOARD).replace('"gridPos"', '"gridPosition"', 1))
    assert _lost(wrong, json.loads(JSONEncoder().encode(Dashboard.from_json(wrong)))) != texts


def test_files_name_each_other_and_the_services():
    services = COMPOSE["services"]
    prometheus = yaml.safe_load(PROMETHEUS.read_text())
    addresses = [*prometheus["scrape_configs"][0]["static_configs"][0]["targets"]]
    addresses += prometheus["alerting"]["alertmanagers"][0]["static_configs"][0]["targets"]
    addresses += [source["url"].removeprefix("http://") for source in _provisioned().values()]
    for address in addresses:
        name, port = address.split(":")
        assert services[name]["ports"] == [f"127.0.0.1:{port}:{port}"]
    key = prometheus["scrape_configs"][0]["authorization"]["credentials_file"]
    assert _provisioned()["hrs-twin"]["secureJsonData"]["bearerToken"] == f"$__file{{{key}}}"
    holders = {name for name, service in services.items() if "hrs_key" in service.get("secrets", [])}
    assert (key, holders) == ("/run/secrets/hrs_key", {"prometheus", "grafana"})
    ignored = (ROOT / ".gitignore").read_text().split()
    assert f"/{COMPOSE['secrets']['hrs_key']['file']}" in ignored
    mounted = {volume.split(":")[0]: volume.split(":")[1] for each in services.values() for volume in each["volumes"]}
    board = yaml.safe_load((FOLDER / "grafana/provisioning/dashboards/hrs-twin.yml").read_text())
    assert board["providers"][0]["options"]["path"] == mounted["./api/bridges/monitoring/grafana/dashboards"]
    for option in services["prometheus"]["command"] + services["alertmanager"]["command"]:
        given = re.fullmatch(r"--config\.file=(/etc/\w+)/(\w+\.yml)", option)
        assert given is None or (ROOT / {v: k for k, v in mounted.items()}[given[1]] / given[2]).is_file()


def test_the_profile_is_pinned_and_leaves_the_others_alone():
    added = {name: each for name, each in COMPOSE["services"].items() if each.get("profiles") == ["monitoring"]}
    assert set(added) == {"prometheus", "alertmanager", "grafana"}
    assert all(re.fullmatch(r"[\w/]+:v?\d+\.\d+\.\d+", each["image"]) for each in added.values())
    assert re.search(r"@\d+\.\d+\.\d+$", added["grafana"]["environment"]["GF_PLUGINS_PREINSTALL_SYNC"])
    rest = [each for name, each in COMPOSE["services"].items() if name not in added]
    assert not any(
        "profiles" in each or "secrets" in each or set(added) & set(each.get("depends_on", {})) for each in rest
    )
    text = (ROOT / "docker-compose.yml").read_text()
    asked = set(re.findall(r"\$\{(\w+):\?", text.replace("$${", "")))
    assert asked == {"POSTGRES_PASSWORD"}  # Compose asks for these with the profile off, too


@pytest.mark.parametrize(("password", "starts"), [("", False), ("chosen", True)])
def test_grafana_does_not_start_without_a_password(password, starts):
    *shell, command = COMPOSE["services"]["grafana"]["entrypoint"]
    command = command.replace("$$", "$").replace("/run.sh", "echo started")
    environment = {"PATH": "/usr/bin:/bin", "GF_SECURITY_ADMIN_PASSWORD": password}
    done = subprocess.run([*shell, command], env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode == 0, "started" in done.stdout) == (starts, starts)
    assert starts or "choose GRAFANA_ADMIN_PASSWORD" in done.stderr


def _tool(name):
    return shutil.which(name) or pytest.skip(f"{name} is not installed (Debian: prometheus, prometheus-alertmanager)")


def _said(*command):
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_prometheus_and_alertmanager_take_their_files(tmp_path):
    _said(_tool("promtool"), "check", "config", "--syntax-only", str(PROMETHEUS))
    assert f"{len(rules())} rules found" in _said(_tool("promtool"), "check", "rules", str(ALERTS))
    assert "SUCCESS" in _said(_tool("amtool"), "check-config", str(ALERTMANAGER))
    recorded = [{"record": f"query_{k}", "expr": filled_in(query)} for k, query in enumerate(QUERIES)]
    queries = tmp_path / "queries.yml"
    queries.write_text(yaml.safe_dump({"groups": [{"name": "dashboard", "rules": recorded}]}))
    assert f"{len(QUERIES)} rules found" in _said(_tool("promtool"), "check", "rules", str(queries))


ANNOUNCED = (
    'hrs_twin_alarm_announced{job="hrs-twin", instance="hrs:8000", twin="demo", alarm="%s", priority="%s", state="%s"}'
)


def _alert(twin_alarm, priority, severity):
    labels = {"job": "hrs-twin", "instance": "hrs:8000", "twin": "demo", "alarm": twin_alarm, "priority": priority}
    return {"exp_labels": {**labels, "severity": severity}}


def test_alerts_fire_when_they_should_and_not_else(tmp_path):
    """By promtool: an alarm is one alert with its severity until it is acknowledged; the others have their limits."""
    series = [
        {"series": ANNOUNCED % ("leak", "high", "unacknowledged"), "values": "1 1 stale"},
        {"series": ANNOUNCED % ("leak", "high", "returned_unacknowledged"), "values": "_ _ 1 stale"},
        {"series": ANNOUNCED % ("weak", "medium", "unacknowledged"), "values": "1x5"},
        {"series": ANNOUNCED % ("drift", "advisory", "unacknowledged"), "values": "1x5"},
        {"series": ANNOUNCED % ("seen", "high", "acknowledged"), "values": "1x5"},
        {"series": 'hrs_twin_data_age_seconds{twin="old", source="measured"}', "values": "30+60x5"},
        {"series": 'hrs_twin_data_age_seconds{twin="new", source="simulated"}', "values": "1x5"},
        {"series": 'hrs_twin_alarms{twin="a", priority="low", state="unacknowledged"}', "values": "6x5"},
        {"series": 'hrs_twin_alarms{twin="a", priority="high", state="acknowledged"}', "values": "5x5"},
        {"series": 'hrs_twin_alarms{twin="b", priority="low", state="shelved"}', "values": "50x5"},
        {"series": 'hrs_store_bytes{instance="full"}', "values": "91x9"},
        {"series": 'hrs_store_bytes_max{instance="full"}', "values": "100x9"},
        {"series": 'hrs_store_bytes{instance="free"}', "values": "89x9"},
        {"series": 'hrs_store_bytes_max{instance="free"}', "values": "100x9"},
        {"series": 'hrs_twin_late_ticks_total{instance="late"}', "values": "0+12x20"},
        {"series": 'hrs_twin_late_ticks_total{instance="punctual"}', "values": "0+3x20"},
    ]
    leak, weak, drift = (
        _alert("leak", "high", "critical"),
        _alert("weak", "medium", "warning"),
        _alert("drift", "advisory", "info"),
    )
    old = {"exp_labels": {"twin": "old", "source": "measured", "severity": "critical"}}
    flood = {"exp_labels": {"twin": "a", "severity": "warning"}}
    full = {"exp_labels": {"instance": "full", "severity": "warning"}}
    late = {"exp_labels": {"instance": "late", "severity": "warning"}}
    expected = [
        ("HrsTwinAlarm", "1m", [leak, weak, drift]), ("HrsTwinAlarm", "2m", [leak, weak, drift]),
        ("HrsTwinAlarm", "3m", [weak, drift]), ("HrsTwinDataOld", "0m", []), ("HrsTwinDataOld", "2m", [old]),
        ("HrsTwinAlarmFlood", "1m", [flood]), ("HrsStoreNearlyFull", "4m", []), ("HrsStoreNearlyFull", "6m", [full]),
        ("HrsTicksLate", "12m", [late]),
    ]  # fmt: skip
    fired = [{"eval_time": time, "alertname": name, "exp_alerts": alerts} for name, time, alerts in expected]
    alerts = yaml.safe_load(ALERTS.read_text())
    for group in alerts["groups"]:
        for rule in group["rules"]:
            del rule["annotations"]  # which would have to be told word for word
    (tmp_path / "alerts.yml").write_text(yaml.safe_dump(alerts))
    document = {
        "rule_files": ["alerts.yml"], "evaluation_interval": "15s",
        "tests": [{"interval": "1m", "input_series": series, "alert_rule_test": fired}],
    }  # fmt: skip
    (tmp_path / "test.yml").write_text(yaml.safe_dump(document))
    _said(_tool("promtool"), "test", "rules", str(tmp_path / "test.yml"))
