"""Files of a user's own in the scenario editor: read, refused with the line, mended, picked again, and put to use."""

from __future__ import annotations

import json

import pytest
from playwright.sync_api import expect

from tests.api.conftest import ended
from tests.api.page.comparing import compared, opened
from tests.api.page.test_scenarios import field

HEADER = "time_s,start_pressure_bar\n"
NAME = "Tagesgang-" + "äöüß" * 13 + "AB"  # 64 letters


@pytest.fixture
def tracing(browse):
    """The editor with S1 in it, asked for a recorded day."""
    page = browse("#/scenarios/S1", expected=("422",))
    expect(page.locator(".tag.good")).to_have_text("can be run")
    page.locator('input[name=kind][value="trace"]').check()
    return page


def pick(page, path, selector="#scenario-trace"):
    """Pick a file as a hand does: a click that opens no dialog here, then the file, which Chromium tells only if it is
    another one (Playwright itself tells each time)."""
    page.locator(selector).evaluate("control => control.addEventListener('click', e => e.preventDefault())")
    page.locator(selector).dispatch_event("click")
    session = page.context.new_cdp_session(page)
    root = session.send("DOM.getDocument")["root"]["nodeId"]
    node = session.send("DOM.querySelector", {"nodeId": root, "selector": selector})["nodeId"]
    session.send("DOM.setFileInputFiles", {"files": [str(path)], "nodeId": node})
    session.detach()


@pytest.mark.slow
def test_the_mended_file_can_be_picked_again(tracing, tmp_path):
    path = tmp_path / "day.csv"
    path.write_text(f"{HEADER}60,120\n70,many\n")
    pick(tracing, path)
    expect(tracing.locator("#scenario-trace-wrong")).to_contain_text("line 3, start_pressure_bar: must be a number")
    path.write_text(f"{HEADER}60,120\n70,125\n")
    pick(tracing, path)
    expect(tracing.locator("#scenario-trace-wrong")).to_be_empty()
    expect(tracing.locator("figcaption")).to_contain_text("2 vehicles")
    path.write_text(f"{HEADER}60,120\n70,125\n80,130\n")
    pick(tracing, path)
    expect(tracing.locator("figcaption")).to_contain_text("3 vehicles")


GOOD = {
    "one vehicle": (f"{HEADER}60,120\n", 1),
    "2000 vehicles": (HEADER + "".join(f"{40 * k},{100 + k % 50}\n" for k in range(2000)), 2000),
    "all at the same time": (HEADER + "600,120\n" * 30, 30),
    "all at the start": (HEADER + "0,120\n" * 3, 3),
    "equal start pressures": (HEADER + "".join(f"{60 * k},133.7\n" for k in range(9)), 9),
    "byte order mark and CRLF": ("\ufeff" + HEADER.replace("\n", "\r\n") + "60,120\r\n70,125\r\n", 2),
    "empty lines": (f"{HEADER}\n60,120\n\n\n70,125\n\n", 2),
    "unordered": (f"{HEADER}900,120\n60,125\n300,130\n", 3),
}
BAD = {
    "semicolons": ("time_s;start_pressure_bar\n60;120\n", "line 1: columns must be"),
    "decimal commas": (f"{HEADER}60,120\n60,5,120\n", "line 3: must have 2 values; given 3"),
    "quoted decimal commas": (f'{HEADER}60,"120,5"\n', "line 2, start_pressure_bar: must be a number"),
    "empty lines count": (f"{HEADER}60,120\n\n\n70,x\n", "line 5, start_pressure_bar: must be a number"),
    "nothing": ("", "line 1: columns must be"),
    "no vehicle": (HEADER, "at least 1 item"),
    "not a number": (f"{HEADER}nan,120\n", "time_s"),
}


@pytest.mark.parametrize("name", GOOD)
def test_a_day_of_any_shape_is_read(tracing, tmp_path, name):
    text, count = GOOD[name]
    path = tmp_path / "day.csv"
    path.write_bytes(text.encode())
    pick(tracing, path)
    expect(tracing.locator("figcaption")).to_contain_text(
        f"{count:,} vehicle".replace(",", "\N{NARROW NO-BREAK SPACE}")
    )
    expect(tracing.locator(".tag.good")).to_be_visible()
    assert len(tracing.locator("figure .bar").all()) >= 1
    expect(field(tracing, "name")).to_have_value("day")
    expect(field(tracing, "about")).to_have_value(f"{count} vehicle{'s' if count > 1 else ''} of day.csv")


@pytest.mark.parametrize("name", BAD)
def test_a_file_that_cannot_be_read_says_where(tracing, tmp_path, name):
    text, words = BAD[name]
    path = tmp_path / "day.csv"
    path.write_text(text)
    pick(tracing, path)
    expect(tracing.locator("#scenario-trace-wrong")).to_contain_text(words)


@pytest.mark.slow
def test_what_is_no_longer_s1_does_not_say_that_it_is(browse):
    page = browse("#/scenarios/S1", expected=("422",))
    expect(field(page, "about")).to_have_value("5 vehicles in 1000 s, evenly spaced (Table 7.3)")
    field(page, "arrivals.count").fill("7")
    expect(field(page, "about")).to_have_value("")
    expect(field(page, "name")).to_have_value("S1-changed")
    field(page, "about").fill("seven of my own")
    field(page, "arrivals.count").fill("8")
    expect(page.locator("figcaption")).to_contain_text("8 vehicles")
    expect(field(page, "about")).to_have_value("seven of my own")


