"""The live view: what it shows is what the service says, now and in the past, and after the service was killed."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from station.geometry import VALVES
from station.limits import Limit
from tests.api.page.conftest import NARROW, WIDE, overflows, violations
from tests.api.page.living import clock, figure, start, until_series

TANKS = ("high", "medium", "low", "vehicle")


def test_the_numbers_of_a_paused_twin_are_those_of_the_service(browse, http):
    state = start(http, "still", until=90)
    values = state["values"]
    page = browse("#/live/still")
    expect(page.locator("h1")).to_have_text("still")
    expect(page.locator(".twin-head .tag").first).to_have_text("paused")
    expect(page.locator(".schematic .clock")).to_have_text(clock(values["time"]))
    for tank in TANKS:
        assert figure(page, f"pressure_{tank}") == f"{values[f'pressure_{tank}']:.1f} bar"
        assert figure(page, f"temperature_{tank}") == f"{values[f'temperature_{tank}']:.1f} °C"
        assert figure(page, f"mass_{tank}") == f"{values[f'mass_{tank}'] / 1000:.2f} kg"
    for flow in ("flow_compressor", "flow_dispenser"):
        assert figure(page, flow) == f"{values[flow]:.1f} g/s"
    for valve in VALVES:
        said = page.locator(f'[data-valve="{valve}"] .valve-state').text_content()
        assert said == ("open" if values[valve] else "refused" if values[f"refused_{valve}"] else "closed")
    assert values["vehicle"] >= 0
    expect(page.locator(".tank.vehicle .name")).to_have_text(f"Vehicle {values['vehicle']:.0f}")
    until_series(page, f"s.table[0].length >= {state['samples']}")
    keys = page.locator(".series .key .value")
    assert keys.first.text_content().replace("\u202f", " ") == f"{values['pressure_high']:.1f} bar"


def test_a_station_with_real_gas_shows_its_own_limits(browse, http):
    """What its sections say of the controllers' model is no limit of the plant."""
    scenario = {
        "name": "gas", "station": {"preset": "h70-light"},
        "arrivals": {"kind": "uniform", "count": 3, "period_s": 300.0},
    }  # fmt: skip
    values = start(http, "gas", until=90, scenario=scenario)["values"]
    page = browse("#/live/gas")
    expect(page.locator(".schematic .clock")).to_have_text(clock(values["time"]))
    margins = page.locator(".schematic dl.margins")
    for buffer, most in (("high", 950), ("medium", 750), ("low", 500)):
        by = most - values[f"pressure_{buffer}"]
        expect(margins).to_contain_text(f"{abs(by):.1f} bar {'above' if by < 0 else 'below'} greatest pressure")
        expect(page.locator(f".tank.{buffer}")).to_contain_text(f"{100 * (1 - by / most):.0f} %")
    expect(margins).not_to_contain_text("hold pressure")
    expect(margins).not_to_contain_text("compressor pressure")


@pytest.mark.slow
def test_a_refused_valve_names_the_limit(browse, http):
    """The picture is shown a sample that was made up: which commands are refused is no matter of the page."""
    page = browse("#/live")
    names = page.evaluate("import('/static/live/names.js').then((found) => found.LIMITS.map((limit) => limit?.name))")
    assert names == [None, *(limit.name.lower() for limit in Limit if limit)]
    start(http, "refused", until=60)
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
    expect(page.locator(".reasons li").last).to_contain_text("limit of the station")


@pytest.mark.slow
def test_controls_change_what_the_service_says(browse, http):
    start(http, "steered", until=30)
    page = browse("#/live/steered")

    def state():
        return http.get("/v1/twins/steered").json()

    page.get_by_label("Speed").fill("25")
    page.get_by_role("button", name="Set", exact=True).click()
    expect(page.locator(".facts")).to_contain_text("25\u00d7")
    assert state()["speed"] == 25
    page.get_by_label("Controller", exact=True).fill("minlp1:horizon=2")
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


@pytest.mark.slow
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
    start(http, "taken")
    page.get_by_label("Controller", exact=True).fill("logic")
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


@pytest.mark.slow
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


@pytest.mark.slow
def test_events_are_told_in_words_and_further_back(browse, http):
    start(http, "eventful", until=2500, controller="minlp1")
    told = http.get("/v1/twins/eventful").json()["events"]
    assert told > 300
    page = browse("#/live/eventful")
    events = page.locator(".events li")
    expect(events.first.locator(".kind")).to_have_text("paused")
    expect(page.locator(".events .valve_change")).to_have_count(0)
    expect(page.locator(".events .fill_end")).not_to_have_count(0)  # however many valve changes came since
    expect(page.get_by_role("region", name="Events")).to_contain_text("valve changes.")
    chosen = page.get_by_label("Events shown")
    chosen.select_option("vehicles")
    expect(page.locator(".events .paused")).to_have_count(0)
    expect(page.locator(".events .fill_end")).not_to_have_count(0)
    chosen.select_option("all")
    expect(page.locator(".events .valve_change").first).to_be_visible()
    page.reload()
    expect(chosen).to_have_value("all")
    chosen.select_option("usual")
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


@pytest.mark.slow
def test_several_twins_stand_side_by_side(browse, http):
    start(http, "one", until=20)
    start(http, "two")
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


@pytest.mark.slow
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


@pytest.mark.slow
@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("size", [WIDE, NARROW], ids=["wide", "narrow"])
def test_a_live_twin_is_readable_for_everybody(browse, http, dark, size):
    if http.get("/v1/twins/read").status_code == 404:
        start(http, "read", until=400)
    page = browse("#/live/read", dark=dark, size=size)
    until_series(page, "s.table[0].length > 150")
    expect(page.locator(".events li").first).to_be_visible()
    assert not overflows(page)
    assert violations(page) == []
    page.goto(page.url.replace("/read", ""))
    expect(page.locator(".twin-card").first).to_be_visible()
    expect(page.get_by_role("button", name="Start the twin")).to_be_visible()
    assert not overflows(page)
    assert violations(page) == []
