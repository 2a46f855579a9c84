"""Figures of the window that the series show, notes on it, and its report: what the service says, for everybody."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import expect

from tests.api.page.conftest import NARROW, WIDE, overflows, violations
from tests.api.page.living import SERIES, start, until_series
from tests.waiting import wait_until

WORKERS = 0
CARD = ".window-figures"


@pytest.fixture(scope="module")
def shown(http):
    """A twin that stands still behind an hour, seen over a stretch of it."""
    start(http, "shown", until=3700)
    yield "#/live/shown?from=600&to=2400"
    http.post("/v1/twins/shown/stop")


def figures(http, **query):
    return http.get("/v1/twins/shown/figures", params=query).json()["items"]


def plain(text):
    return float(re.sub(r"[^\d.]", "", text.split("k")[0]))


@pytest.mark.slow
def test_the_window_shown_is_what_the_service_says(browse, http, shown):
    page = browse(shown)
    (item,) = figures(http, from_s=600, to_s=2400)
    dispensed = page.locator(f'{CARD} [data-figure="delivered_kg"]')
    expect(dispensed).to_contain_text("kg")
    assert plain(dispensed.text_content()) == pytest.approx(item["delivered_kg"], abs=0.051)
    served = page.locator(f'{CARD} [data-figure="vehicles_served"]')
    expect(served).to_have_text(str(item["vehicles_served"]))
    page.evaluate(f"{SERIES}.span.place(0, 1200)")
    (moved,) = figures(http, from_s=0, to_s=1200)
    assert moved["delivered_kg"] != pytest.approx(item["delivered_kg"], abs=0.1)
    expect(dispensed).to_contain_text(f"{moved['delivered_kg']:.1f}")
    page.locator(f'{CARD} select[name="by"]').select_option("hour")
    expect(page.locator(f"{CARD} tbody tr")).to_have_count(1)
    page.evaluate(f"{SERIES}.span.place(0, 3700)")
    expect(page.locator(f"{CARD} tbody tr")).to_have_count(2)


@pytest.mark.slow
def test_figures_and_the_report_are_saved(browse, http, shown, tmp_path):
    page = browse(shown)
    expect(page.locator(f"{CARD} dd").first).to_be_visible()
    for name, ending in (("CSV", "csv"), ("Parquet", "parquet"), ("Report of the window shown", "html")):
        with page.expect_download() as download:
            page.locator(CARD).get_by_role("button", name=name, exact=True).click()
        assert download.value.suggested_filename == f"shown-600-2400.{ending}"
        download.value.save_as(tmp_path / f"found.{ending}")
    wanted = http.get("/v1/twins/shown/figures", params={"from_s": 600, "to_s": 2400, "format": "csv"}).text
    assert (tmp_path / "found.csv").read_text() == wanted
    report = (tmp_path / "found.html").read_text()
    assert report.count("<svg") == 1


@pytest.mark.slow
def test_a_note_is_written_marked_and_forgotten(browse, http, shown):
    page = browse(shown, expected=["422"])  # that of a note without words
    notes = page.locator(".notes")
    expect(notes).to_contain_text("Nobody has noted anything.")
    notes.get_by_role("button", name="Note", exact=True).click()
    expect(notes.locator(".wrong").first).not_to_be_empty()
    text = "<b>valve</b> replaced"
    notes.get_by_label("Note", exact=True).fill(text)
    notes.get_by_role("button", name="On the window shown").click()
    notes.get_by_role("button", name="Note", exact=True).click()
    expect(notes.locator(".note-text")).to_have_text(text)
    (stored,) = http.get("/v1/twins/shown/notes").json()["items"]
    assert (stored["time_s"], stored["to_s"], stored["text"]) == (600, 2400, text)
    until_series(page, "s.notes.length === 1 && s.notes[0].number === 1")
    page.evaluate(f"{SERIES}.span.place(3000, 3600)")
    notes.get_by_role("button", name=re.compile("^Show")).click()
    until_series(page, "s.span.from === 300 && s.span.to === 2700")
    notes.get_by_role("button", name=re.compile("^Delete")).click()
    page.get_by_role("dialog").get_by_role("button", name="Delete it").click()
    expect(notes.locator("[data-note]")).to_have_count(0)
    assert http.get("/v1/twins/shown/notes").json()["items"] == []


def test_a_note_is_a_mark_on_the_panels(browse, http, shown):
    """The picture of a panel changes where a note is, and nowhere else."""
    page = browse(shown)
    expect(page.locator(f"{CARD} dd").first).to_be_visible()
    painted = """() => {
        const canvas = document.querySelector('.series .plot canvas');
        const { data, width, height } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
        const columns = [];
        for (let x = 0; x < width; x++) {
            let sum = 0;
            for (let at = 4 * x; at < data.length; at += 4 * width) sum = (31 * sum + data[at] + data[at + 3]) % 9973;
            columns.push(sum);
        }
        return columns;
    }"""
    before = page.evaluate(painted)
    page.evaluate(f"() => {{ const s = {SERIES}; s.notes = [{{ number: 1, time_s: 1500, to_s: null }}]; s.again(); }}")
    after = page.evaluate(painted)
    changed = [x for x, pair in enumerate(zip(before, after, strict=True)) if pair[0] != pair[1]]
    assert changed
    assert max(changed) - min(changed) < 40, "the mark and its number"


@pytest.mark.slow
@pytest.mark.parametrize(("size", "dark"), [(WIDE, False), (NARROW, True)], ids=["wide", "narrow and dark"])
def test_figures_and_notes_are_readable_for_everybody(browse, http, shown, size, dark):
    note = http.post("/v1/twins/shown/notes", json={"time_s": 700, "text": "word" * 120}).json()
    page = browse(shown, size=size, dark=dark)
    expect(page.locator(f"{CARD} dd").first).to_be_visible()
    expect(page.locator(".note-text")).to_be_visible()
    assert not overflows(page)
    assert violations(page) == []
    page.locator(f'{CARD} select[name="by"]').select_option("hour")
    expect(page.locator(f"{CARD} tbody")).to_be_visible()
    assert not overflows(page)
    assert violations(page) == []
    http.delete(f"/v1/twins/shown/notes/{note['id']}")


@pytest.mark.slow
def test_a_window_before_what_is_kept_says_since_when_and_has_the_figures_of_the_rest(browse, http, shown):
    begun = http.post("/v1/twins", json={"id": "later", "of": "shown", "at_s": 1800, "speed": "max"})
    assert begun.status_code == 201, begun.text
    wait_until(lambda: http.get("/v1/twins/later").json()["samples"] >= 4000)
    http.patch("/v1/twins/later", json={"paused": True}).raise_for_status()
    page = browse("#/live/later?from=600&to=2400", expected=["422"])
    about = page.locator(f"{CARD} > .hint")
    expect(about).to_contain_text("Nothing before 0:30:00 is kept")
    (item,) = http.get("/v1/twins/later/figures", params={"to_s": 2400}).json()["items"]
    assert item["from_s"] == 1800
    dispensed = page.locator(f'{CARD} [data-figure="delivered_kg"]')
    expect(dispensed).to_contain_text(f"{item['delivered_kg']:.1f}")
    page.evaluate(f"{SERIES}.span.place(0, 1200)")
    expect(about).to_contain_text("there are no figures of the window shown")
    expect(page.locator(f"{CARD} dd")).to_have_count(0)
    http.post("/v1/twins/later/stop")
