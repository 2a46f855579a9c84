"""The live view's series in a browser: window, history, memory, and a service that is killed meanwhile."""

from __future__ import annotations

import httpx
import pytest
from playwright.sync_api import expect

from station.geometry import VALVES
from tests.api.conftest import RunningService
from tests.api.page.conftest import WIDE
from tests.api.page.living import SERIES, point, rows_shown, start, until_series
from tests.waiting import wait_until


@pytest.mark.slow
def test_the_window_looks_back_to_before_the_page_was_opened(browse, http):
    samples = start(http, "past", until=3000)["samples"]
    page = browse("#/live/past")
    until_series(page, "s.table[0].length >= 600")
    page.evaluate(f"{SERIES}.span.place(100, 400)")
    until_series(page, "s.history.whole(0, 100, 400) && s.table[0][0] <= 100")
    shown = rows_shown(page)
    stored = http.get("/v1/twins/past/history", params={"from_s": 100, "to_s": 400}).json()["columns"]
    assert shown["time"] == stored["time"]
    for name in (*VALVES, "vehicle", "queue_length"):
        assert shown[name] == stored[name], name
    assert shown["pressure_high"] == pytest.approx(stored["pressure_high"], rel=1e-6)
    page.get_by_role("button", name="all").click()
    until_series(page, f"s.span.to === {samples} && s.table[0].at(-1) >= {samples - 5}")
    expect(page.locator(".shown")).to_contain_text("least and greatest of every")
    shown = rows_shown(page)
    whole = http.get("/v1/twins/past/history", params={"columns": "pressure_vehicle,flow_dispenser"}).json()["columns"]
    assert max(filter(None, shown["flow_dispenser"])) == pytest.approx(max(whole["flow_dispenser"]), rel=1e-6)
    assert len(shown["time"]) < 1600
    page.get_by_text("These values as a table").click()
    expect(page.get_by_role("region", name="Series").locator("tbody tr").first).to_contain_text("0:00:00")
    http.post("/v1/twins/past/stop")


@pytest.mark.slow
def test_wheel_drag_and_keys_move_the_window(browse, http):
    samples = start(http, "moved", until=1500)["samples"]
    page = browse("#/live/moved")
    until_series(page, "s.table[0].length >= 600")

    def span():
        return page.evaluate(f"(({{ from, to, follow }}) => [from, to, follow])({SERIES}.span)")

    assert span() == [samples - 600, samples, True]
    over = page.locator(".u-over").first
    over.scroll_into_view_if_needed()
    box = over.bounding_box()
    middle = (box["x"] + box["width"] / 2, box["y"] + 50)
    page.mouse.move(*middle)
    page.mouse.wheel(0, 60)  # scrolls the page
    wait_until(lambda: page.evaluate("scrollY") > 0)
    assert span() == [samples - 600, samples, True]
    over.scroll_into_view_if_needed()
    box = over.bounding_box()
    middle = (box["x"] + box["width"] / 2, box["y"] + 50)
    page.mouse.move(*middle)
    page.keyboard.down("Control")
    page.mouse.wheel(0, -200)
    page.keyboard.up("Control")
    until_series(page, "!s.span.follow")
    length = span()[1] - span()[0]
    assert length < 500
    page.keyboard.down("Shift")
    page.mouse.down()
    page.mouse.move(middle[0] + 100, middle[1], steps=4)
    page.mouse.up()
    page.keyboard.up("Shift")
    moved = span()
    assert moved[1] < samples - 50
    assert moved[1] - moved[0] == pytest.approx(length)
    page.mouse.down()
    page.mouse.move(middle[0] + 100 + box["width"] / 4, middle[1], steps=4)
    page.mouse.up()
    until_series(page, f"s.span.to - s.span.from < {0.5 * length}")
    page.locator(".panels").focus()
    page.keyboard.press("Home")
    assert span()[0] == 0
    page.keyboard.press("-")
    page.keyboard.press("ArrowRight")
    assert span()[0] > 0
    page.keyboard.press(",")
    expect(page.locator(".shown")).to_contain_text("cursor")
    page.keyboard.press("End")
    assert span()[1:] == [samples, True]
    expect(page.locator(".follow")).to_have_attribute("aria-pressed", "true")
    page.get_by_role("button", name="Earlier", exact=True).click()
    expect(page.locator(".follow")).to_have_attribute("aria-pressed", "false")
    page.get_by_role("button", name="1 h").click()
    assert span() == [0, 3600, True]


