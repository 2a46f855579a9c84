"""A comparison that is not whole: what is finished is shown, marked as partial, and goes on filling in."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import expect

from tests.api.conftest import ended
from tests.api.page.conftest import NARROW, WIDE, overflows, violations
from tests.waiting import wait_until

LONG = {"scenarios": ["S3", "S4"], "controllers": ["minlp1", "minlp2"], "replications": 600}


def _place(path: str) -> str:
    return f"#/compare/{path.rsplit('/', maxsplit=1)[-1]}"


def _submitted(http):
    return http.post("/v1/comparisons", json=LONG).headers["location"]


@pytest.fixture(scope="module")
def cancelled(http):
    """Path of a comparison that was cancelled when some of its runs were done."""
    path = _submitted(http)
    wait_until(lambda: http.get(path).json()["runs_done"] >= 100)
    http.post(f"{path}/cancel")
    return path


@pytest.mark.slow
def test_what_is_finished_is_shown_while_the_rest_is_computed(browse, http):
    path = _submitted(http)
    page = browse(_place(path))
    marks = page.locator("h2 .partial")
    expect(marks).to_have_count(3)
    for mark in marks.all():
        expect(mark).to_have_text(re.compile(r"^[\d\u202f]+ of 2\u202f400 runs$"))
    expect(page.locator(".coverage")).to_contain_text("Still to come:")
    expect(page.locator(".coverage li").last).to_have_text("S4 every controller")
    expect(page.locator(".working progress")).to_be_visible()
    before = marks.first.text_content()
    page.locator("input[name=axis][value=t_comp]").check()
    page.get_by_text("Choose figures").click()
    page.get_by_label("hydrogen delivered [kg]").check()
    expect(marks.first).not_to_have_text(before)
    expect(page.locator("input[name=axis][value=t_comp]")).to_be_checked()  # what was chosen stays
    expect(page.locator('[data-metric="delivered"] .bar')).not_to_have_count(0)
    expect(page.locator(".tradeoff .mark[data-scenario=S3]")).not_to_have_count(0)
    page.locator(".working").get_by_role("button", name="Cancel").click()
    expect(page.locator(".note")).to_contain_text("Cancelled after")
    expect(page.locator(".working progress")).to_have_count(0)
    job = http.get(path).json()
    expect(marks.first).to_have_text(f"{job['runs_done']:,} of 2,400 runs".replace(",", "\u202f"))
    expect(page.locator(".coverage")).to_contain_text("Not done:")
    expect(page.locator(".schedule h2")).to_be_visible()


@pytest.mark.slow
def test_what_was_cancelled_shows_the_rows_that_are_there(browse, http, cancelled):
    page = browse(_place(cancelled))
    expect(page.locator(".schedule h2")).to_be_visible()
    items = http.get(f"{cancelled}/figures").json()["items"]
    shown = page.locator('[data-metric="t_avg"] .bar').evaluate_all(
        "all => all.map(({dataset}) => [dataset.scenario, dataset.controller, Number(dataset.value)])"
    )
    assert shown == [[item["scenario"], item["controller"], item["mean"]["t_avg"]] for item in items]
    some = [item["runs"] for item in items if item["runs"] < LONG["replications"]]
    assert some
    expect(page.locator(".tables .some")).to_have_text([f"mean of {runs} of {LONG['replications']}" for runs in some])
    expect(page.locator(".tables .hint")).to_contain_text("no run of it is done yet")
    for item in items:
        if item["runs"] < LONG["replications"]:
            expect(page.locator(".coverage")).to_contain_text(f"{item['controller']} ({item['runs']} of 600)")


def test_a_whole_comparison_is_not_marked(browse, http):
    path = http.post("/v1/comparisons", json={"scenarios": ["S1"], "controllers": ["logic"]}).headers["location"]
    ended(http, path)
    page = browse(_place(path))
    expect(page.locator(".schedule h2")).to_be_visible()
    expect(page.locator(".partial:visible, .coverage:visible, .some")).to_have_count(0)


def test_the_run_that_failed_is_listed_with_its_reason(browse, http, cancelled):
    """The service's own failure is tested in tests/api/test_jobs.py; here its document is shown."""
    job = {**http.get(cancelled).json(), "state": "failed"}
    job["problem"] = {
        "title": "ControllerError",
        "detail": "controller 'mine' failed at 12 s",
        "run": {"scenario": "S3", "controller": "minlp2", "replication": 7},
    }
    page = browse()
    page.route(f"**{cancelled}", lambda route: route.fulfill(json=job))
    page.goto(f"{page.url.split('#')[0]}{_place(cancelled)}")
    cells = page.locator(".problem tbody tr").locator("th, td")
    expect(cells).to_have_text(["S3", "minlp2", "7", "ControllerError: controller 'mine' failed at 12 s"])
    expect(page.locator(".coverage")).to_contain_text("Not done:")
    expect(page.locator('[data-metric="t_avg"] .bar')).not_to_have_count(0)
    assert violations(page) == []


@pytest.mark.slow
@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("size", [WIDE, NARROW], ids=["wide", "narrow"])
def test_what_is_partial_is_readable_for_everybody(browse, cancelled, dark, size):
    page = browse(_place(cancelled), dark=dark, size=size)
    expect(page.locator(".schedule h2")).to_be_visible()
    assert not overflows(page)
    assert violations(page) == []
