"""A twin that follows measurements in the live view: what the service says of the station, in figures and words."""

from __future__ import annotations

import math
import re
import time

import pytest
from playwright.sync_api import expect

from controllers import create_from
from station import load_station, simulate
from station.estimation.filter import ROBUST
from station.measured_day import measured_day, tags_of_day
from station.scenario import parse_scenario
from tests.api.page.conftest import NARROW, WIDE, overflows, violations
from tests.api.page.living import SERIES, until_series
from tests.waiting import wait_until

WORKERS = 0

BEGIN = 1_795_252_800.0
SENT, KEPT = 1400, 60
"""Seconds that are sent before the page is looked at, and after."""

SIGMA = "\N{GREEK SMALL LETTER SIGMA}"

LEAK, ABSENT = "high", "temperature_low"


class Plant:
    """A station with a leak and a sensor that falls silent, told to the service as its transmitters would."""

    def __init__(self, http):
        vehicles = [{"time_s": 60.0 + 300 * k, "start_pressure_bar": 120.0 + 5 * k} for k in range(5)]
        faults = [
            {"kind": "leak", "buffer": LEAK, "begin_s": 300.0, "rate_g_per_s": 1.0},
            {"kind": "sensor_absent", "sensor": ABSENT, "begin_s": 900.0},
        ]
        scenario = {
            "name": "leaky", "station": load_station("thesis-fit").model_dump(), "faults": faults,
            "arrivals": {"kind": "trace", "vehicles": vehicles}, "time_limit_s": float(SENT + KEPT + 10),
        }  # fmt: skip
        table = measured_day(simulate(parse_scenario(scenario), create_from("logic")), seed=1)
        self.columns = {name: table[name].to_pylist() for name in table.column_names if name != "time_s"}
        self.http = http
        self.sequence = 0
        tags = tags_of_day().model_dump(mode="json", exclude_unset=True)
        for twin in ("plant", "quiet"):
            asked = {"id": twin, "scenario": "S1", "source": "measured", "tags": tags}
            answer = http.post("/v1/twins", json=asked)
            assert answer.status_code == 201, answer.text

    def send(self, first, last):
        rows = [
            {"tag": name, "time": BEGIN + second, "value": values[second]}
            for second in range(first, last)
            for name, values in self.columns.items()
        ]
        path = f"/v1/twins/plant/measurements?source=plc&sequence={self.sequence}"
        wait_until(lambda: self.http.post(path, json=rows).status_code == 202)
        self.sequence += 1

    def estimate(self):
        return self.http.get("/v1/twins/plant/estimate").json()


@pytest.fixture(scope="module")
def plant(http):
    """A plant whose first SENT seconds were sent and, but for what is held back, followed."""
    made = Plant(http)
    for first in range(0, SENT, 100):
        made.send(first, first + 100)
    wait_until(lambda: http.get("/v1/twins/plant").json()["samples"] > SENT - 10, 300)  # the filter may be compiled
    return made


def plain(text):
    return text.replace("\u202f", " ").replace("\N{MINUS SIGN}", "-")


def shown(page, plant):
    """The estimate that the page shows, once that is the service's newest."""
    followed = "document.querySelector('.health')?.followed"
    wait_until(lambda: page.evaluate(f"{followed}?.seq") == plant.estimate()["seq"])
    return page.evaluate(followed)


@pytest.mark.slow
def test_a_leak_is_told_in_words_and_with_its_spread(browse, plant):
    page = browse("#/live/plant")
    found = shown(page, plant)
    assert found["health"][f"leak_{LEAK}"] == "failing", "else this test says nothing"
    for name, verdict in found["health"].items():
        place = page.locator(f'[data-health="{name}"]')
        each = found["quantities"][name]
        leak = name.startswith("leak_")
        by, digits = (1, 2) if leak else (100, 0)
        figure = f"{by * each['value']:.{digits}f} ± {2 * by * each['deviation']:.{digits}f}"
        assert re.sub(r"-(0\.00)", r"\1", figure) in plain(place.locator("b").text_content())
        words = {"sound": "no leak" if leak else "as it should be", "unknown": "not known", "failing": "leak"}
        assert place.locator(".tag").text_content() == words[verdict]
    listed = page.locator(".unknown").text_content()
    assert listed.startswith("Not known: ") == bool(found["unknown"])


