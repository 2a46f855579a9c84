"""The shell around the views: nothing from elsewhere, every view by address and by keyboard, lost connections."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from playwright.sync_api import expect

from api.page.limit_words import PLACE
from station.limits import LIMITS, Limit
from tests.api.page.conftest import NARROW, WIDE, overflows, violations

FILES = Path(__file__).parents[3] / "api" / "page" / "static"
VIEWS = ("live", "compare", "certificates", "scenarios")


def test_nothing_is_loaded_from_elsewhere(http):
    page = http.get("/")
    assert page.headers["content-security-policy"].startswith("default-src 'self'")
    assert "unsafe" not in page.headers["content-security-policy"]
    for address in re.findall(r'(?:src|href)="(/[^"]+)"', page.text):
        assert http.get(address).status_code == 200, address
    assert not re.search(r"<script(?![^>]*src=)|<style|\sstyle=|\son\w+=", page.text)
    for file in (path for path in FILES.rglob("*.*") if "vendor" not in path.parts):
        assert not re.search(r"https?://(?!www\.w3\.org/2000/svg)", file.read_text()), file


def test_what_modules_import_is_there(http):
    imported = {
        ((file.parent / name).resolve(), file)
        for file in FILES.rglob("*.js")
        for name in re.findall(r'(?:from|import\()\s*"(\.[^"]+)"', file.read_text())
    }
    missing = {(path.relative_to(FILES).as_posix(), file) for path, file in imported if not path.is_file()}
    assert {path for path, _ in missing} == {PLACE}  # the one that is made
    for path, file in missing:
        assert http.get(f"/static/{path}").status_code == 200, (file, path)


@pytest.mark.slow
def test_the_module_of_limits_is_the_registry_and_is_validated_each_time(http):
    answer = http.get(f"/static/{PLACE}")
    assert answer.headers["content-type"].startswith("text/javascript")
    assert answer.headers["cache-control"] == "no-cache"
    found = json.loads(answer.text.removeprefix("export const LIMITS = ").removesuffix(";\n"))
    assert found[0] is None
    assert [each["name"] for each in found[1:]] == [limit.name.lower() for limit in Limit if limit]
    gap = next(limit for limit in LIMITS if limit.limit is Limit.GAP)
    assert found[Limit.GAP] == {"name": "gap", "title": gap.title, "equation": "7.12", "says": gap.says}
    assert found[Limit.MINIMUM_TIME]["equation"] is None
    tag = answer.headers["etag"]
    held = http.get(f"/static/{PLACE}", headers={"If-None-Match": tag})
    assert (held.status_code, held.content, held.headers["etag"]) == (304, b"", tag)
    assert http.get(f"/static/{PLACE}", headers={"If-None-Match": '"another"'}).status_code == 200
    assert http.head(f"/static/{PLACE}").headers["content-length"] == str(len(answer.content))
    assert http.post(f"/static/{PLACE}").status_code == 405


def test_the_documentation_is_served_from_here(http):
    page = http.get("/docs").text
    for address in re.findall(r'(?:src|href)="([^"]+)"', page):
        assert address.startswith("/static/")
        assert http.get(address).status_code == 200


@pytest.mark.slow
@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("size", [WIDE, NARROW], ids=["wide", "narrow"])
def test_an_empty_system_shows_every_view(browse, view, dark, size):
    page = browse(f"#/{view}", dark=dark, size=size)
    expect(page.locator("#connection")).to_have_text("connected")
    expect(page.locator("main h1")).to_be_visible()
    expect(page.locator("nav a[aria-current]")).to_have_text(view.capitalize())
    assert page.locator("main .problem").count() == 0
    assert not overflows(page)
    assert violations(page) == []


@pytest.mark.slow
def test_the_page_says_which_controllers_are_being_compiled(browse):
    page = browse()
    expect(page.locator("h1")).to_be_visible()
    left = [["guarded", "switched"], ["switched"], []]

    def answer(route):
        found = route.fetch().json()
        waiting = left.pop(0) if len(left) > 1 else left[0]
        route.fulfill(json=[{**each, "ready": each["name"] not in waiting} for each in found])

    page.route("**/v1/controllers", answer)
    page.goto(page.url.split("#")[0] + "#/compare")
    notice = page.locator("#compiling")
    expect(notice).to_contain_text("compiling guarded, switched")
    assert violations(page) == []
    expect(notice).to_contain_text("compiling switched:")
    expect(notice).to_be_hidden()


@pytest.mark.slow
def test_the_keyboard_alone_goes_through_the_views(browse):
    page = browse()
    expect(page.locator("main h1")).to_be_visible()
    page.keyboard.press("Tab")
    expect(page.locator(".skip")).to_be_focused()
    for _ in range(3):
        page.keyboard.press("Tab")
    expect(page.locator("nav a", has_text="Compare")).to_be_focused()
    page.keyboard.press("Enter")
    expect(page.locator("main h1")).to_have_text("Compare")
    expect(page.locator("main")).to_be_focused()
