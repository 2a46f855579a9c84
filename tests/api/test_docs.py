"""docs/api.md names every setting, path and kind of problem there is."""

from __future__ import annotations

import re
from pathlib import Path

from api import problems
from api.app import create_app
from api.settings import Settings

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "api.md").read_text()


def test_every_setting_is_explained():
    table = PAGE.split("| setting | default | what |")[1].split("\n\n")[0]
    named = {name for line in table.splitlines() if "|" in line for name in re.findall(r"`(\w+)`", line.split("|")[1])}
    assert named == set(Settings.model_fields)


def test_every_kind_of_problem_is_explained():
    source = "".join(path.read_text() for path in (ROOT / "api").glob("*.py"))
    raised = set(re.findall(r'HTTPStatus\.\w+,\s*"([a-z-]+)"', source)) | {kind for kind, _ in problems._KINDS.values()}
    table = PAGE.split("| status | when |")[1].split("\n\n")[0]
    assert raised == set(re.findall(r"^\| `([a-z-]+)`", table, re.MULTILINE))


def test_every_path_is_named(tmp_path):
    app = create_app(Settings(data=tmp_path))
    missing = []
    for path in app.openapi()["paths"]:
        parts = [part for part in path.split("/") if part and not part.startswith("{")]
        if parts[-1] not in PAGE:
            missing.append(path)
    assert missing == []
    app.state.services.database.close()
    app.state.services.twins.close()