@pytest.mark.slow
def test_what_was_detected_stands_with_time_size_and_unit(browse, plant):
    page = browse("#/live/plant")
    found = shown(page, plant)
    leak = next(event for event in found["events"] if event["name"] == f"leak_{LEAK}")
    place = page.locator(f'[data-event="leak_{LEAK}"]')
    expect(place).to_contain_text(f"{leak['size']:.2f} ± {2 * leak['size_deviation']:.2f}\u202fg/s")
    at = round(leak["found_s"] - BEGIN)
    expect(place).to_contain_text(f"found at 0:{at // 60:02}:{at % 60:02}")
    expect(place.locator(".tag")).to_have_text("lasts")
    expect(page.locator(".events li.detected", has_text=f"leak {LEAK}").first).to_contain_text("g/s")


@pytest.mark.slow
def test_readings_stand_against_the_model(browse, plant):
    page = browse("#/live/plant")
    found = shown(page, plant)
    compared = 0
    for name, each in found["sensors"].items():
        if each["innovation"] is None:
            continue
        compared += 1
        cells = {
            kind: plain(page.locator(f'[data-value="{kind}_{name}"]').text_content())
            for kind in ("reading", "model", "residual")
        }
        assert cells["reading"].startswith(f"{each['value']:.1f}")
        deviation = abs(each["error"] / each["innovation"])
        assert cells["model"].startswith(f"{each['value'] - each['error']:.1f} ± {2 * deviation:.1f}")
        assert cells["residual"] == f"{each['innovation']:.1f} {SIGMA}".replace("-0.0", "0.0")
    assert compared >= 5


def test_a_silent_sensor_is_named(browse, plant):
    page = browse("#/live/plant")
    shown(page, plant)
    word = page.locator(f'[data-value="word_{ABSENT}"]')
    expect(word).to_have_text("absent")
    expect(page.locator(f'[data-event="absent_{ABSENT}"]')).to_contain_text("lasts")
    expect(page.locator(f'.schematic [data-value="{ABSENT}"]')).to_have_text("\N{EN DASH} \N{DEGREE SIGN}C")


@pytest.mark.slow
def test_samples_are_counted_and_their_age_is_told(browse, plant):
    page = browse("#/live/plant")
    found = shown(page, plant)
    for name, count in found["samples"].items():
        shown_count = page.locator(f'.measurements [data-value="{name}"]').text_content()
        assert re.sub(r"\D", "", shown_count) == str(count), name
    assert found["samples"]["empty"] > 100, "two of a hundred are missing"
    old = time.time() - found["source_time"]
    expect(page.locator('.measurements [data-value="measured"]')).to_contain_text(" ago")
    late = page.locator('.measurements [data-value="measured"].late')
    expect(late).to_have_count(1 if old > 60 else 0)


@pytest.mark.slow
def test_the_model_lies_within_its_band_in_the_series(browse, plant, http):
    page = browse("#/live/plant")
    until_series(page, f"s.table[0].length > 300 && s.table[0].at(-1) >= {SENT - 10}")
    table, panel = page.evaluate(f"() => [{SERIES}.table, {SERIES}.panels[0]]")
    columns = ["measured_pressure_high", "error_pressure_high", "innovation_pressure_high"]
    path = f"/v1/twins/plant/history?columns={','.join(columns)}"
    history = http.get(path).json()["columns"]
    by_time = dict(zip(history["time"], zip(*(history[name] for name in columns), strict=True), strict=True))
    line = panel["lines"][0]
    seen = 0
    for row, at in enumerate(table[0]):
        measured, error, innovation = by_time[at]
        told = [table[line[place]][row] for place in ("at", "model", "low", "high")]
        if measured is None:
            assert told == [None] * 4
            continue
        if not innovation:  # exactly as expected: the band cannot be told from it
            continue
        spread = 2 * abs(error / innovation)
        wanted = [measured, measured - error, measured - error - spread, measured - error + spread]
        assert told == pytest.approx(wanted, rel=1e-4)
        seen += 1
    assert seen > 300


