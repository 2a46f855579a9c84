"""Drills on the page: a fault is put in, listed, and ended; a wrong size is said at its field."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from station.measured_day import tags_of_day
from tests.waiting import wait_until


@pytest.fixture
def twin(http):
    http.post("/v1/twins", json={"id": "drills", "scenario": "S1"}).raise_for_status()
    wait_until(lambda: http.get("/v1/twins/drills").json()["samples"] > 1)
    yield "drills"
    http.post("/v1/twins/drills/stop")
    http.delete("/v1/twins/drills")


def test_a_fault_is_put_in_and_ended(browse, http, twin):
    page = browse(f"#/live/{twin}", expected=("422",))
    card = page.get_by_role("region", name="Drills")
    expect(card).to_contain_text("Nothing is wrong with this plant")
    card.get_by_label("Fault").select_option(label="compressor weak")
    card.get_by_label("Size").fill("250")
    card.get_by_role("button", name="Put in").click()
    expect(card.locator(".field", has_text="Size").locator(".wrong")).to_contain_text("100")
    card.get_by_label("Size").fill("40")
    card.get_by_label("For").fill("")
    card.get_by_role("button", name="Put in").click()
    expect(card.locator("tbody tr")).to_contain_text("compressor weak")
    (drill,) = http.get(f"/v1/twins/{twin}/drills").json()["items"]
    assert (drill["fault"]["loss_percent"], drill["end_s"]) == (40.0, None)
    wait_until(lambda: http.get(f"/v1/twins/{twin}").json()["samples"] > drill["begin_s"] + 1)
    card.get_by_role("button", name="Mend the station").click()
    expect(card.locator("tbody tr")).not_to_contain_text("for ever")
    expect(page.locator(".events")).to_contain_text("compressor weak · from")
    expect(card.get_by_label("Sensor")).to_be_hidden()
    card.get_by_label("Fault", exact=True).select_option(label="sensor drift")
    card.get_by_label("Sensor").select_option(label="temperature low")
    expect(card.locator(".field", has_text="Size").locator(".hint")).to_have_text("K/h")
    card.get_by_label("Size").fill("7")
    card.get_by_role("button", name="Put in").click()
    expect(card.locator("tbody tr").nth(1)).to_contain_text("drift temperature low")
    drift = http.get(f"/v1/twins/{twin}/drills").json()["items"][1]["fault"]
    assert (drift["sensor"], drift["drift_k_per_h"]) == ("temperature_low", 7.0)


@pytest.fixture
def follower(http):
    tags = tags_of_day().model_dump(mode="json")
    http.post("/v1/twins", json={"id": "sees", "scenario": "S1", "source": "measured", "tags": tags}).raise_for_status()
    yield "sees"
    http.post("/v1/twins/sees/stop")
    http.delete("/v1/twins/sees")


def test_of_a_fault_that_cannot_be_told_it_is_said_why(browse, http, twin, follower):
    later = http.get(f"/v1/twins/{twin}").json()["samples"] + 1000
    drift = {"kind": "sensor_drift", "sensor": "temperature_vehicle", "drift_k_per_h": 3.0, "begin_s": later}
    http.post(f"/v1/twins/{twin}/drills", json=drift).raise_for_status()
    card = browse(f"#/live/{twin}").get_by_role("region", name="Drills")
    card.get_by_label("Scored by").select_option(label=follower)
    expect(card.locator("tbody tr")).to_contain_text("cannot be told")
    expect(card).to_contain_text("drift temperature vehicle cannot be told: each vehicle brings")
