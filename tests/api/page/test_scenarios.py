"""The scenario editor: the API's limits at each field, the arrivals as the simulator draws them, and what follows."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from playwright.sync_api import expect

from station import load_scenario, load_station
from tests.api.page.conftest import NARROW, WIDE, overflows, violations

DAY = Path(__file__).parents[3] / "docs" / "examples" / "day.csv"


def field(page, path):
    return page.locator(f'[data-path="{path}"]')


def wrong(page, path):
    return page.locator(f"#scenario-{path.replace('.', '-')}-wrong")


@pytest.fixture
def editor(browse):
    """The editor with S1 in it."""
    page = browse("#/scenarios/S1", expected=("422",))
    expect(page.locator(".tag.good")).to_have_text("can be run")
    return page


def ticks(page):
    return page.locator(".tick").evaluate_all("all => all.map(e => Number(e.getAttribute('x1')))")


def test_arrivals_are_those_of_the_simulator(editor):
    arrival = load_scenario("S1").vehicles().arrival
    places = ticks(editor)
    assert len(places) == len(arrival)
    span = places[-1] - places[0]
    assert [(place - places[0]) / span for place in places] == pytest.approx(arrival / arrival[-1])
    editor.get_by_label("Replication", exact=True).fill("3")
    drawn = load_scenario("S1").vehicles(3, 0)
    expect(editor.locator("figcaption")).to_contain_text(f"{drawn.start_pressure.min():.1f} to")


@pytest.mark.slow
def test_limits_are_the_services_and_stand_at_the_field(editor):
    field(editor, "arrivals.count").fill("0")
    expect(wrong(editor, "arrivals.count")).to_contain_text("greater than or equal to 1; given 0")
    expect(editor.locator(".tag.bad")).to_have_text("1 field is wrong")
    for name in ("Compare", "Start"):
        expect(editor.get_by_role("button", name=name, exact=True)).to_be_disabled()
    field(editor, "arrivals.count").fill("7")
    expect(editor.locator(".tag.good")).to_be_visible()
    expect(wrong(editor, "arrivals.count")).to_be_hidden()
    field(editor, "arrivals.period_s").fill("20000")
    expect(wrong(editor, "time_limit_s")).to_contain_text("must not end before the last arrival at 20000 s")
    field(editor, "time_limit_s").fill("")
    expect(editor.locator(".tag.good")).to_be_visible()
    editor.get_by_text("Parameters").click()
    field(editor, "station.vehicle.start_pressure_bar").fill("5000")
    expect(wrong(editor, "station.vehicle.start_pressure_bar")).to_contain_text("less than or equal to 2000")


@pytest.mark.slow
def test_a_station_of_real_gas_brings_its_fields_and_takes_them_away(editor):
    high = load_station("h70-light").real_gas.bank_pressure_max_bar.high
    editor.get_by_text("Parameters").click()
    bank = field(editor, "station.real_gas.bank_pressure_max_bar.high")
    expect(bank).to_have_count(0)
    for name, has in (("h70-light", 1), ("thesis-fit", 0), ("h70-light", 1)):
        editor.get_by_label("Preset").select_option(name)
        expect(bank).to_have_count(has)
        expect(editor.locator(".tag.good")).to_have_text("can be run")
    expect(bank).to_have_value(f"{high:g}")
    price = field(editor, "station.tariff.energy.0.eur_per_kwh")
    expect(price).to_have_value("0.14")
    price.fill("-1")
    expect(wrong(editor, "station.tariff.energy.0.eur_per_kwh")).to_contain_text("greater than or equal to 0")
    price.fill("0.2")
    expect(editor.locator(".tag.good")).to_have_text("can be run")
    bank.fill("5000")
    expect(wrong(editor, "station.real_gas.bank_pressure_max_bar.high")).to_contain_text("equal to 1100")


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["normal", "poisson", "profile"])
def test_every_law_of_arrivals_can_be_run(editor, kind):
    editor.locator(f'input[name=kind][value="{kind}"]').check()
    expect(field(editor, "arrivals.count" if kind != "poisson" else "arrivals.rate_per_h")).to_be_visible()
    expect(editor.locator(".tick")).to_have_count(20 if kind == "profile" else 12)
    expect(editor.locator(".tag.good")).to_be_visible()


@pytest.mark.slow
def test_a_trace_is_read_by_the_services_rules(editor, tmp_path):
    editor.locator('input[name=kind][value="trace"]').check()
    broken = tmp_path / "broken.csv"
    broken.write_text("time_s,start_pressure_bar\n60,120\n70,many\n")
    editor.locator("#scenario-trace").set_input_files(broken)
    expect(editor.locator("#scenario-trace-wrong")).to_contain_text("line 3, start_pressure_bar: must be a number")
    editor.locator("#scenario-trace").set_input_files(DAY)
    count = len(DAY.read_text().splitlines()) - 1
    expect(editor.locator("figcaption")).to_contain_text(f"{count} vehicles")
    expect(editor.locator(".tag.good")).to_be_visible()


@pytest.mark.slow
def test_a_comparison_and_a_twin_follow(editor, http):
    field(editor, "name").fill("mine")
    field(editor, "arrivals.count").fill("3")
    expect(editor.locator("figcaption")).to_contain_text("3 vehicles")
    editor.locator("input[name=controllers][value=switched]").uncheck()
    editor.get_by_role("button", name="Compare", exact=True).click()
    editor.wait_for_url("**/#/compare/*")
    job = http.get(f"/v1/comparisons/{editor.url.rsplit('/', 1)[-1]}").json()
    assert (job["scenarios"], job["controllers"]) == (["mine"], ["logic"])
    editor.goto(editor.url.split("#")[0] + "#/scenarios")  # the draft is still there
    expect(field(editor, "name")).to_have_value("mine")
    expect(editor.locator(".tag.good")).to_be_visible()
    form = editor.locator("form", has_text="Start a live twin")
    form.get_by_label("Name").fill("No Name!")
    form.get_by_role("button", name="Start").click()
    expect(form.locator(".wrong", has_text="pattern")).to_be_visible()
    form.get_by_label("Name").fill("drafted")
    form.get_by_label("Controller").select_option("logic")
    form.get_by_role("button", name="Start").click()
    editor.wait_for_url("**/#/live/drafted")
    assert http.get("/v1/twins/drafted").json()["scenario"] == "mine"
    http.post("/v1/twins/drafted/stop")


@pytest.mark.slow
def test_a_file_is_saved_and_opened_again(editor):
    field(editor, "name").fill("kept")
    editor.locator("label", has_text="Disturbed").locator("input").check()
    expect(field(editor, "disturbance.uncertainty.pressure_bar")).to_have_value("1")
    field(editor, "disturbance.uncertainty.pressure_bar").fill("2")
    with editor.expect_download() as download:
        editor.get_by_role("button", name="Save as a file").click()
    saved = json.loads(Path(download.value.path()).read_text())
    assert saved["name"] == "kept"
    assert saved["disturbance"]["uncertainty"]["pressure_bar"] == 2
    editor.get_by_label("Begin with").select_option("S3")
    expect(field(editor, "name")).to_have_value("S3")
    editor.locator("input[type=file][hidden]").set_input_files(download.value.path())
    expect(field(editor, "name")).to_have_value("kept")
    expect(field(editor, "disturbance.uncertainty.pressure_bar")).to_have_value("2")


@pytest.mark.slow
@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("size", [WIDE, NARROW], ids=["wide", "narrow"])
def test_the_editor_is_readable_for_everybody(browse, dark, size):
    page = browse("#/scenarios/S3", dark=dark, size=size)
    expect(page.locator(".tag.good")).to_be_visible()
    page.get_by_text("Parameters").click()
    page.locator("label", has_text="Disturbed").locator("input").check()
    expect(page.locator(".tag.good")).to_be_visible()
    assert not overflows(page)
    assert violations(page) == []
