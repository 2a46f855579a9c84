"""Scenarios of a user's own in the page: stored, listed, edited, used, deleted; no change is lost, whoever makes it."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from tests.api.conftest import ended
from tests.api.page.conftest import NARROW, WIDE, overflows, violations
from tests.api.page.test_scenarios import field

LONG = "a" * 64


@pytest.fixture
def stored(http):
    """A stored scenario `evening`, for one test."""
    arrivals = {"kind": "uniform", "count": 3, "period_s": 900}
    http.put("/v1/scenarios/evening", json={"name": "evening", "about": "three", "arrivals": arrivals})
    yield "#/scenarios/evening"
    http.delete("/v1/scenarios/evening")


@pytest.fixture
def evening(browse, stored):
    page = browse(stored, expected=("422", "412", "409", "404"))
    expect(page.locator(".tag.good")).to_be_visible()
    expect(page.locator(".storing")).to_contain_text("Stored as evening.")
    return page


def store(page):
    page.locator(".storing").get_by_role("button", name="Store", exact=True).click()


def dirty(page):
    return page.locator(".storing", has_text="Changes that are not stored")


@pytest.mark.slow
def test_one_is_stored_listed_used_and_deleted(browse, http):
    page = browse("#/scenarios/S1", expected=("422", "409", "404"))
    expect(page.locator(".tag.good")).to_be_visible()
    field(page, "arrivals.count").fill("2")
    expect(dirty(page)).to_be_visible()
    field(page, "name").fill("S1")
    expect(page.locator(".tag.good")).to_be_visible()
    store(page)
    expect(page.locator("#scenario-name-wrong")).to_contain_text("ships with the service")
    field(page, "name").fill("äöü")
    expect(page.locator(".tag.good")).to_be_visible()
    store(page)
    expect(page.locator("#scenario-name-wrong")).to_contain_text("letters, digits")
    field(page, "name").fill(LONG)
    field(page, "about").fill("two")
    expect(page.locator(".tag.good")).to_be_visible()
    store(page)
    page.wait_for_url(f"**/#/scenarios/{LONG}")
    assert http.get(f"/v1/scenarios/{LONG}").json()["arrivals"]["count"] == 2
    row = page.locator(".own tbody tr")
    expect(row).to_have_count(1)
    expect(row).to_contain_text("two")
    assert not overflows(page)

    page.goto(f"{page.url.split('#')[0]}#/compare")
    box = page.locator(f'input[name=scenario][value="{LONG}"]')
    expect(box).not_to_be_checked()
    for name in ("S1", "S2", "S3", "S4"):
        page.locator(f'input[name=scenario][value="{name}"]').uncheck()
    box.check()
    for name in ("minlp1", "minlp2", "minlp3"):
        page.locator(f'input[name=controller][value="{name}"]').uncheck()
    assert not overflows(page)
    page.get_by_role("button", name="Compare", exact=True).click()
    page.wait_for_url("**/#/compare/*")
    job = ended(http, f"/v1/comparisons/{page.url.rsplit('/', 1)[-1]}")
    assert (job["scenarios"], job["state"]) == ([LONG], "succeeded")

    page.goto(f"{page.url.split('#')[0]}#/live")
    form = page.locator("form[name=start]")
    form.get_by_label("Name").fill("mine")
    form.get_by_label("Scenario").select_option(LONG)
    form.get_by_role("button", name="Start the twin").click()
    page.wait_for_url("**/#/live/mine")
    assert http.get("/v1/twins/mine").json()["scenario"] == LONG
    http.post("/v1/twins/mine/stop")

    page.goto(f"{page.url.split('#')[0]}#/scenarios/{LONG}")
    expect(page.locator(".tag.good")).to_be_visible()
    page.locator(".storing").get_by_role("button", name="Delete").click()
    page.get_by_role("dialog").get_by_role("button", name="Cancel").click()
    assert http.get(f"/v1/scenarios/{LONG}").status_code == 200
    page.locator(".storing").get_by_role("button", name="Delete").click()
    page.get_by_role("dialog").get_by_role("button", name="Delete").click()
    page.wait_for_url("**/#/scenarios/S1")
    assert http.get(f"/v1/scenarios/{LONG}").status_code == 404
    expect(page.locator(".own")).to_contain_text("None yet")


@pytest.mark.slow
def test_an_edited_one_is_stored_as_it_was_read(evening, http):
    field(evening, "arrivals.count").fill("4")
    expect(evening.locator(".tag.good")).to_be_visible()
    expect(field(evening, "about")).to_have_value("three")  # the user's own words
    store(evening)
    expect(evening.locator(".storing")).to_contain_text("Stored as evening.")
    assert http.get("/v1/scenarios/evening").json()["arrivals"]["count"] == 4
    field(evening, "arrivals.count").fill("5")
    store(evening)
    expect(evening.locator(".storing")).to_contain_text("Stored as evening.")
    assert http.get("/v1/scenarios/evening").json()["arrivals"]["count"] == 5


@pytest.mark.slow
@pytest.mark.parametrize("choice", ["Replace theirs by mine", "Take theirs, drop mine", "another name"])
def test_a_conflict_is_told_and_nothing_is_lost(evening, http, choice):
    theirs = {**http.get("/v1/scenarios/evening").json(), "about": "theirs"}
    field(evening, "about").fill("mine")
    assert http.put("/v1/scenarios/evening", json=theirs).status_code == 200
    store(evening)
    told = evening.locator(".storing [role=alert]")
    expect(told).to_contain_text("evening was changed in the meantime by somebody else")
    expect(field(evening, "about")).to_have_value("mine")
    assert http.get("/v1/scenarios/evening").json()["about"] == "theirs"
    if choice == "another name":
        field(evening, "name").fill("evening-mine")
        store(evening)
        evening.wait_for_url("**/#/scenarios/evening-mine")
        assert http.get("/v1/scenarios/evening-mine").json()["about"] == "mine"
        assert http.get("/v1/scenarios/evening").json()["about"] == "theirs"
        http.delete("/v1/scenarios/evening-mine")
        return
    evening.get_by_role("button", name=choice).click()
    wanted = "mine" if choice.startswith("Replace") else "theirs"
    expect(evening.locator(".storing")).to_contain_text("Stored as evening.")
    expect(told).to_be_empty()
    expect(field(evening, "about")).to_have_value(wanted)
    assert http.get("/v1/scenarios/evening").json()["about"] == wanted


@pytest.mark.slow
def test_one_that_was_deleted_meanwhile_can_be_stored_anew(evening, http):
    field(evening, "about").fill("mine")
    http.delete("/v1/scenarios/evening")
    store(evening)
    expect(evening.locator(".storing [role=alert]")).to_contain_text("evening was deleted in the meantime")
    evening.get_by_role("button", name="Store it anew").click()
    expect(evening.locator(".storing")).to_contain_text("Stored as evening.")
    assert http.get("/v1/scenarios/evening").json()["about"] == "mine"


@pytest.mark.slow
def test_changes_outlast_a_reload_and_can_be_discarded(evening, http):
    field(evening, "arrivals.count").fill("9")
    expect(dirty(evening)).to_be_visible()
    evening.reload()
    expect(field(evening, "arrivals.count")).to_have_value("9")
    expect(dirty(evening)).to_be_visible()
    evening.get_by_label("Begin with").select_option("S2")  # another one, and back
    expect(field(evening, "name")).to_have_value("S2")
    evening.goto(f"{evening.url.split('#')[0]}#/scenarios/evening")
    expect(field(evening, "arrivals.count")).to_have_value("9")
    evening.get_by_role("button", name="Discard changes").click()
    expect(field(evening, "arrivals.count")).to_have_value("3")
    evening.reload()
    expect(field(evening, "arrivals.count")).to_have_value("3")
    assert http.get("/v1/scenarios/evening").json()["arrivals"]["count"] == 3


def test_where_there_is_no_room_for_a_draft_the_page_asks_before_it_is_left(evening):
    full = "throw new DOMException('full', 'QuotaExceededError')"
    evening.evaluate(f"() => {{ Storage.prototype.setItem = () => {{ {full}; }}; }}")
    field(evening, "arrivals.count").fill("9")
    expect(evening.locator(".storing")).to_contain_text("too much to outlast a reload")
    asked = []
    evening.on("dialog", lambda dialog: (asked.append(dialog.type), dialog.accept()))
    evening.reload()
    assert asked == ["beforeunload"]


@pytest.mark.slow
@pytest.mark.parametrize("size", [WIDE, NARROW], ids=["wide", "narrow"])
def test_the_list_is_readable_for_everybody(browse, stored, size):
    page = browse(stored, size=size)
    expect(page.locator(".own tbody tr").first).to_be_visible()
    assert not overflows(page)
    assert violations(page) == []
