"""Shadows on the page: they are asked for and read; and a twin goes on from a second of another."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import expect

from tests.api.page.conftest import NARROW, WIDE, overflows, violations
from tests.api.page.living import clock, start
from tests.waiting import wait_until


@pytest.fixture(scope="module")
def twin(http):
    """A twin whose stretches have been compared; it stands still."""
    start(http, "beside", scenario="S3", at_end="repeat")
    body = {"controllers": ["minlp1", "reserve"], "every_s": 300, "horizon_s": 300}
    assert http.put("/v1/twins/beside/shadow", json=body).status_code == 200
    http.patch("/v1/twins/beside", json={"paused": False, "speed": 1000})
    wait_until(lambda: http.get("/v1/twins/beside").json()["samples"] > 1300)
    http.patch("/v1/twins/beside", json={"paused": True})
    wait_until(lambda: http.get("/v1/twins/beside/shadow").json()["days"])
    wait_until(lambda: all(each["runs"] for each in http.get("/v1/twins/beside/shadow").json()["stretches"]))
    return "beside"


@pytest.mark.slow
@pytest.mark.parametrize(("size", "dark"), [(WIDE, False), (NARROW, True)], ids=["wide", "narrow-dark"])
def test_what_the_others_would_have_done_is_read(browse, http, twin, size, dark):
    page = browse(f"#/live/{twin}", size=size, dark=dark)
    card = page.get_by_role("region", name="What the others would have done", exact=True)
    expect(card.locator(".advice").first).to_have_text(re.compile(r"better in \d+ of \d+ stretches"))
    (day,) = http.get(f"/v1/twins/{twin}/shadow").json()["days"]
    assert card.locator(".advice").all_inner_texts() == [each["words"] for each in day["sums"]]
    rows = card.locator("table").first.locator("tbody tr")
    assert [text.partition(": ")[2] for text in rows.locator("th").all_inner_texts()] == [
        each["controller"] for each in day["sums"]
    ]
    card.locator("summary").press("Enter")
    expect(card.locator("details td", has_text="logic (acted)").first).to_be_visible()
    assert not overflows(page)
    assert violations(page) == []


def test_it_is_asked_for_and_ended(browse, http, twin):
    start(http, "asked", scenario="S3")
    page = browse("#/live/asked", expected=("422",))
    card = page.get_by_role("region", name="What the others would have done", exact=True)
    expect(card.get_by_role("status")).to_contain_text("Nobody is held against")
    card.get_by_label("Controllers").fill("nobody")
    card.get_by_role("button", name="Compare", exact=True).click()
    expect(card.locator(".field", has_text="Controllers").locator(".wrong")).to_contain_text("nobody")
    card.get_by_label("Controllers").fill("minlp1")
    card.get_by_label("Its length").fill("20")
    card.get_by_role("button", name="Compare", exact=True).click()
    expect(card.get_by_role("status")).to_contain_text("minlp1: a stretch of 20 min every 15 min")
    assert http.get("/v1/twins/asked/shadow").json()["settings"]["horizon_s"] == 1200
    card.get_by_role("button", name="Compare no more").click()
    expect(card.get_by_role("status")).to_contain_text("Nobody is held against")


@pytest.mark.slow
def test_a_twin_goes_on_from_a_second_of_another(browse, http, twin):
    page = browse(f"#/live/{twin}", expected=("422",))
    page.locator(".replay summary").click()
    page.locator('form[name="replay"] [name="from_s"]').fill("100000000")
    form = page.locator('form[name="what-if"]')
    form.locator('[name="controller"]').fill("reserve")
    button = form.get_by_role("button", name="What if another controller had been in the slot from here")
    button.click()
    expect(page.locator('form[name="replay"] .field').first.locator(".wrong")).to_contain_text("must be at most")
    page.locator('form[name="replay"] [name="from_s"]').fill("600")
    button.click()
    expect(page.locator(".facts")).to_contain_text("controller reserve")
    expect(page.locator(".facts")).to_contain_text(f"at the end: repeat · began as {twin} at {clock(600)}")
    started = page.locator("h1").text_content()
    state = http.get(f"/v1/twins/{started}").json()
    assert (state["of"], state["at_s"], state["controller"]) == (twin, 600, "reserve")
    wait_until(lambda: http.get(f"/v1/twins/{started}").json()["samples"] > 620)
    assert http.get(f"/v1/twins/{started}/history?columns=time").json()["columns"]["time"][0] == 600.0
