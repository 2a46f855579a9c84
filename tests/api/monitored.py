"""The files of api/bridges/monitoring/ as tests read them."""

from __future__ import annotations

import json
import re
from pathlib import Path

import yaml

from tests.api.test_alarms import TEXTS, with_rules

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "api" / "bridges" / "monitoring"
PROMETHEUS = FOLDER / "prometheus" / "prometheus.yml"
ALERTS = FOLDER / "prometheus" / "alerts.yml"
ALERTMANAGER = FOLDER / "alertmanager" / "alertmanager.yml"
DASHBOARD = json.loads((FOLDER / "grafana" / "dashboards" / "hrs-twin.json").read_text())
PANELS = [panel for panel in DASHBOARD["panels"] if panel["type"] != "row"]
TARGETS = [target for panel in PANELS for target in panel["targets"]]
QUERIES = [target["expr"] for target in TARGETS if "expr" in target]
REST = [target for target in TARGETS if "url" in target]

ALARM = {"name": "filled", "signal": "fill_duration", "above": 5.0, "priority": "high", **TEXTS}
"""Begins with the sixth second of a fill, and ends with it."""

ALARMED = {"id": "alarmed", "scenario": with_rules([ALARM]), "controller": "logic", "speed": 50, "at_end": "idle"}
"""A twin that has this alarm soon."""


def rules():
    """Every alerting rule."""
    return [rule for group in yaml.safe_load(ALERTS.read_text())["groups"] for rule in group["rules"]]


def variables():
    """What the dashboard asks Prometheus for the values of its variables: metric with its selector, and label."""
    asked = [each["query"]["query"] for each in DASHBOARD["templating"]["list"] if each["type"] == "query"]
    return [re.fullmatch(r"label_values\((.+), (\w+)\)", query).groups() for query in asked]


def filled_in(text):
    """A query or address of the dashboard with values of its variables."""
    values = {"twin": "alarmed", "followed": "followed", "last_s": "3600", "__rate_interval": "5m"}
    found = re.sub(r"\$(\w+)", lambda name: values[name[1]], text)
    assert "$" not in found
    return found


def own_names(expression):
    """Names of metrics of the service in a PromQL expression, with the labels that it selects by."""
    found = re.findall(r"\b((?:hrs|process|python)_\w+)(?:\{([^}]*)\})?", expression)
    return [(name, set(re.findall(r"(\w+)(?:=~|!~|!=|=)", selector))) for name, selector in found]
