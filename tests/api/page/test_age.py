"""The page never shows the past as the present: a service that is frozen or killed, a slow line, clocks that differ."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import time

import httpx
import pytest
from playwright.sync_api import expect

from tests.api.conftest import RunningService
from tests.api.page.conftest import WIDE
from tests.api.page.living import start
from tests.waiting import wait_until

STALE_S, RIGHT_S = 5.0, 2.0
"""Within which a page must show that it is old, and that it is so no more."""

HOUR_MS = 3_600_000
OTHERS = [("#/compare", 0), ("#/certificates", 0), ("#/scenarios", 0)]

STATE = """() => {
    const shown = document.querySelector('main');
    const moving = document.getAnimations().filter((each) => each.playState === 'running').length;
    return {
        stale: document.documentElement.classList.contains('stale'), grey: getComputedStyle(shown).filter !== 'none',
        moving, age: document.getElementById('age').textContent,
    };
}"""


@pytest.fixture(scope="module")
def mortal(tmp_path_factory):
    """A service to freeze and to kill, with a twin that runs, one that stands and a comparison that is at work."""
    running = RunningService(tmp_path_factory.mktemp("mortal"), HRS_CHECKPOINT_S="0.5")
    with httpx.Client(base_url=running.url, timeout=30, trust_env=False) as http:
        start(http, "runs", until=60)
        http.patch("/v1/twins/runs", json={"paused": False, "speed": 5})
        start(http, "rests", until=60)
    yield running
    with contextlib.suppress(ProcessLookupError):
        os.kill(running.process.pid, signal.SIGCONT)
    running.stop()


@pytest.fixture
def opened(chromium, mortal):
    """Open a place of the page; the browser's clock may go wrong."""
    with contextlib.ExitStack() as stack:

        def browse(place, wrong_ms=0):
            context = chromium.new_context(viewport=WIDE)
            stack.callback(context.close)
            context.add_init_script(f"const right = Date.now; Date.now = () => right() + {wrong_ms};")
            page = context.new_page()
            page.goto(f"{mortal.url}/{place}")
            expect(page.locator("h1")).to_be_visible()
            expect(page.locator("#connection")).to_have_text("connected")
            expect(page.locator("#age")).to_have_text(re.compile(r"^as of \d\d:\d\d:\d\d"))
            return page

        yield browse


def until_stale(page, stale):
    """How long it took until the page was stale, or was so no more [s]."""
    began = time.monotonic()
    wait_until(lambda: page.evaluate("document.documentElement.classList.contains('stale')") is stale)
    return time.monotonic() - began


@contextlib.contextmanager
def frozen(service):
    os.kill(service.process.pid, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(service.process.pid, signal.SIGCONT)


def is_present(page):
    shown = page.evaluate(STATE)
    assert not shown["stale"], shown
    assert not shown["grey"], shown
    expect(page.locator("#connection")).to_have_text("connected")


def is_past(page):
    shown = page.evaluate(STATE)
    assert shown["grey"], shown
    assert shown["moving"] == 0, shown
    assert re.fullmatch(r"as of \d\d:\d\d:\d\d, [4-9] s ago", shown["age"]), shown
    assert page.locator("#connection").text_content() != "connected"


@pytest.mark.timed
@pytest.mark.slow
def test_a_frozen_service_is_shown_as_past_and_thawed_as_present(opened, mortal):
    places = [("#/live/runs", 0), ("#/live/runs", -HOUR_MS), ("#/live", HOUR_MS), *OTHERS]
    pages = [opened(*place) for place in places]
    paused = opened("#/live/rests")
    time.sleep(1.5)
    for page in pages:
        is_present(page)
    with frozen(mortal):
        began = time.monotonic()
        paused.get_by_role("button", name="Continue").click()
        for page in pages:
            until_stale(page, stale=True)
            assert time.monotonic() - began < STALE_S
            is_past(page)
        expect(pages[0].locator(".schematic .tag")).to_contain_text("stale: as of")
        expect(paused.locator("#connection")).to_contain_text("1 command not confirmed")
        expect(paused.locator(".toast.problem")).to_contain_text("not confirmed, the service has not answered for 10 s")
        expect(paused.locator(".twin-head .tag").first).to_have_text("paused")
    began = time.monotonic()
    for page in (*pages, paused):
        until_stale(page, stale=False)
        assert time.monotonic() - began < RIGHT_S
        is_present(page)
    expect(pages[0].locator(".schematic .tag")).to_be_hidden()


@pytest.mark.timed
@pytest.mark.slow
def test_a_killed_service_is_shown_as_past_and_started_as_present(opened, mortal):
    pages = [opened(place) for place in ("#/live/runs", "#/live", "#/compare")]
    time.sleep(1.5)
    mortal.kill()
    began = time.monotonic()
    try:
        for page in pages:
            until_stale(page, stale=True)
            assert time.monotonic() - began < STALE_S
            expect(page.locator("#connection")).to_have_text("connection lost, trying again")
    finally:
        mortal.start()
    began = time.monotonic()
    for page in pages:
        until_stale(page, stale=False)
        assert time.monotonic() - began < RIGHT_S
        is_present(page)


@pytest.mark.timed
@pytest.mark.parametrize(
    "place",
    [
        *(pytest.param(place, marks=pytest.mark.slow) for place in ("#/live", "#/compare")),
        *(pytest.param(place, marks=pytest.mark.full) for place in ("#/live/runs", "#/scenarios")),
    ],
)
def test_on_a_slow_line_it_is_right_or_shown_as_late(opened, mortal, place):
    """Chromium's slow 3G: 400 kbit/s, 2 s to the first byte. The figures are compared to the service's own."""
    page = opened(place)
    session = page.context.new_cdp_session(page)
    session.send("Network.enable")
    session.send("Network.emulateNetworkConditions", {
        "offline": False, "latency": 2000, "downloadThroughput": 50_000, "uploadThroughput": 50_000,
    })  # fmt: skip
    page.reload()
    late = []
    with httpx.Client(base_url=mortal.url, timeout=30, trust_env=False) as http:
        expect(page.locator("h1")).to_be_visible(timeout=60_000)
        until = time.monotonic() + (30 if place == "#/live/runs" else 3)
        while time.monotonic() < until:
            time.sleep(0.5)
            shown = page.evaluate("""() => ({ stale: document.documentElement.classList.contains('stale'),
                clock: document.querySelector('.schematic .clock')?.textContent })""")
            if place != "#/live/runs" or not re.fullmatch(r"(\d+ d )?\d+:\d\d:\d\d", shown["clock"] or ""):
                continue
            hours, minutes, seconds = map(int, shown["clock"].split(":"))
            now = http.get("/v1/twins/runs").json()["values"]["time"]
            behind = (now - (3600 * hours + 60 * minutes + seconds)) / 5
            late.append((round(behind, 1), shown["stale"]))
            assert behind < STALE_S or shown["stale"], late
        with frozen(mortal):
            assert until_stale(page, stale=True) < STALE_S
