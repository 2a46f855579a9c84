"""The live view: what it shows is what the service says, now and in the past, and after the service was killed."""

from __future__ import annotations

import time

import httpx
import pytest
from playwright.sync_api import expect

from station.limits import VALVES, Limit
from tests.api.conftest import RunningService
from tests.api.page.conftest import NARROW, WIDE, overflows, violations

TANKS = ("high", "medium", "low", "vehicle")

SERIES = "document.querySelector('.series').series"


def _start(http, twin, *, until=0, **more):
    """Start a twin and let it stand still behind that many samples."""
    asked = {"id": twin, "scenario": "S1", "controller": "logic", "speed": "max" if until else 1, "at_end": "idle"}
    answer = http.post("/v1/twins", json={**asked, "paused": not until, **more})
    assert answer.status_code == 201, answer.text
    if until:
        _until(lambda: http.get(f"/v1/twins/{twin}").json()["samples"] >= until)
        http.patch(f"/v1/twins/{twin}", json={"paused": True, "speed": 1})
    return http.get(f"/v1/twins/{twin}").json()


def _until(condition, seconds=60.0):
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.02)


def _said(page, name):
    """The text of a figure of the station's picture, with plain spaces."""
    return page.locator(f'.schematic [data-value="{name}"]').text_content().replace("\u202f", " ")


def _until_series(page, expression):
    """Wait until something is true of the series, `s`."""
    series = "document.querySelector('.series')?.series"
    _until(lambda: page.evaluate(f"() => {{ const s = {series}; return Boolean(s && ({expression})); }}"))


def _clock(seconds):
    return f"{int(seconds) // 3600}:{int(seconds) // 60 % 60:02}:{int(seconds) % 60:02}"


def _shown(page):
    """The rows of the series within the window: times, and the columns by name."""
    return page.evaluate(f"""async () => {{
        const {{ SHOWN }} = await import('/static/live/names.js');
        const {{ table, span }} = {SERIES};
        const within = table[0].map((time) => time >= span.from && time <= span.to);
        const part = (place) => table[place].filter((_, row) => within[row]);
        return Object.fromEntries(['time', ...SHOWN].map((name, place) => [name, part(place)]));
    }}""")


def test_the_numbers_of_a_paused_twin_are_those_of_the_service(browse, http):
    state = _start(http, "still", until=90)
    values = state["values"]
    page = browse("#/live/still")
    expect(page.locator("h1")).to_have_text("still")
    expect(page.locator(".twin-head .tag").first).to_have_text("paused")
    expect(page.locator(".schematic .clock")).to_have_text(_clock(values["time"]))
    for tank in TANKS:
        assert _said(page, f"pressure_{tank}") == f"{values[f'pressure_{tank}']:.1f} bar"
        assert _said(page, f"temperature_{tank}") == f"{values[f'temperature_{tank}']:.1f} °C"
        assert _said(page, f"mass_{tank}") == f"{values[f'mass_{tank}'] / 1000:.2f} kg"
    for flow in ("flow_compressor", "flow_dispenser"):
        assert _said(page, flow) == f"{values[flow]:.1f} g/s"
    for valve in VALVES:
        said = page.locator(f'[data-valve="{valve}"] .valve-state').text_content()
        assert said == ("open" if values[valve] else "refused" if values[f"refused_{valve}"] else "closed")
    assert values["vehicle"] >= 0
    expect(page.locator(".tank.vehicle .name")).to_have_text(f"Vehicle {values['vehicle']:.0f}")
    _until_series(page, f"s.table[0].length >= {state['samples']}")
    keys = page.locator(".series .key .value")
    assert keys.first.text_content().replace("\u202f", " ") == f"{values['pressure_high']:.1f} bar"