@pytest.mark.slow
def test_the_address_carries_twin_and_window(browse, http):
    start(http, "linked", until=1500)
    page = browse("#/live/linked")
    until_series(page, "s.table[0].length >= 600")
    page.evaluate(f"{SERIES}.span.place(200, 500)")
    wait_until(lambda: page.evaluate("location.hash") == "#/live/linked?from=200&to=500")
    page.reload()
    until_series(page, "s.span.from === 200 && s.span.to === 500 && !s.span.follow")
    page.get_by_role("button", name="1 h").click()
    wait_until(lambda: page.evaluate("location.hash") == "#/live/linked?span=3600")
    again = browse("#/live/linked?span=3600")
    until_series(again, "s.span.follow && s.span.length === 3600")


@pytest.mark.slow
def test_the_axes_fit_what_is_shown_and_margins_are_said_in_words(browse, http):
    """Three buffers that lie within 5 bar of each other are three lines, and limits have theirs."""
    scenario = http.get("/v1/scenarios/S1").json()
    for buffer, pressure in (("high", 792), ("medium", 789.5), ("low", 787)):
        scenario["station"]["buffers"][buffer]["initial_pressure_bar"] = pressure
    scenario["arrivals"] = {"kind": "trace", "vehicles": [{"time_s": 9_000, "start_pressure_bar": 137}]}
    scenario["station"]["controllers"]["logic"]["stop_pressure_bar"] = dict.fromkeys(("high", "medium", "low"), 700)
    start(http, "narrow-band", until=300, scenario=scenario)
    page = browse("#/live/narrow-band")
    until_series(page, "s.table[0].length >= 300")
    values = http.get("/v1/twins/narrow-band").json()["values"]
    shown = [values[f"pressure_{name}"] for name in ("high", "medium", "low")]
    low, high = page.evaluate(f"{SERIES}.ranges.buffers")
    assert low <= min(shown) < max(shown) <= high
    assert high - low < 8 * (max(shown) - min(shown))
    hold = scenario["station"]["compressor"]["hold_pressure_bar"]
    words = f"High {hold - shown[0]:.1f} bar below"
    expect(page.locator(".margin-words").first).to_contain_text(words)
    margins = page.locator(".schematic .margins")
    expect(margins).to_contain_text(f"{hold - shown[0]:.1f} bar below hold pressure (7.16)")


def test_a_page_keeps_no_more_than_it_needs(browse, http):
    start(http, "kept", until=10)
    page = browse("#/live/kept")
    until_series(page, "s.table[0].length >= 10")
    kept = page.evaluate("""async () => {
        const { Tail } = await import('/static/live/tail.js');
        const { Tiles, BINS } = await import('/static/live/tiles.js');
        const [tail, tiles] = [new Tail(2), new Tiles(2)];
        for (let time = 0; time < 10000; time++) tail.add(time, [time, null]);
        tail.add(9999, [0, 0]);
        for (let tile = 0; tile < 200; tile++) tiles.put(0, tile * BINS, (tile + 1) * BINS, [tile * BINS], [[1], [2]]);
        const last = tail.place(tail.length - 1);
        const missing = [tiles.missing(0, 199 * BINS, 200 * BINS), tiles.missing(0, 0, 9)];
        return [tail.length, tail.whole, tail.newest, tail.data[last], tail.data.length, tiles.size, ...missing];
    }""")
    assert kept == [2048, 10000 - 2048, 9999, 9999, 2 * 2048, 32, None, [0, 9]]


OPEN = """async () => {
    const began = performance.now();
    location.hash = '#/live/day';
    const frame = () => new Promise((done) => requestAnimationFrame(done));
    let s;
    while (!(s = document.querySelector('.series')?.series)) await frame();
    s.span.choose(Infinity);
    while (!(s.table[0].length > 400 && s.history.whole(6, 0, s.history.end))) await frame();
    await frame();
    return performance.now() - began;
}"""

PAN = """async (length) => {
    const s = document.querySelector('.series').series;
    s.span.place(20000 - length / 2, 20000 + length / 2);
    await new Promise((done) => setTimeout(done, 1000));
    const began = performance.now();
    let frames = 0;
    for (; performance.now() - began < 3000; frames++) {
        s.span.pan(performance.now() - began < 1500 ? 0.01 : -0.01);
        await new Promise((done) => requestAnimationFrame(done));
    }
    return frames / 3;
}"""


