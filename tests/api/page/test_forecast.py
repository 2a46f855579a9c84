"""What next, on the page: a forecast is asked for, read, drawn behind the curves, and put in the slot."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import expect

from tests.waiting import wait_until


@pytest.fixture
def twin(http):
    http.post(
        "/v1/twins",
        json={"id": "what-next", "scenario": "S3", "controller": "logic", "speed": 1000, "at_end": "repeat"},
    ).raise_for_status()
    wait_until(lambda: http.get("/v1/twins/what-next").json()["samples"] > 900)
    http.patch("/v1/twins/what-next", json={"paused": True}).raise_for_status()
    yield "what-next"
    http.post("/v1/twins/what-next/stop")
    http.delete("/v1/twins/what-next")


@pytest.mark.slow
def test_a_forecast_is_read_drawn_and_put_in_the_slot(browse, http, twin):
    page = browse(f"#/live/{twin}")
    card = page.get_by_role("region", name="What next")
    card.get_by_label("Candidates").fill("minlp1, reserve")
    card.get_by_label("Futures").fill("10")
    card.get_by_role("button", name="Forecast").click()
    expect(card.locator(".advice")).to_have_text(re.compile(r"of 10 futures"), timeout=30_000)
    found = http.get("/v1/forecasts").json()["items"][0]
    answer = http.get(f"/v1/forecasts/{found['id']}").json()["answer"]
    rows = card.locator("tbody tr")
    assert rows.locator("th").all_inner_texts() == [each["controller"] for each in answer["ranking"]]
    wait = answer["controllers"][0]["figures"]["wait"]
    acting = rows.filter(has_text="acts").inner_text()
    assert f"{wait['median']:.0f}" in acting
    expect(card.get_by_role("img", name="Pressures of the buffers in the futures")).to_be_visible()
    fan = page.evaluate("document.querySelector('.series').series.fan")
    assert (len(fan["times"]), fan["pressures"]["high"]["low"]) == (
        61,
        answer["controllers"][0]["pressures"]["high"]["low"],
    )
    rows.filter(has_text="reserve").get_by_role("button", name="Let it decide").click()
    expect(page.locator(".facts")).to_contain_text("controller reserve")
    assert http.get(f"/v1/twins/{twin}").json()["controller"] == "reserve"


@pytest.mark.slow
def test_faults_that_last_are_said_and_mended_on_demand(browse, http, twin):
    begin = http.get(f"/v1/twins/{twin}").json()["samples"] + 60
    fault = {"kind": "leak", "buffer": "high", "rate_g_per_s": 3.0, "begin_s": begin}
    http.post(f"/v1/twins/{twin}/drills", json=fault).raise_for_status()
    page = browse(f"#/live/{twin}")
    card = page.get_by_role("region", name="What next")
    card.get_by_label("Candidates").fill("logic")
    card.get_by_label("Futures").fill("3")
    card.get_by_role("button", name="Forecast").click()
    said = card.locator(".forecast-faults")
    expect(said).to_have_text(re.compile(r"In every future: leak high 3\.0\sg/s since"), timeout=30_000)
    card.get_by_label("Faults of the station").select_option(label="are mended now")
    card.get_by_role("button", name="Forecast").click()
    expect(said).to_have_text("As if the faults of the station were mended now.", timeout=30_000)


def test_a_wrong_question_is_said_at_its_field(browse, twin):
    page = browse(f"#/live/{twin}", expected=("422",))
    card = page.get_by_role("region", name="What next")
    card.get_by_label("Candidates").fill("nobody")
    card.get_by_role("button", name="Forecast").click()
    expect(card.locator(".field", has_text="Candidates").locator(".wrong")).to_contain_text("nobody")
    card.get_by_label("Look ahead").fill("0.001")
    card.get_by_label("Candidates").fill("logic")
    card.get_by_role("button", name="Forecast").click()
    expect(card.locator(".field", has_text="Look ahead").locator(".wrong")).not_to_be_empty()