@pytest.mark.slow
def test_a_day_with_a_name_of_64_letters_is_compared_once(tracing, http, tmp_path):
    path = tmp_path / f"{NAME}.csv"
    path.write_text(f"{HEADER}0,120\n300,120\n600,120\n")
    compare = tracing.locator("form", has_text="Compare controllers on it")
    compare.get_by_label("Replications").fill("20")
    tracing.locator("#scenario-trace").set_input_files(path)
    expect(field(tracing, "name")).to_have_value(NAME)
    expect(tracing.locator(".tag.good")).to_be_visible()
    expect(compare.get_by_label("Replications")).to_be_disabled()
    expect(compare.get_by_label("Replications")).to_have_value("1")
    expect(compare.get_by_text("A recorded day draws nothing")).to_be_visible()
    compare.get_by_role("button", name="Compare", exact=True).click()
    tracing.wait_for_url("**/#/compare/*")
    job = ended(http, f"/v1/comparisons/{tracing.url.rsplit('/', 1)[-1]}")
    assert (job["scenarios"], job["replications"], job["state"]) == ([NAME], 1, "succeeded")
    expect(tracing.locator(".tradeoff svg .mark").first).to_be_visible()
    assert tracing.evaluate("document.documentElement.scrollWidth <= window.innerWidth"), "a long name wraps"


def test_a_disturbed_day_draws_its_sensors_and_is_replicated(tracing, tmp_path):
    path = tmp_path / "day.csv"
    path.write_text(f"{HEADER}0,120\n300,120\n")
    tracing.locator("#scenario-trace").set_input_files(path)
    tracing.locator("label", has_text="Disturbed").locator("input").check()
    expect(tracing.locator(".tag.good")).to_be_visible()
    expect(tracing.locator("form", has_text="Compare controllers on it").get_by_label("Replications")).to_be_enabled()


@pytest.mark.slow
def test_a_file_of_a_whole_scenario_or_of_arrivals_is_opened_again_and_again(browse, tmp_path):
    page = browse("#/scenarios/S1", expected=("422",))
    expect(page.locator(".tag.good")).to_be_visible()
    hidden = ".head input[type=file]"
    day = tmp_path / "day.csv"
    day.write_text(f"{HEADER}0,120\n300,120\n")
    pick(page, day, hidden)
    expect(page.locator("figcaption")).to_contain_text("2 vehicles")
    whole = tmp_path / "mine.json"
    whole.write_text('{"name": "mine", ')
    pick(page, whole, hidden)
    expect(page.locator(".toast.problem")).to_contain_text("mine.json: is no JSON document")
    arrivals = {"kind": "uniform", "count": 4, "period_s": 900}
    whole.write_text(json.dumps({"name": "mine", "about": "four", "arrivals": arrivals}))
    pick(page, whole, hidden)
    expect(field(page, "name")).to_have_value("mine")
    expect(field(page, "about")).to_have_value("four")
    expect(page.locator("figcaption")).to_contain_text("4 vehicles")


@pytest.mark.slow
def test_every_speed_the_service_has_can_be_chosen(browse, http):
    page = browse("#/scenarios/S1", expected=("422",))
    expect(page.locator(".tag.good")).to_be_visible()
    form = page.locator("form", has_text="Start a live twin")
    form.get_by_label("Name").fill("hurried")
    form.get_by_label("Speed").fill("fast")
    form.get_by_role("button", name="Start").click()
    expect(form.locator(".wrong", has_text='must be 1 to 1000 [s/s], or "max"; given "fast"')).to_be_visible()
    form.get_by_label("Speed").fill("max")
    form.get_by_role("button", name="Start").click()
    page.wait_for_url("**/#/live/hurried")
    assert http.get("/v1/twins/hurried").json()["speed"] == "max"
    control = page.locator("form[name=speed]")
    expect(control.get_by_label("Speed")).to_have_value("max")
    for typed, speed in [("10", 10.0), (" Max ", "max"), ("2.5", 2.5), ("max", "max")]:
        control.get_by_label("Speed").fill(typed)
        with page.expect_response(lambda answer: answer.request.method == "PATCH"):
            control.get_by_role("button", name="Set").click()
        assert http.get("/v1/twins/hurried").json()["speed"] == speed
    http.post("/v1/twins/hurried/stop")


@pytest.mark.slow
def test_a_recorded_day_beside_a_drawn_one_is_told_to_run_once(browse, http):
    """Its one run is all there is: no line says it is one of five, and no replication of it can be chosen."""
    vehicles = [{"time_s": 300 * place, "start_pressure_bar": 120} for place in range(3)]
    recorded = {"name": "recorded", "arrivals": {"kind": "trace", "vehicles": vehicles}}
    path = compared(http, scenarios=[recorded, "S1"], controllers=["logic"], replications=5)
    page = opened(browse, path)
    expect(page.locator("#view")).to_contain_text("recorded: nothing in it is drawn")
    expect(page.locator(".tables tbody tr td:nth-child(2)").first).to_have_text("ours")
    expect(page.locator(".tables .some")).to_have_count(0)
    scenario, replication = page.locator("#gantt-scenario"), page.locator("#gantt-replication")
    expect(replication).to_be_hidden()
    scenario.select_option("S1")
    expect(replication).to_be_visible()
    expect(replication.locator("option")).to_have_count(5)