@pytest.mark.full
def test_a_day_is_drawn_from_few_rows_and_a_page_left_open_does_not_grow(chromium, mortal):
    """43 200 seconds of 24 columns, then 90 000 samples of a live end; `-s` prints what opening and panning took."""
    with httpx.Client(base_url=mortal.url, timeout=60, trust_env=False) as http:
        start(http, "long", at_end="repeat", speed="max", paused=True)
        http.post("/v1/twins", json={"id": "day", "scenario": "S3", "speed": "max"})
        wait_until(lambda: http.get("/v1/twins/day").json()["samples"] > 43_200, 300)
        http.post("/v1/twins/day/stop")
        page = chromium.new_page(viewport=WIDE)
        page.goto(f"{mortal.url}/#/live")
        expect(page.locator("h1")).to_be_visible()
        opened = page.evaluate(OPEN)
        rows = page.evaluate("document.querySelector('.series').series.table[0].length")
        frames = {length: page.evaluate(PAN, length) for length in (21_600, 10_800, 3_600, 600)}
        page.goto(f"{mortal.url}/#/live/long")
        until_series(page, "s.history.twin === 'long'")
        session = page.context.new_cdp_session(page)

        def heap():
            session.send("HeapProfiler.collectGarbage")
            return session.send("Runtime.getHeapUsage")["usedSize"] / 1e6

        http.patch("/v1/twins/long", json={"paused": False})
        used = {}
        for samples in (30_000, 60_000, 90_000):
            wait_until(lambda samples=samples: http.get("/v1/twins/long").json()["samples"] >= samples, 600)
            used[samples] = heap()
        http.post("/v1/twins/long/stop")
        page.close()
        print(f"opened in {opened:.0f} ms; frames a second {frames}; heap [MB] {used}")
        assert 400 < rows < 4000
        assert used[90_000] < used[30_000] + 2


@pytest.fixture
def mortal(tmp_path):
    """A service of this test's own, to kill."""
    running = RunningService(tmp_path, HRS_CHECKPOINT_S="0.5")
    yield running
    running.stop()


@pytest.mark.slow
def test_a_killed_service_leaves_neither_gap_nor_duplicate(chromium, mortal):
    with httpx.Client(base_url=mortal.url, timeout=30, trust_env=False) as http:
        start(http, "mortal", until=300)
        http.patch("/v1/twins/mortal", json={"paused": False, "speed": 10})
        context = chromium.new_context(viewport=WIDE)
        page = context.new_page()
        page.goto(f"{mortal.url}/#/live/mortal")
        until_series(page, "s.table[0].length >= 310")
        point(page, 0.3)
        expect(page.locator(".schematic.past")).to_be_visible()
        mortal.kill()
        expect(page.locator("#connection")).to_have_text("connection lost, trying again")
        expect(page.locator(".schematic .tag")).to_contain_text("stale: as of")
        stale = page.locator(".schematic .tag").text_content()
        page.mouse.move(1, 1)
        expect(page.locator(".schematic.past")).to_have_count(0)
        assert stale == f"stale: as of {page.locator('.schematic .clock').text_content()}", "the newest second"
        before = page.evaluate(f"{SERIES}.table[0].length")
        assert before >= 310
        mortal.start()
        expect(page.locator("#connection")).to_have_text("connected")
        expect(page.locator(".schematic .tag")).to_be_hidden()
        expect(page.locator(".events .resumed")).to_have_count(1)
        until_series(page, f"s.table[0].length > {before + 20}")
        http.patch("/v1/twins/mortal", json={"paused": True})
        expect(page.locator(".twin-head .tag").first).to_have_text("paused")
        samples = http.get("/v1/twins/mortal").json()["samples"]
        until_series(page, f"s.table[0].length === {samples}")
        shown = rows_shown(page)
        stored = http.get("/v1/twins/mortal/history").json()["columns"]
        begin = len(stored["time"]) - len(shown["time"])
        assert shown["time"] == stored["time"][begin:]
        assert shown["pressure_low"] == pytest.approx(stored["pressure_low"][begin:], rel=1e-6)
        told = [int(item.get_attribute("data-seq")) for item in page.locator(".events li").all()]
        assert told == sorted(set(told), reverse=True)
        context.close()