def test_a_refused_valve_names_the_limit(browse, http):
    """The picture is shown a sample that was made up: which commands are refused is no matter of the page."""
    page = browse("#/live")
    names = page.evaluate("import('/static/live/names.js').then((found) => found.LIMITS.map((limit) => limit?.name))")
    assert names == [None, *(limit.name.lower() for limit in Limit if limit)]
    _start(http, "refused", until=60)
    page = browse("#/live/refused")
    expect(page.locator(".schematic .clock")).not_to_have_text("\u2013")
    page.evaluate("""async () => {
        const { Schematic } = await import('/static/live/schematic.js');
        const scenario = await (await fetch('/v1/twins/refused/scenario')).json();
        const values = (await (await fetch('/v1/twins/refused')).json()).values;
        const shown = new Schematic(scenario, new AbortController().signal);
        document.querySelector('.schematic').replaceWith(shown.element);
        shown.show({ ...values, inlet_high: 0, refused_inlet_high: 6, outlet_low: 1, refused_outlet_high: 10 });
    }""")
    valve = page.locator('[data-valve="inlet_high"]')
    expect(valve.locator(".valve-state")).to_have_text("refused")
    expect(valve.locator(".limit")).to_have_text("hold pressure (7.16)")
    expect(page.locator('[data-valve="outlet_low"] .valve-state')).to_have_text("open")
    expect(page.locator(".reasons li").first).to_have_text(
        "Inlet high refused, Eq. (7.16): above the hold pressure a closed inlet stays closed."
    )
    expect(page.locator(".reasons li").last).to_contain_text("compressor limit")


def test_controls_change_what_the_service_says(browse, http):
    _start(http, "steered", until=30)
    page = browse("#/live/steered")
    state = lambda: http.get("/v1/twins/steered").json()  # noqa: E731
    page.get_by_label("Speed").fill("25")
    page.get_by_role("button", name="Set", exact=True).click()
    expect(page.locator(".facts")).to_contain_text("25\u00d7")
    assert state()["speed"] == 25
    page.get_by_label("Controller").fill("minlp1:horizon=2")
    page.get_by_role("button", name="Seat").click()
    expect(page.locator(".facts")).to_contain_text("minlp1:horizon=2")
    assert state()["controller"] == "minlp1:horizon=2"
    page.get_by_label("Start pressure").fill("150")
    page.get_by_text("Another tank than the usual").click()
    page.get_by_label("Finish pressure").fill("650")
    page.get_by_role("button", name="Add vehicle").click()
    added = page.locator(".events .vehicle_added .details")
    expect(added).to_contain_text("start pressure 150.0")
    expect(added).to_contain_text("finish pressure 650.0")
    page.get_by_role("button", name="Continue").click()
    expect(page.locator(".twin-head .tag").first).to_have_text("running")
    assert state()["state"] == "running"
    page.get_by_role("button", name="Pause").click()
    expect(page.locator(".twin-head .tag").first).to_have_text("paused")
    page.get_by_role("button", name="Stop").click()
    page.get_by_role("button", name="Cancel").click()
    assert state()["state"] == "paused"
    page.get_by_role("button", name="Stop").click()
    page.get_by_role("button", name="Stop it").click()
    expect(page.locator(".twin-head .tag").first).to_have_text("stopped")
    assert state()["state"] == "stopped"
    expect(page.get_by_label("Speed")).to_be_disabled()
    expect(page.locator("#connection")).to_have_text("connected")


