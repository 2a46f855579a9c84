"""Long lists and long names: search, filter and pages, kept in the address; the form in reach; nothing runs over."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from tests.api.page.conftest import NARROW, WIDE, overflows, violations

WORKERS = 0

MANY = 50
LONG = "a" * 31
SCENARIO = "W" * 64


@pytest.fixture(scope="module")
def many(http):
    """Fifty twins that stand still: some stopped, one with the longest names there can be."""
    scenario = {**http.get("/v1/scenarios/S1").json(), "name": SCENARIO}
    for number in range(MANY - 1):
        answer = http.post("/v1/twins", json={"id": f"many-{number:02}", "scenario": "S1", "paused": True})
        assert answer.status_code == 201, answer.text
    assert http.post("/v1/twins", json={"id": LONG, "scenario": scenario, "paused": True}).status_code == 201
    for number in range(5):
        assert http.post(f"/v1/twins/many-{number:02}/stop").is_success


def test_fifty_twins_are_searched_filtered_and_paged(browse, many):
    page = browse("#/live")
    cards = page.locator(".twin-card")
    expect(cards).to_have_count(9)
    expect(page.locator(".pages .count")).to_have_text("1 to 9 of 50")
    page.get_by_role("button", name="Next page").click()
    expect(page.get_by_role("link", name="Open many-09")).to_be_visible()
    page.get_by_label("Show twins").select_option("stopped")
    expect(cards).to_have_count(5)
    page.get_by_label("Search twins").fill("many-03")
    expect(cards).to_have_count(1)
    page.reload()
    expect(cards).to_have_count(1)
    expect(page.get_by_label("Search twins")).to_have_value("many-03")
    page.get_by_label("Search twins").fill("")
    page.get_by_label("Show twins").select_option("paused")
    expect(page.locator(".pages .count")).to_have_text("1 to 9 of 45")
    expect(cards.locator(".tag", has_text="paused")).to_have_count(9)
    page.get_by_role("button", name="Start a twin").first.click()
    expect(page.get_by_label("Name")).to_be_focused()
    expect(page.get_by_label("Name")).to_be_in_viewport()


@pytest.mark.slow
@pytest.mark.parametrize("size", [WIDE, NARROW], ids=["wide", "narrow"])
def test_the_longest_names_run_over_nothing(browse, many, size):
    page = browse(f"#/live?find={LONG}", size=size)
    expect(page.locator(".twin-card")).to_contain_text(SCENARIO)
    assert not overflows(page)
    assert violations(page) == []
    page.goto(page.url.split("#")[0] + f"#/live/{LONG}")
    expect(page.locator(".facts")).to_contain_text(SCENARIO)
    assert not overflows(page)
