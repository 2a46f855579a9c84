"""What docs/security.md says was tried, as far as it has no place elsewhere; and that the tests it names are there."""

from __future__ import annotations

import re
from pathlib import Path

import httpx
import pytest

from api.store.database import open_database
from api.store.keys import KeyRepository
from tests.api.conftest import RunningService

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "security.md").read_text()


def test_every_test_it_names_is_there():
    named = re.findall(r"`(test_\w+)::(test_\w+)`", PAGE)
    assert len(named) > 20
    for file, function in named:
        [found] = (ROOT / "tests" / "api").rglob(f"{file}.py")
        assert f"\ndef {function}(" in found.read_text(), (file, function)
    for row in PAGE.split("| attempt |")[1].split("\n\n")[0].splitlines()[2:]:
        assert "`test_" in row, row


@pytest.fixture(scope="module")
def guarded(tmp_path_factory):
    """A service that other machines reach, and a key that may do everything."""
    folder = tmp_path_factory.mktemp("guarded")
    with open_database(f"sqlite:///{folder / 'hrs.db'}") as database:
        database.migrate()
        key = KeyRepository(database).create("ann", ["admin"])
    service = RunningService(folder, "--host", "0.0.0.0", "--workers", "0")  # noqa: S104  # what needs the key
    with httpx.Client(base_url=service.url, timeout=30, trust_env=False) as http:
        yield http, key
    service.stop()


def test_a_key_in_the_address_is_none(guarded):
    http, key = guarded
    assert http.get("/v1/runs", headers={"authorization": f"Bearer {key}"}).status_code == 200
    for name in ("key", "api_key", "access_token", "authorization"):
        assert http.get("/v1/runs", params={name: key}).status_code == 401
    assert http.get("/v1/runs", headers={"cookie": f"authorization=Bearer {key}"}).status_code == 401


@pytest.mark.parametrize("dots", ["..", "%2e%2e", "..%2f..", "%2e%2e%2f%2e%2e", "..\\..", "....//", "%252e%252e"])
def test_no_file_but_the_pages_own_is_served(guarded, dots):
    http, key = guarded
    assert http.get("/static/app.js").status_code == 200
    for wanted in ("routes.py", "page/routes.py", "etc/passwd", "settings.py"):
        path = f"/static/{dots}/{wanted}".encode()
        for headers in ({}, {"authorization": f"Bearer {key}"}):
            answer = http.send(http.build_request("GET", http.base_url.copy_with(raw_path=path), headers=headers))
            assert answer.status_code in {401, 404}, (path, answer.text[:80])
            assert "import" not in answer.text


def test_the_page_may_load_nothing_from_elsewhere(guarded):
    http, _ = guarded
    answer = http.get("/")
    policy = dict(rule.strip().split(" ", 1) for rule in answer.headers["content-security-policy"].split(";"))
    assert policy["default-src"] == "'self'"
    assert policy["frame-ancestors"] == policy["base-uri"] == "'none'"
    assert "script-src" not in policy  # scripts fall under default-src: none from elsewhere, none within the page
    assert not any("unsafe" in rule or "*" in rule or "http" in rule for rule in policy.values())
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert re.findall(r"<script(?![^>]*\bsrc=)", answer.text) == []
    assert re.findall(r"(?:src|href)=[\"']?(?:https?:)?//", answer.text) == []
