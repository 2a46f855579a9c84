"""Read aloud, and on paper: valves have names, nothing speaks too often, a print is a page one would hand on."""

from __future__ import annotations

import time

import pytest
from playwright.sync_api import expect

from station.geometry import VALVES
from tests.api.page.conftest import WIDE, violations
from tests.api.page.living import start

WORKERS = 0

SPOKEN = """() => {
    window.spoken = [];
    const live = (node) => (node.nodeType === 1 ? node : node.parentElement)
        ?.closest("[aria-live]:not([aria-live=off]), [role=status], [role=alert], [role=log], [role=timer], output");
    new MutationObserver((all) => {
        for (const each of all) if (live(each.target)) window.spoken.push([performance.now(), each.target.textContent]);
    }).observe(document.body, { subtree: true, childList: true, characterData: true, attributes: false });
}"""


MOVED = """() => document.getAnimations().map(({ effect }) => effect).filter(
    ({ target }) => target.closest('.drawing')).map((effect) => [
        Object.keys(effect.getKeyframes().at(-1)).filter((name) => !/offset|easing|composite/i.test(name)),
        effect.getKeyframes()[0].easing])"""


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [3, pytest.param(10, marks=pytest.mark.slow)])
def test_valves_have_names_and_nothing_speaks_oftener_than_each_ten_seconds(browse, http, seconds):
    twin = f"aloud-{seconds}"
    start(http, twin, until=60)
    http.patch(f"/v1/twins/{twin}", json={"paused": False, "speed": 10})
    page = browse(f"#/live/{twin}")
    expect(page.locator(".schematic .clock")).not_to_have_text("\u2013")
    for valve in VALVES:
        expect(page.get_by_role("img", name=f"{valve.replace('_', ' ')} valve: ")).to_have_count(1)
    time.sleep(1)
    page.evaluate(SPOKEN)
    time.sleep(seconds)  # of ten simulated each
    assert len(page.evaluate("window.spoken")) <= 1, page.evaluate("window.spoken")
    assert violations(page) == []
    http.post(f"/v1/twins/{twin}/stop")


@pytest.mark.slow
def test_a_print_has_the_figures_and_no_controls(browse, http):
    start(http, "printed", until=600)
    page = browse("#/live/printed", size=WIDE)
    expect(page.locator(".margin-words").first).to_contain_text("hold pressure")
    page.emulate_media(media="print")
    for gone in ("nav", ".controls", ".twin-head button", "select"):
        expect(page.locator(gone).first).to_be_hidden()
    for kept in ("h1", "#age", ".schematic .drawing", ".plot canvas", ".events li", ".series .key"):
        expect(page.locator(kept).first).to_be_visible()
    http.post("/v1/twins/printed/stop")


def test_what_runs_in_a_pipe_is_moved_by_the_compositor_alone(browse, http):
    start(http, "flowing", until=30)
    http.patch("/v1/twins/flowing", json={"paused": False})
    page = browse("#/live/flowing")
    expect(page.locator(".stream.running").first).to_be_attached()
    moved = page.evaluate(MOVED)
    assert moved
    assert all(names == ["transform"] for names, _ in moved), moved
    assert all(easing.startswith("steps(") for _, easing in moved), moved
    http.patch("/v1/twins/flowing", json={"paused": True})
    expect(page.locator(".twin-head .tag").first).to_have_text("paused")
    assert page.evaluate("document.getAnimations().length") == 0
