"""Alarms on the page: listed, counted in the title, acknowledged, put aside with a reason, and taken back."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import expect

from tests.api.test_alarms import with_rules
from tests.waiting import wait_until


@pytest.fixture
def twin(http):
    order = {"id": "alarms", "scenario": with_rules(), "speed": 50, "at_end": "idle"}
    http.post("/v1/twins", json=order).raise_for_status()
    wait_until(lambda: http.get("/v1/twins/alarms").json()["samples"] > 80)
    http.patch("/v1/twins/alarms", json={"paused": True}).raise_for_status()
    yield "alarms"
    http.post("/v1/twins/alarms/stop")
    http.delete("/v1/twins/alarms")


@pytest.mark.slow
def test_an_alarm_is_acknowledged_put_aside_and_taken_back(browse, http, twin):
    page = browse(f"#/live/{twin}")
    card = page.get_by_role("region", name="Alarms")
    early = card.locator("li[data-name=early]")
    expect(early).to_contain_text("unacknowledged")
    expect(early).to_contain_text("fill duration 61 s, limit above 60 s")
    expect(early).to_contain_text("Something Look")
    waiting = http.get(f"/v1/twins/{twin}").json()["alarms"]["unacknowledged"]
    expect(page).to_have_title(re.compile(rf"^\({waiting}\) "))
    early.get_by_role("button", name="Acknowledge").focus()
    page.keyboard.press("Enter")
    expect(early.locator(".tag").nth(1)).to_have_text("acknowledged")
    expect(early).to_contain_text("by local")
    early.get_by_role("button", name="Put aside").click()
    dialog = page.get_by_role("dialog")
    dialog.get_by_label("For").select_option("28800")
    dialog.get_by_role("button", name="Put aside").click()
    expect(dialog).to_be_visible()  # a reason is asked for
    dialog.get_by_label("Reason").fill("being mended")
    dialog.get_by_role("button", name="Put aside").click()
    expect(early).to_contain_text("by local, being mended, until")
    shelved = next(each for each in http.get(f"/v1/twins/{twin}/alarms").json()["items"] if each["name"] == "early")
    assert (shelved["state"], shelved["reason"]) == ("shelved", "being mended")
    expect(page.locator(".events")).to_contain_text("It is so (high) · shelved · by local · being mended")
    early.get_by_role("button", name="Take back").click()
    expect(early.locator(".tag").nth(1)).to_have_text("unacknowledged")
    page.goto(page.url.partition("#")[0] + "#/live")
    expect(page.locator(".twin-card", has_text=twin).locator(".tag.priority.high")).to_have_text(re.compile("alarm"))
    expect(page).to_have_title("Live · hrs-twin")


def test_a_twin_that_ends_shows_none(browse, http, twin):
    page = browse(f"#/live/{twin}")
    expect(page.get_by_role("region", name="Alarms")).to_be_visible()
    http.post(f"/v1/twins/{twin}/stop").raise_for_status()
    expect(page.locator("section.alarms")).to_be_hidden()
    expect(page).to_have_title("Live · hrs-twin")