@pytest.mark.slow
def test_far_back_rows_still_belong_together(browse, plant):
    """Where a pixel is more than a second, a second of every step is drawn: no reading meets another's error."""
    page = browse("#/live/plant?span=all", size=NARROW)
    until_series(page, "s.table[0].length > 200 && s.span.from <= 0")
    until_series(page, "s.table[0][1] - s.table[0][0] > 1")
    table, panel = page.evaluate(f"() => [{SERIES}.table, {SERIES}.panels[0]]")
    line = panel["lines"][0]
    pairs = zip(table[line["at"]], table[line["model"]], strict=True)
    errors = [reading - model for reading, model in pairs if reading is not None and model is not None]
    assert len(errors) > 200
    assert math.sqrt(sum(error**2 for error in errors) / len(errors)) < 3, "readings have 1 bar of noise"


def test_there_is_nothing_to_be_set(browse, plant):
    page = browse("#/live/plant")
    expect(page.locator(".twin-head .tag.source")).to_have_text("measured")
    expect(page.get_by_role("button", name="Stop")).to_be_visible()
    expect(page.get_by_role("button", name="Pause")).to_be_hidden()
    for gone in (".controls", ".days", 'form[name="vehicle"]', ".decision:visible"):
        expect(page.locator(gone)).to_have_count(0)
    assert "uncertified" not in page.locator(".twin-head").text_content()


@pytest.mark.slow
def test_new_measurements_move_the_page(browse, plant):
    page = browse("#/live/plant")
    before = shown(page, plant)["seq"]
    plant.send(SENT, SENT + KEPT)
    until_series(page, f"s.table[0].at(-1) >= {before + KEPT}")
    assert shown(page, plant)["seq"] >= before + KEPT


def test_the_list_says_which_twin_is_measured(browse, plant, http):
    http.post("/v1/twins", json={"id": "made", "scenario": "S1", "paused": True})
    page = browse("#/live")
    for twin, source in (("plant", "measured"), ("made", "simulated")):
        card = page.locator(".twin-card").filter(has=page.get_by_role("link", name=f"Open {twin}"))
        expect(card.locator(".tag.source")).to_have_text(source)
    card = page.locator(".twin-card").filter(has=page.get_by_role("link", name="Open plant"))
    expect(card).not_to_contain_text("logic")
    height = card.locator("rect.high").get_attribute("height")
    assert float(height) > 0
    assert violations(page) == []


def test_before_the_first_second_nothing_is_claimed(browse, plant):
    page = browse("#/live/quiet")
    expect(page.locator(".measurements .hint")).to_contain_text("No second is followed yet")
    assert page.locator(".verdicts .tag").all_text_contents() == ["not known"] * 5
    expect(page.locator(".detected .hint")).to_be_visible()


def test_the_gate_is_that_of_the_filter(blank):
    gate = blank.evaluate("async () => (await import('/static/live/measured.js')).GATE.map(({ value }) => value)")
    assert gate == [ROBUST.gate, -ROBUST.gate]


@pytest.mark.slow
@pytest.mark.parametrize(("size", "dark"), [(WIDE, False), (NARROW, True)], ids=["wide", "narrow-dark"])
def test_everybody_can_read_it(browse, plant, size, dark):
    page = browse("#/live/plant", size=size, dark=dark)
    shown(page, plant)
    assert not overflows(page)
    assert violations(page) == []