def test_wrong_input_is_shown_at_its_field_and_starts_nothing(browse, http):
    page = browse("#/live", expected=("422", "409"))
    before = len(http.get("/v1/twins").json()["items"])
    wrong = {"Name": "No Such Name!", "Controller": "nobody", "Speed": "fast"}
    for label, text in wrong.items():
        page.get_by_label(label, exact=False).fill(text)
    page.get_by_role("button", name="Start the twin").click()
    expect(page.locator('.start [aria-invalid="true"]').first).to_be_visible()
    said = {field: page.locator(f'.start [name="{field}"] ~ .wrong').text_content() for field in ("id", "speed")}
    assert all(said.values()), said
    assert "must be 1 to 1000" in said["speed"]
    page.get_by_label("Name").fill("rightly-named")
    page.get_by_label("Speed").fill("2")
    page.get_by_role("button", name="Start the twin").click()
    expect(page.locator('.start [name="controller"] ~ .wrong')).to_contain_text("nobody")
    assert len(http.get("/v1/twins").json()["items"]) == before
    _start(http, "taken")
    page.get_by_label("Controller").fill("logic")
    page.get_by_label("Name").fill("taken")
    page.get_by_role("button", name="Start the twin").click()
    expect(page.locator('.start [name="id"] ~ .wrong')).to_contain_text("taken")
    page.goto(page.url.replace("#/live", "#/live/taken"))
    page.get_by_label("Speed").fill("0")
    page.get_by_role("button", name="Set", exact=True).click()
    expect(page.locator('.control [name="speed"] ~ .wrong')).to_contain_text("must be 1 to 1000")
    page.get_by_label("Start pressure").fill("9000")
    page.get_by_role("button", name="Add vehicle").click()
    expect(page.locator('.control [name="start_pressure_bar"] ~ .wrong')).not_to_be_empty()
    assert http.get("/v1/twins/taken").json()["speed"] == 1


def test_a_twin_is_started_from_the_form_at_another_station(browse, http):
    page = browse("#/live")
    page.get_by_label("Name").fill("fresh")
    page.get_by_label("Station", exact=True).select_option("thesis-fit-a")
    page.get_by_label("Scenario").select_option("S2")
    page.get_by_role("button", name="Start the twin").click()
    expect(page.locator("h1")).to_have_text("fresh")
    state = http.get("/v1/twins/fresh").json()
    assert (state["scenario"], state["station"], state["speed"], state["at_end"]) == ("S2", "thesis-fit-a", 10, "idle")
    http.post("/v1/twins/fresh/stop")
    expect(page.locator(".twin-head .tag").first).to_have_text("stopped")


def test_the_window_looks_back_to_before_the_page_was_opened(browse, http):
    samples = _start(http, "past", until=3000)["samples"]
    page = browse("#/live/past")
    _until_series(page, "s.table[0].length >= 600")
    page.evaluate(f"{SERIES}.span.place(100, 400)")
    _until_series(page, "s.history.whole(0, 100, 400) && s.table[0][0] <= 100")
    shown = _shown(page)
    stored = http.get("/v1/twins/past/history", params={"from_s": 100, "to_s": 400}).json()["columns"]
    assert shown["time"] == stored["time"]
    for name in (*VALVES, "vehicle", "queue_length"):
        assert shown[name] == stored[name], name
    assert shown["pressure_high"] == pytest.approx(stored["pressure_high"], rel=1e-6)
    page.get_by_role("button", name="all").click()
    _until_series(page, f"s.span.to === {samples} && s.table[0].at(-1) >= {samples - 5}")
    expect(page.locator(".shown")).to_contain_text("least and greatest of every")
    shown = _shown(page)
    whole = http.get("/v1/twins/past/history", params={"columns": "pressure_vehicle,flow_dispenser"}).json()["columns"]
    assert max(filter(None, shown["flow_dispenser"])) == pytest.approx(max(whole["flow_dispenser"]), rel=1e-6)
    assert len(shown["time"]) < 1600
    page.get_by_text("These values as a table").click()
    expect(page.get_by_role("region", name="Series").locator("tbody tr").first).to_contain_text("0:00:00")
    http.post("/v1/twins/past/stop")


def test_wheel_drag_and_keys_move_the_window(browse, http):
    samples = _start(http, "moved", until=1500)["samples"]
    page = browse("#/live/moved")
    _until_series(page, "s.table[0].length >= 600")
    span = lambda: page.evaluate(f"(({{ from, to, follow }}) => [from, to, follow])({SERIES}.span)")  # noqa: E731
    assert span() == [samples - 600, samples, True]
    over = page.locator(".u-over").first
    over.scroll_into_view_if_needed()
    box = over.bounding_box()
    middle = (box["x"] + box["width"] / 2, box["y"] + 50)
    page.mouse.move(*middle)
    page.mouse.wheel(0, -200)
    _until_series(page, "!s.span.follow")
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
    _until_series(page, f"s.span.to - s.span.from < {0.5 * length}")
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


