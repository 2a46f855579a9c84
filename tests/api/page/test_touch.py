"""Fingers on the charts: two zoom about their middle, one pans, and the keys still do the same."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from tests.api.conftest import ended
from tests.api.page.conftest import NARROW, overflows
from tests.waiting import wait_until

SPAN = "(({ from, to }) => [from, to])(document.querySelector('.series').series.span)"


class Hand:
    """Fingers at (x, y) within an element, as a touch screen tells them."""

    def __init__(self, page, element) -> None:
        element.scroll_into_view_if_needed()
        box = element.bounding_box()
        self.left, self.top, self.width = box["x"], box["y"], box["width"]
        self._session = page.context.new_cdp_session(page)

    def __call__(self, kind, *places) -> None:
        points = [{"x": self.left + x, "y": self.top + y, "id": number} for number, (x, y) in enumerate(places)]
        self._session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    def drag(self, begin, end, steps=8) -> None:
        """From places to places, every finger at once."""
        self("touchStart", *begin)
        for step in range(1, steps + 1):
            share = step / steps
            self(
                "touchMove",
                *(
                    tuple(a + share * (b - a) for a, b in zip(*pair, strict=True))
                    for pair in zip(begin, end, strict=True)
                ),
            )
        self("touchEnd")


@pytest.fixture(scope="module")
def twin(http):
    http.post("/v1/twins", json={"id": "touched", "scenario": "S1", "speed": "max", "at_end": "repeat"})
    wait_until(lambda: http.get("/v1/twins/touched").json()["samples"] >= 2000)
    http.post("/v1/twins/touched/stop")


@pytest.fixture
def page(browse, twin):
    opened = browse("#/live/touched", size=NARROW)
    wait_until(lambda: opened.evaluate("(document.querySelector('.series')?.series.table[0].length ?? 0) > 300"))
    opened.evaluate("document.querySelector('.series').series.span.place(800, 1400)")
    return opened


@pytest.mark.slow
def test_two_fingers_zoom_about_their_middle(page):
    hand = Hand(page, page.locator(".u-over").first)
    second = 600 / hand.width
    hand.drag([(80, 60), (160, 60)], [(40, 60), (200, 60)])  # twice as far apart
    begin, end = page.evaluate(SPAN)
    assert end - begin == pytest.approx(300, abs=2)
    middle = 800 + 120 * second
    assert begin + 120 / hand.width * (end - begin) == pytest.approx(middle, abs=2)
    hand.drag([(40, 60), (200, 60)], [(80, 60), (160, 60)])
    assert page.evaluate(SPAN) == [pytest.approx(800, abs=4), pytest.approx(1400, abs=4)]
    hand.drag([(100, 30), (110, 60)], [(100, 20), (110, 70)])  # steep: how far apart is what counts
    begin, end = page.evaluate(SPAN)
    assert 250 < end - begin < 500


def test_one_finger_pans_and_a_second_goes_on_from_there(page):
    hand = Hand(page, page.locator(".u-over").first)
    second = 600 / hand.width
    hand.drag([(150, 60)], [(90, 60)])
    assert page.evaluate(SPAN) == [pytest.approx(800 + 60 * second, abs=2), pytest.approx(1400 + 60 * second, abs=2)]
    before = page.evaluate(SPAN)
    hand("touchStart", (150, 60))
    hand("touchStart", (150, 60), (50, 60))  # the second finger alone moves nothing
    assert page.evaluate(SPAN) == before
    hand("touchMove", (120, 60), (20, 60))  # both together pan
    begin, end = page.evaluate(SPAN)
    assert (begin, end - begin) == (pytest.approx(before[0] + 30 * second, abs=2), pytest.approx(600))
    hand("touchEnd")
    expect(page.locator(".follow")).to_have_attribute("aria-pressed", "false")
    page.locator(".panels").focus()
    page.keyboard.press("Home")
    page.keyboard.press("+")
    begin, end = page.evaluate(SPAN)
    assert (begin, end) == (pytest.approx(150, abs=2), pytest.approx(450, abs=2))
    page.keyboard.press("End")
    expect(page.locator(".follow")).to_have_attribute("aria-pressed", "true")
    assert not overflows(page)


@pytest.mark.slow
def test_the_schedule_is_zoomed_by_fingers_too(browse, http):
    path = http.post("/v1/comparisons", json={"scenarios": ["S1"], "controllers": ["logic"]}).headers["location"]
    ended(http, path)
    page = browse(f"#/compare/{path.rsplit('/', maxsplit=1)[-1]}", size=NARROW)
    page.get_by_role("button", name="Show the schedule").click()
    expect(page.locator(".gantt svg [data-run]")).to_have_count(1)

    def shown():
        return page.locator(".gantt .chart > svg").evaluate("({dataset}) => [+dataset.from, +dataset.to]")

    _, whole = shown()
    hand = Hand(page, page.locator(".gantt .chart"))
    hand.drag([(180, 80), (220, 80)], [(160, 80), (240, 80)])
    wait_until(lambda: shown()[0] > 0)
    begin, end = shown()
    assert end - begin == pytest.approx(whole / 2, rel=0.02)
    hand.drag([(220, 80)], [(260, 80)])
    wait_until(lambda: shown()[0] < begin - 1)
    assert shown()[1] - shown()[0] == pytest.approx(end - begin)
