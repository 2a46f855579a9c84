"""Figures by day in the live view: what the service says, in words, also on paper."""

from __future__ import annotations

import re
import time

import pytest
from playwright.sync_api import expect

from tests.api.page.conftest import NARROW, WIDE, overflows, violations

WORKERS = 0


@pytest.fixture(scope="module")
def long(http):
    """A twin that is paused some time into its first day."""
    http.post("/v1/twins", json={"id": "long", "scenario": "S1", "speed": "max", "at_end": "repeat"})
    until = time.monotonic() + 60
    while not http.get("/v1/twins/long/days").json()["items"] or _today(http)["vehicles_served"] < 5:
        assert time.monotonic() < until
        time.sleep(0.1)
    http.patch("/v1/twins/long", json={"paused": True})
    yield "#/live/long"
    http.post("/v1/twins/long/stop")


def _today(http):
    return http.get("/v1/twins/long/days").json()["items"][-1]


def figures(page):
    """What the panel shows of the running day, by name."""
    names = page.locator(".days dt").all_text_contents()
    return dict(zip(names, page.locator(".days dd").all_text_contents(), strict=True))


def plain(text):
    return float(re.sub(r"[^\d.]", "", text.split("k")[0]))


def test_the_running_day_is_what_the_service_says(browse, http, long):
    page = browse(long)
    expect(page.locator(".days h3")).to_contain_text("Day 0 so far")
    day = _today(http)
    shown = figures(page)
    assert plain(shown["served"]) == day["vehicles_served"]
    assert plain(shown["mean wait"]) == pytest.approx(day["wait_mean_s"], abs=0.51)
    assert plain(shown["longest wait"]) == pytest.approx(day["wait_max_s"], abs=0.51)
    assert plain(shown["dispensed"]) == pytest.approx(day["delivered_kg"], abs=0.051)
    assert plain(shown["energy"]) == pytest.approx(day["energy_kwh"], abs=0.051)
    assert plain(shown["compressor starts"]) == day["compressor_starts"]
    expect(page.locator(".days .hint")).to_contain_text("counted from the twin's start")


@pytest.mark.slow
def test_past_days_are_a_table_that_prints(browse, http, long):
    page = browse()
    day = _today(http)
    past = [{**day, "day": number, "from_s": number * 86_400, "to_s": (number + 1) * 86_400} for number in range(31)]
    past[30]["energy_kwh"] = past[30]["wait_mean_s"] = None
    page.route("**/days", lambda route: route.fulfill(json={"day_s": 86_400, "items": [*past, {**day, "day": 31}]}))
    page.goto(f"{page.url.split('#')[0]}{long}")
    rows = page.locator(".days tbody tr")
    expect(rows).to_have_count(31)
    expect(rows.first.locator("th")).to_have_text("30")
    column = page.locator(".days thead th").all_text_contents().index("mean wait")
    assert rows.first.locator("th, td").nth(column).text_content() == "\N{EN DASH}"
    assert "cost" not in page.locator(".days thead th").all_text_contents(), "no money without a tariff"
    page.emulate_media(media="print")
    page.set_viewport_size({"width": 1000, "height": 900})
    box = page.locator(".days .scroll").evaluate("box => [box.scrollWidth, box.clientWidth]")
    assert box[0] <= box[1] + 1, "nothing is cut off on paper"


def test_money_stands_where_the_station_has_a_tariff(browse, http, long):
    page = browse()
    bill = {
        "energy_eur": 51.25,
        "demand_eur": 12.5,
        "stock_eur": None,
        "total_eur": 63.75,
        "eur_per_kg": 0.5551,
        "peak_kw": 35.44,
    }
    running = {**_today(http), **bill}
    page.route("**/days", lambda route: route.fulfill(json={"day_s": 86_400, "items": [running]}))
    page.goto(f"{page.url.split('#')[0]}{long}")
    expect(page.locator(".days dt", has_text="demand charge")).to_be_visible()
    shown = figures(page)
    said = {name: shown[name].replace("\u202f", " ").replace("\xa0", " ") for name in shown}
    assert said["energy cost"] == "51.25 EUR"
    assert said["stock to restore"] == "\N{EN DASH}"
    assert said["cost of a kilogram"] == "0.555 EUR/kg"
    assert said["peak of a quarter"] == "35.4 kW"


@pytest.mark.slow
@pytest.mark.parametrize("size", [WIDE, NARROW], ids=["wide", "narrow"])
def test_the_panel_is_readable_for_everybody(browse, long, size):
    page = browse(long, size=size)
    expect(page.locator(".days dl")).to_be_visible()
    assert not overflows(page)
    assert violations(page) == []