def test_events_are_told_in_words_and_further_back(browse, http):
    _start(http, "eventful", until=2500, controller="minlp1")
    told = http.get("/v1/twins/eventful").json()["events"]
    assert told > 300
    page = browse("#/live/eventful")
    events = page.locator(".events li")
    expect(events.first.locator(".kind")).to_have_text("paused")
    expect(events).to_have_count(50)
    page.get_by_role("button", name="Earlier events").click()
    expect(events).to_have_count(250)
    page.get_by_label("valve changes").uncheck()
    expect(page.locator(".events .valve_change")).to_have_count(0)
    more = page.get_by_role("button", name="Earlier events")
    busy = page.locator('.events[aria-busy="true"]')
    expect(busy).to_have_count(0)
    while more.is_visible():
        more.click()
        expect(busy).to_have_count(0)
    expect(page.locator(".events .started .details")).to_contain_text("S1 · minlp1 · as fast as possible · uncertified")
    expect(page.locator(".events .fill_start .details").last).to_contain_text("vehicle 0 · 137.3")
    expect(page.locator(".events .fill_end .details").last).to_contain_text("kg")
    http.post("/v1/twins/eventful/stop")


def test_several_twins_stand_side_by_side(browse, http):
    _start(http, "one", until=20)
    _start(http, "two")
    page = browse("#/live")
    card = page.locator(".twin-card", has_text="one").filter(has=page.get_by_role("link", name="Open one"))
    expect(card.locator(".tag").first).to_have_text("paused")
    expect(card).to_contain_text("S1 · thesis-fit · logic · 1\u00d7")
    page.get_by_role("link", name="Open two").click()
    expect(page.locator("h1")).to_have_text("two")
    page.get_by_label("Twin", exact=True).select_option("one")
    expect(page.locator("h1")).to_have_text("one")
    page.get_by_role("link", name="All twins").click()
    page.get_by_role("button", name="Stop two").click()
    page.get_by_role("button", name="Stop it").click()
    page.get_by_role("button", name="Forget two").click()
    page.get_by_role("button", name="Forget it").click()
    expect(page.get_by_role("link", name="Open two")).to_have_count(0)
    assert http.get("/v1/twins/two").status_code == 404
    assert http.get("/v1/twins/one").json()["state"] == "paused"


def test_an_unknown_twin_is_said_to_be_unknown(browse):
    page = browse("#/live/nobody", expected=("404",))
    expect(page.locator("h1")).to_have_text("No such twin")


def test_the_keyboard_alone_starts_and_operates_a_twin(browse, http):
    page = browse("#/live")
    expect(page.get_by_role("button", name="Start the twin")).to_be_visible()
    page.get_by_label("Name").focus()
    page.keyboard.press("Control+A")
    page.keyboard.type("typed")
    page.keyboard.press("Enter")
    expect(page.locator("h1")).to_have_text("typed")
    for _ in range(40):
        page.keyboard.press("Tab")
        if page.evaluate("document.activeElement.textContent") == "Pause":
            break
    page.keyboard.press("Enter")
    expect(page.locator(".twin-head .tag").first).to_have_text("paused")
    assert http.get("/v1/twins/typed").json()["state"] == "paused"
    reached = set()
    for _ in range(60):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.className || document.activeElement.name"))
    assert {"panels", "follow", "events"} <= {name.split()[0] for name in reached if name}
    http.post("/v1/twins/typed/stop")


