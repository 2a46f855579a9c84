"""Many twins in a table: figures as REST has them, sorted by a column, in the address."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from tests.api.test_alarms import with_rules
from tests.waiting import wait_until


@pytest.fixture
def twins(http):
    for name, order in (("calm", {}), ("loud", {"scenario": with_rules()}), ("mute", {"scenario": "S2"})):
        http.post("/v1/twins", json={"id": name, "scenario": "S1", "speed": 1000, **order}).raise_for_status()
        wait_until(lambda name=name: http.get(f"/v1/twins/{name}").json()["samples"] > 200)
        http.patch(f"/v1/twins/{name}", json={"paused": True}).raise_for_status()
    yield
    for name in ("calm", "loud", "mute"):
        http.post(f"/v1/twins/{name}/stop")
        http.delete(f"/v1/twins/{name}")


def test_twins_are_sorted_by_what_is_wrong_and_found_again_by_their_address(browse, http, twins):
    page = browse("#/live")
    page.get_by_role("button", name="Table").click()
    table = page.get_by_role("region", name="Twins in a table")
    names = table.locator("tbody th")
    assert {"calm", "loud", "mute"} <= set(names.all_inner_texts())
    table.get_by_role("button", name="Alarms").click()
    expect(names.first).to_have_text("loud")
    expect(table.locator("th", has_text="Alarms")).to_have_attribute("aria-sort", "descending")
    row = table.locator("tbody tr", has_text="loud")
    state = http.get("/v1/twins/loud").json()
    cells = row.locator("td").all_inner_texts()
    assert cells[:2] == ["paused", "simulated"]
    assert f"{state['alarms']['announced']} alarm" in cells[6]
    assert cells[7] == f"{state['values']['queue_length']:.0f}"
    assert cells[8] == str(state["today"]["vehicles_served"])
    table.get_by_role("button", name="Twin").click()
    expect(names.first).to_have_text("calm")
    page.reload()
    expect(page.get_by_role("region", name="Twins in a table").locator("tbody th").first).to_have_text("calm")
    page.get_by_role("button", name="Cards").click()
    expect(page.locator(".twin-card").first).to_be_visible()
