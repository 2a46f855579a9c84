"""A replay on the page: begun from the window that is shown, with picture, series and events of the other twin."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from station.geometry import VALVES
from tests.api.page.conftest import NARROW, WIDE, overflows, violations
from tests.api.page.living import SERIES, clock, figure, point, rows_shown, start, until_series
from tests.api.told import events
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


HOUR = 3600
PIECE = 600
"""So many seconds are shown at once, each as a row."""

BOTH = (
    "pressure_high", "pressure_medium", "pressure_low", "temperature_high", "temperature_vehicle", "flow_compressor",
    "flow_dispenser",
)  # fmt: skip
"""Figures that the picture and the keys of the series show."""

LOOK = """async ([times, names]) => {
    // Go to the first of these seconds with the cursor of the series, by its keys, then on, and read both pictures.
    const { clock } = await import('/static/lib/format.js');
    const panels = document.querySelector('.panels');
    const text = (selector) => document.querySelector(selector)?.textContent ?? null;
    const read = (selector) => {
        const found = parseFloat(text(selector));
        return Number.isNaN(found) ? null : found;
    };
    const press = (key) => panels.dispatchEvent(new KeyboardEvent('keydown', { key }));
    const frame = () => new Promise((wake) => requestAnimationFrame(wake));
    const at = (time) => text('.shown').endsWith(`cursor ${clock(time)}`);
    for (let tries = 0; tries < 100 && !at(times[0]); tries++) {
        press(text('.shown').endsWith(`cursor ${clock(times[0] - 1)}`) ? '.' : ',');
        await frame();
        await frame();
    }
    const found = [];
    for (const time of times) {
        if (time > times[0]) press('.');
        const until = performance.now() + 10000;
        const words = clock(time);
        const there = () => text('.schematic .clock') === words && at(time);
        while (!there() && performance.now() < until) await new Promise((wake) => setTimeout(wake, 2));
        found.push([
            there(),
            names.map((name) => read(`.schematic [data-value="${name}"]`)),
            names.map((name) => read(`.series [data-column="${name}"]`)),
            [...document.querySelectorAll('.schematic .valve')].map((valve) => valve.classList.contains('open')),
            text('.events [aria-current] time'),
        ]);
    }
    return found;
}"""


@pytest.mark.slow
def test_of_an_hour_picture_curves_and_events_agree_at_every_second(browse, http):
    start(http, "whole", until=HOUR + 60)
    order = {"id": "played", "source": "replay", "of": "whole", "from_s": 0, "to_s": HOUR - 1, "speed": "max"}
    assert http.post("/v1/twins", json=order).status_code == 201
    wait_until(lambda: http.get("/v1/twins/played").json()["state"] == "finished")
    stretch = {"from_s": 0, "to_s": HOUR - 1}
    told = http.get("/v1/twins/played/history", params=stretch).json()["columns"]
    stretch |= {"format": "csv", "columns": ",".join(name for name in told if name not in {"sent", "epoch"})}
    played, live = (http.get(f"/v1/twins/{name}/history", params=stretch).content for name in ("played", "whole"))
    assert played == live
    assert played.count(b"\n") == 1 + HOUR
    happened = [event["time"] for event in events(http, "/v1/twins/played") if event["kind"] != "valve_change"]
    page = browse("#/live/played")
    until_series(page, "s.table[0].length")
    expect(page.locator(".schematic .moment")).to_be_hidden()
    for begin in range(0, HOUR, PIECE):
        page.evaluate(f"{SERIES}.span.place({begin - 10}, {begin + PIECE + 10})")
        until_series(page, f"s.table[0].includes({begin}) && s.table[0].includes({begin + PIECE - 1})")
        point(page, 0.04)
        times = list(range(begin, begin + PIECE))
        for time, (there, picture, curves, valves, event) in zip(
            times, page.evaluate(LOOK, [times, list(BOTH)]), strict=True
        ):
            assert there, time
            assert picture == curves, time
            assert picture == [
                None if told[name][time] is None else pytest.approx(told[name][time], abs=0.051) for name in BOTH
            ], time
            assert valves == [bool(told[name][time]) for name in VALVES], time
            assert event == clock(max(at for at in happened if at <= time)), time
    expect(page.locator(".schematic .moment")).to_be_visible()
    page.locator(".panels").focus()
    page.keyboard.press("Escape")
    expect(page.locator(".schematic .moment")).to_be_hidden()
    expect(page.locator(".schematic .clock")).to_have_text(clock(HOUR - 1))
    expect(page.locator(".events [aria-current]")).to_have_count(0)
