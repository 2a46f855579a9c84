"""The calibration of a measured twin on the page; the service's answers are made up, and tested elsewhere."""

from __future__ import annotations

import json

import pytest
from playwright.sync_api import expect

from tests.api.measured import ORDER, batches, rows
from tests.api.page.conftest import NARROW, WIDE, overflows, violations
from tests.waiting import wait_until

WORKERS = 0
CUBE = "m\N{SUPERSCRIPT THREE}"
ID = "calibration-019a7c3f2b10a1b2c3d4"
JOB = {
    "id": ID, "state": "queued", "created": "2026-11-21T09:00:00Z", "started": None, "finished": None, "problem": None,
    "twin": "plant", "station": "thesis-fit", "from_s": 0, "to_s": 86399, "source_time": 1795252800.0,
    "version": "0.1.0", "progress": 0.0, "result": None,
}  # fmt: skip
PARAMETERS = {
    "buffers.high.volume_m3": {"value": 0.2153, "low": 0.2149, "high": 0.2157, "known": True},
    "compressor.pressure_bar": {"value": 918.23, "low": 915.91, "high": 920.52, "known": True},
    "thermal.heat_exchange_per_s": {"value": 1e-4, "low": 1e-5, "high": 1e-3, "known": False},
}
ACCEPTED = {
    "verdict": "accepted", "refused": [], "parameters": PARAMETERS, "unknown": ["thermal.heat_exchange_per_s"],
    "channels": {}, "station": {"name": "thesis-fit-calibrated"},
}  # fmt: skip
REFUSED = {**ACCEPTED, "verdict": "refused", "refused": ["pressure_high: innovations 3.020"], "station": None}
DONE = {**JOB, "state": "succeeded", "finished": "2026-11-21T09:00:09Z", "progress": 1.0}


@pytest.fixture(scope="module")
def plant(http):
    """A twin that has followed some seconds."""
    assert http.post("/v1/twins", json={**ORDER, "id": "plant"}).status_code == 201
    for number, batch in enumerate(batches(100, 50)):
        path = f"/v1/twins/plant/measurements?source=plc&sequence={number}"
        assert http.post(path, json=rows(batch)).status_code == 202
    wait_until(lambda: http.get("/v1/twins/plant").json()["samples"] > 80)
    return http.get("/v1/twins/plant").json()


@pytest.fixture
def answered(browse, plant):
    """The page of the twin, where calibrations are answered as a test wants: in turn, the last answer for good."""

    def opened(*states, listed=(), moved=None, **how):
        page = browse("#/certificates", **how)
        turns = list(states)
        asked = []

        def job(route):
            asked.append((route.request.method, route.request.url, route.request.post_data))
            if route.request.method == "GET" and "?" in route.request.url:
                return route.fulfill(json={"items": list(listed), "next": None})
            if route.request.method == "POST" and not route.request.url.endswith("/cancel"):
                return route.fulfill(status=202, json=JOB)
            return route.fulfill(json=turns.pop(0) if len(turns) > 1 else turns[0])

        page.route("**/v1/calibrations**", job)
        page.route("**/v1/calibrations/**", job)
        page.route(
            "**/v1/twins/plant/station", lambda route: (asked.append(route.request.post_data), route.fulfill(**moved))
        )
        page.evaluate("location.hash = '#/live/plant'")
        expect(page.locator("h1")).to_have_text("plant")
        return page, asked

    return opened


@pytest.mark.slow
def test_a_station_is_calibrated_told_in_words_and_put_to_use(answered, plant):
    working = {**JOB, "state": "running", "progress": 0.4}
    moved = {**plant, "station": "thesis-fit-calibrated", "calibration": ID}
    page, asked = answered(JOB, working, working, working, {**DONE, "result": ACCEPTED}, moved={"json": moved})
    card = page.locator(".calibration")
    card.get_by_role("button", name="Calibrate").click()
    expect(card).to_contain_text("40 % done: seconds 0:00:00 to 23:59:59.")
    expect(card.get_by_role("progressbar")).to_be_visible()
    expect(card.get_by_role("button", name="Cancel")).to_be_visible()
    expect(card).to_contain_text("Accepted: the model fits the part that was held out.")
    expect(card.locator("tbody tr")).to_have_count(2)
    expect(card.locator("tbody tr").first).to_have_text(
        f"High: volume0.2153\u202f{CUBE}0.2149\u202f{CUBE} to 0.2157\u202f{CUBE}"
    )
    expect(card.locator("tbody tr").nth(1)).to_contain_text("Compressor: pressure918.2\u202fbar")
    expect(card.locator(".unknown")).to_have_text("Not known: Heat exchange.")
    expect(card.get_by_role("progressbar")).to_be_hidden()
    card.get_by_role("button", name="Use it").click()
    expect(card.get_by_role("button", name="Use it")).to_be_hidden()
    expect(page.locator(".facts")).to_contain_text("station thesis-fit-calibrated")
    assert json.loads(asked[-1]) == {"calibration": ID}
    assert json.loads(next(body for method, _, body in asked[:-1] if method == "POST")) == {"twin": "plant"}


def test_a_model_that_is_refused_is_not_offered(answered):
    page, _ = answered({**DONE, "result": REFUSED}, listed=[DONE])
    card = page.locator(".calibration")
    expect(card).to_contain_text("Refused: the model does not fit, and nothing of it can be used.")
    expect(card.locator("ul.problem")).to_have_text("pressure high: innovations 3.020")
    expect(card.get_by_role("button", name="Use it")).to_be_hidden()


def test_why_a_twin_cannot_be_calibrated_stands_in_its_card(browse, plant):
    page = browse("#/live/plant", expected=("422",))
    card = page.locator(".calibration")
    card.get_by_role("button", name="Calibrate").click()
    expect(card.get_by_role("alert")).to_contain_text("must be 21600 to 86400 seconds")


@pytest.mark.slow
@pytest.mark.parametrize(("size", "dark"), [(WIDE, False), (NARROW, True)], ids=["wide", "narrow-dark"])
def test_everybody_can_read_what_was_found(answered, size, dark):
    page, _ = answered({**DONE, "result": ACCEPTED}, listed=[DONE], size=size, dark=dark)
    expect(page.locator(".calibration tbody tr")).to_have_count(2)
    assert not overflows(page)
    assert violations(page) == []
