"""docs/api.md names every path and kind of problem there is, docs/operations.md every setting and metric."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from api.http import problems
from api.metrics import ServiceMetrics
from api.server import connections
from api.server.app import create_app
from api.settings import Settings
from api.settings_table import table

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "api.md").read_text()
OPERATIONS = (ROOT / "docs" / "operations.md").read_text()


def test_every_setting_is_explained_as_it_is():
    shown = OPERATIONS.split("## Settings\n")[1]
    assert "| setting |" + shown.split("| setting |")[1].strip("\n") == table(), (
        "python -m api.settings_table prints it"
    )


def test_every_metric_is_explained():
    ours = {metric.name for metric in ServiceMetrics().registry.collect() if metric.name.startswith("hrs_")}
    for name in ("services.py", "gauges.py", "twin_gauges.py"):
        ours |= set(re.findall(r'Gauge\(\s*"(hrs_\w+)"', (ROOT / "api" / "server" / name).read_text()))
    told = set(re.findall(r"`(hrs_\w+)`", OPERATIONS.split("## Metrics\n")[1].split("\n## ")[0]))
    assert {name.removesuffix("_total") for name in told} == ours


def test_every_kind_of_problem_is_explained():
    source = "".join(path.read_text() for path in (ROOT / "api").rglob("*.py"))
    raised = set(re.findall(r'HTTPStatus\.\w+,\s*"([a-z-]+)"', source)) | {kind for kind, _ in problems._KINDS.values()}
    raised |= {kind for kind, _, _ in connections._REFUSALS.values()}
    table = PAGE.split("| status | when |")[1].split("\n\n")[0]
    assert raised == set(re.findall(r"^\| `([a-z-]+)`", table, re.MULTILINE))


@pytest.mark.slow
def test_every_path_is_named(tmp_path):
    app = create_app(Settings(data=tmp_path))
    missing = []
    for path in app.openapi()["paths"]:
        resource = "/".join(path.split("/")[:3])
        last = [part for part in path.split("/") if part and not part.startswith("{")][-1]
        if not (re.search(rf"{resource}\b", PAGE) and re.search(rf"/{last}\b", PAGE)):
            missing.append(path)
    assert missing == []
    app.state.services.database.close()
    app.state.services.twins.close()
