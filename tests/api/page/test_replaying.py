"""A replay on the page: begun from the window that is shown, with picture, series and events of the other twin."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from tests.api.page.conftest import NARROW, WIDE, overflows, violations
from tests.api.page.living import clock, figure, rows_shown, start, until_series
from tests.waiting import wait_until

WORKERS = 0
UNTIL = 700


@pytest.fixture(scope="module")
def original(http):
    """A twin that has told UNTIL seconds or some more, and stands still."""
    return start(http, "first", until=UNTIL)


@pytest.mark.slow
def test_a_stretch_is_played_as_it_was(browse, original, http):
    page = browse("#/live/first")
    until_series(page, f"s.table[0].length >= {UNTIL - 110}")
    shown = rows_shown(page)
    page.locator(".replay summary").click()
    form = page.locator('form[name="replay"]')
    form.get_by_role("button", name="The window shown").click()
    last = original["samples"] - 1
    assert form.locator('[name="to_s"]').input_value() == str(last)
    first = int(form.locator('[name="from_s"]').input_value())
    form.locator('[name="speed"]').fill("max")
    form.get_by_role("button", name="Replay", exact=True).click()
    expect(page.locator(".twin-head .tag.source")).to_have_text("replay")
    expect(page.locator(".facts")).to_contain_text(f"Plays {clock(first)} to {clock(last)} of first")
    expect(page.locator(".twin-head .tag").first).to_have_text("finished")
    twin = page.locator("h1").text_content()
    whole = f"s.table[0].filter((time) => time >= {first}).length === {last - first + 1}"
    until_series(page, f"{whole} && s.table[0].at(-1) === {last}")
    played = rows_shown(page)
    begin = shown["time"].index(played["time"][0])
    for name, figures in played.items():
        assert figures == shown[name][begin : begin + len(figures)], name
    expect(page.locator(".schematic .clock")).to_have_text(clock(last))
    assert figure(page, "pressure_high") == f"{original['values']['pressure_high']:.1f} bar"
    expect(page.locator(".events li.fill_start").first).to_be_visible()
    expect(page.locator(".days")).to_have_count(0)
    assert http.get(f"/v1/twins/{twin}").json()["of"] == "first"


def test_a_stretch_that_was_not_told_is_said_at_its_field(browse, original):
    page = browse("#/live/first", expected=("422",))
    page.locator(".replay summary").click()
    form = page.locator('form[name="replay"]')
    form.locator('[name="to_s"]').fill("100000000")
    form.get_by_role("button", name="Replay", exact=True).click()
    expect(form.locator(".field", has=page.locator('[name="to_s"]')).locator(".wrong")).to_contain_text(
        "must be at most"
    )


@pytest.mark.slow
@pytest.mark.parametrize(("size", "dark"), [(WIDE, False), (NARROW, True)], ids=["wide", "narrow-dark"])
def test_a_replay_is_paused_given_another_speed_and_read_by_everybody(browse, original, http, size, dark):
    order = {"id": f"again{size['width']}", "source": "replay", "of": "first", "from_s": 30, "speed": 1}
    assert http.post("/v1/twins", json=order).status_code == 201
    path = f"/v1/twins/{order['id']}"
    page = browse(f"#/live/{order['id']}", size=size, dark=dark)
    page.get_by_role("button", name="Pause").click()
    expect(page.locator(".twin-head .tag").first).to_have_text("paused")
    assert http.get(path).json()["state"] == "paused"
    for gone in ('form[name="vehicle"]', 'form[name="controller"]', ".tag.service"):
        expect(page.locator(gone)).to_have_count(0)
    page.locator('form[name="speed"] input').fill("50")
    page.locator('form[name="speed"]').get_by_role("button", name="Set").click()
    wait_until(lambda: http.get(path).json()["speed"] == 50)
    page.get_by_role("button", name="Continue").click()
    until_series(page, "s.table[0].at(-1) > 60")
    page.locator(".replay summary").click()
    assert not overflows(page)
    assert violations(page) == []