@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("size", [WIDE, NARROW], ids=["wide", "narrow"])
def test_a_live_twin_is_readable_for_everybody(browse, http, dark, size):
    if http.get("/v1/twins/read").status_code == 404:
        _start(http, "read", until=400)
    page = browse("#/live/read", dark=dark, size=size)
    _until_series(page, "s.table[0].length > 150")
    expect(page.locator(".events li").first).to_be_visible()
    assert not overflows(page)
    assert violations(page) == []
    page.goto(page.url.replace("/read", ""))
    expect(page.locator(".twin-card").first).to_be_visible()
    expect(page.get_by_role("button", name="Start the twin")).to_be_visible()
    assert not overflows(page)
    assert violations(page) == []


def test_a_page_keeps_no_more_than_it_needs(browse, http):
    _start(http, "kept", until=10)
    page = browse("#/live/kept")
    _until_series(page, "s.table[0].length >= 10")
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


@pytest.mark.slow
def test_a_day_is_drawn_from_few_rows_and_a_page_left_open_does_not_grow(chromium, mortal):
    """43 200 seconds of 24 columns, then 90 000 samples of a live end; `-s` prints what opening and panning took."""
    with httpx.Client(base_url=mortal.url, timeout=60, trust_env=False) as http:
        _start(http, "long", at_end="repeat", speed="max", paused=True)
        http.post("/v1/twins", json={"id": "day", "scenario": "S3", "speed": "max"})
        _until(lambda: http.get("/v1/twins/day").json()["samples"] > 43_200, 300)
        http.post("/v1/twins/day/stop")
        page = chromium.new_page(viewport=WIDE)
        page.goto(f"{mortal.url}/#/live")
        expect(page.locator("h1")).to_be_visible()
        opened = page.evaluate(OPEN)
        rows = page.evaluate("document.querySelector('.series').series.table[0].length")
        frames = {length: page.evaluate(PAN, length) for length in (21_600, 10_800, 3_600, 600)}
        page.goto(f"{mortal.url}/#/live/long")
        _until_series(page, "s.history.twin === 'long'")
        session = page.context.new_cdp_session(page)

        def heap():
            session.send("HeapProfiler.collectGarbage")
            return session.send("Runtime.getHeapUsage")["usedSize"] / 1e6

        http.patch("/v1/twins/long", json={"paused": False})
        used = {}
        for samples in (30_000, 60_000, 90_000):
            _until(lambda: http.get("/v1/twins/long").json()["samples"] >= samples, 600)  # noqa: B023
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


def test_a_killed_service_leaves_neither_gap_nor_duplicate(chromium, mortal):
    with httpx.Client(base_url=mortal.url, timeout=30, trust_env=False) as http:
        _start(http, "mortal", until=300)
        http.patch("/v1/twins/mortal", json={"paused": False, "speed": 10})
        context = chromium.new_context(viewport=WIDE)
        page = context.new_page()
        page.goto(f"{mortal.url}/#/live/mortal")
        _until_series(page, "s.table[0].length >= 310")
        mortal.kill()
        expect(page.locator("#connection")).to_have_text("connection lost, trying again")
        expect(page.locator(".schematic .tag")).to_contain_text("stale: as of")
        before = page.evaluate(f"{SERIES}.table[0].length")
        assert before >= 310
        mortal.start()
        expect(page.locator("#connection")).to_have_text("connected")
        expect(page.locator(".schematic .tag")).to_be_hidden()
        expect(page.locator(".events .resumed")).to_have_count(1)
        _until_series(page, f"s.table[0].length > {before + 20}")
        http.patch("/v1/twins/mortal", json={"paused": True})
        expect(page.locator(".twin-head .tag").first).to_have_text("paused")
        samples = http.get("/v1/twins/mortal").json()["samples"]
        _until_series(page, f"s.table[0].length === {samples}")
        shown = _shown(page)
        stored = http.get("/v1/twins/mortal/history").json()["columns"]
        begin = len(stored["time"]) - len(shown["time"])
        assert shown["time"] == stored["time"][begin:]
        assert shown["pressure_low"] == pytest.approx(stored["pressure_low"][begin:], rel=1e-6)
        told = [int(item.get_attribute("data-seq")) for item in page.locator(".events li").all()]
        assert told == sorted(set(told), reverse=True)
        context.close()
