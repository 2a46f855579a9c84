"""The compare view's schedule in a browser: dispenser and valves are those of the series, and it moves and zooms."""

from __future__ import annotations

import re
from collections import Counter

import pytest
from playwright.sync_api import expect

from tests.api.page.comparing import VALVES, data, opened


def spans(time, column) -> list[list[float]]:
    """From when to when a valve is open."""
    found = []
    for row, (since, is_open) in enumerate(zip(time, column, strict=True)):
        if is_open and (row == 0 or not column[row - 1]):
            found.append([since, time[-1]])
        if not is_open and row and column[row - 1]:
            found[-1][1] = since
    return [span for span in found if span[1] > span[0]]


def drawn(page, run, valve) -> list[list[float]]:
    """From when to when a row's blocks reach on the time axis, as its path says."""
    script = """(group, valve) => {
      const [from, to] = [group.ownerSVGElement.dataset.from, group.ownerSVGElement.dataset.to].map(Number);
      const path = group.querySelector(".rows").getAttribute("d").match(/^M(\\d+) [^H]*H(\\d+)/).slice(1).map(Number);
      const second = (path[1] - path[0]) / (to - from);
      const d = [...group.querySelectorAll(`[data-valve=${valve}] path`)].map(each => each.getAttribute("d")).join("");
      return [...d.matchAll(/M([\\d.]+) [\\d.]+H([\\d.]+)/g)]
        .map(([, a, b]) => [a, b].map(x => from + (x - path[0]) / second));
    }"""
    return page.locator(f'[data-run="{run}"]').evaluate(script, valve)


@pytest.mark.slow
def test_the_schedule_is_the_series(browse, http, done):
    page = opened(browse, done)
    page.locator("#gantt-scenario").select_option("S2")
    page.get_by_role("button", name="Show the schedule").click()
    expect(page.locator(".gantt svg [data-run]")).to_have_count(2)
    runs = data(page, ".gantt [data-run]", "controller", "run")
    table = page.locator(".gantt tbody tr")
    for row, (controller, run) in enumerate(runs):
        about = http.get(f"/v1/runs/{run}").json()
        assert (about["scenario"], about["controller"], about["replication"], about["seed"]) == ("S2", controller, 0, 3)
        columns = http.get(f"/v1/runs/{run}/series").json()["columns"]
        vehicles = http.get(f"/v1/runs/{run}/vehicles").json()["columns"]
        at = f'.gantt [data-run="{run}"]'
        assert data(page, f"{at} [data-vehicle]", "connected", "finished") == list(
            zip(vehicles["connected"], vehicles["finished"], strict=True)
        )
        assert [arrival for (arrival,) in data(page, f"{at} .arrival", "arrival")] == vehicles["arrival"]
        found = {valve: spans(columns["time"], columns[valve]) for valve in VALVES}
        assert data(page, f"{at} [data-valve]", "valve", "spans") == [(v, len(found[v])) for v in VALVES]
        cells = table.nth(row).locator("td").all_text_contents()[2:]
        for cell, valve in zip(cells, VALVES, strict=True):
            total = sum(end - since for since, end in found[valve])
            assert re.sub(r"(?<=\d)\s(?=\d)", "", cell) == f"{total:.0f}\u202fs in {len(found[valve])}"

    for _ in range(3):
        before = page.locator(".gantt output").text_content()
        page.get_by_role("button", name="Zoom in").click()
        expect(page.locator(".gantt output")).not_to_have_text(before)
    ((since, until),) = data(page, ".gantt .chart > svg", "from", "to")
    for _, run in runs:
        columns = http.get(f"/v1/runs/{run}/series").json()["columns"]
        for valve in VALVES:
            inside = [(a, b) for a, b in spans(columns["time"], columns[valve]) if since + 0.1 < a and b < until - 0.1]
            shown = [(a, b) for a, b in drawn(page, run, valve) if since + 0.1 < a and b < until - 0.1]
            assert len(shown) == len(inside)
            for ours, theirs in zip(sorted(shown), inside, strict=True):
                assert ours == pytest.approx(theirs, abs=0.05)


def _seconds(text: str) -> int:
    hours, minutes, seconds = (int(part) for part in text.split(":"))
    return 3600 * hours + 60 * minutes + seconds


@pytest.mark.slow
def test_runs_that_are_kept_are_read_again(browse, http, done):
    for _ in range(2):
        page = opened(browse, done)
        page.locator("#gantt-replication").select_option("1")
        page.get_by_role("button", name="Show the schedule").click()
        expect(page.locator(".gantt svg [data-run]")).to_have_count(2)
    runs = http.get("/v1/runs", params={"limit": 200}).json()["items"]
    asked = Counter((run["scenario"], run["controller"], run["replication"], run["seed"]) for run in runs)
    assert asked["S1", "logic", 1, 3] == asked["S1", "minlp1", 1, 3] == 1


def test_mouse_and_keys_move_and_zoom_the_schedule(browse, done):
    page = opened(browse, done)
    page.get_by_role("button", name="Show the schedule").click()
    extent, chart = page.locator(".gantt output"), page.locator(".gantt .chart")
    expect(extent).to_contain_text("0:00:00 to ")
    whole = extent.text_content()
    chart.focus()

    def after(doing) -> tuple[int, int]:
        before = extent.text_content()
        doing()
        expect(extent).not_to_have_text(before)
        since, until = (_seconds(text) for text in extent.text_content().split(" to "))
        return since, until

    keys = page.keyboard
    since, until = after(lambda: keys.press("+"))
    assert until - since == pytest.approx(_seconds(whole.split(" to ")[1]) / 2, abs=2)
    assert after(lambda: keys.press("ArrowRight"))[0] > since
    assert after(lambda: keys.press("Home"))[0] == 0
    assert after(lambda: keys.press("End"))[1] == _seconds(whole.split(" to ")[1])
    after(lambda: keys.press("0"))
    expect(extent).to_have_text(whole)
    chart.scroll_into_view_if_needed()
    box = chart.bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 60)
    keys.down("Control")
    after(lambda: page.mouse.wheel(0, -400))
    keys.up("Control")
    page.mouse.down()
    zoomed = after(lambda: page.mouse.move(box["x"] + box["width"] / 2 + 80, box["y"] + 60))
    page.mouse.up()
    assert 0 < zoomed[1] - zoomed[0] < until
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 60)
    expect(page.locator(".gantt .cursor text")).to_have_text(re.compile(r"^\d:\d\d:\d\d$"))
    page.get_by_role("button", name="Whole run").click()
    expect(extent).to_have_text(whole)
