"""Real refusals, live: a program of the test's own commands what a limit forbids; the page names the limit."""

from __future__ import annotations

import json
import re
import time

import pytest
from playwright.sync_api import expect

from api.telemetry.session import connect
from station import Status
from station.geometry import VALVES
from station.limits import Limit
from tests.api.page.conftest import NARROW, WIDE, overflows, violations

WORKERS = 0

EQUATIONS = {
    Limit.FLOW: "7.11", Limit.GAP: "7.12", Limit.NO_VEHICLE: "7.14", Limit.HOLD: "7.16", Limit.BOTH_SIDES: "7.17",
    Limit.COMPRESSORS: "7.18", Limit.DISPENSER: "7.19",
}  # fmt: skip

CASES = {  # who comes, what is another at the dispenser, what the program commands, what is refused and why
    # Two outlets, three inlets, and high stands above the hold pressure.
    "stubborn": (
        {"time_s": 0, "start_pressure_bar": 137},
        {},
        ["outlet_high", "outlet_low", "inlet_high", "inlet_medium", "inlet_low"],
        {"outlet_low": Limit.DISPENSER, "inlet_high": Limit.HOLD, "inlet_low": Limit.COMPRESSORS},
    ),
    # Nobody has come yet.
    "early": ({"time_s": 3000, "start_pressure_bar": 137}, {}, ["outlet_medium"], {"outlet_medium": Limit.NO_VEHICLE}),
    # High gives more than this dispenser takes, and low is asked to give and to take.
    "hasty": (
        {"time_s": 0, "start_pressure_bar": 137},
        {"flow_max_g_per_s": 33},
        ["outlet_high", "outlet_low", "inlet_low"],
        {"outlet_high": Limit.FLOW, "inlet_low": Limit.BOTH_SIDES},
    ),
    # Low is not far enough above the vehicle.
    "full": (
        {"time_s": 0, "start_pressure_bar": 690},
        {"outlet_gap_min_bar": 60},
        ["outlet_low"],
        {"outlet_low": Limit.GAP},
    ),
}


@pytest.fixture(scope="module")
def refused(service, http):
    """`refused(case)`: the state of a twin that stands still in a second in which its controller was refused."""
    found = {}
    with connect(service.zenoh) as session:

        def decide(query):
            with query:
                command = CASES[json.loads(query.payload.to_bytes())["twin"]][2]
                query.reply(query.key_expr, json.dumps({"command": command}))

        session.declare_queryable("hrs/v1/*/decide", decide)

        def made(case):
            if case not in found:
                scenario = http.get("/v1/scenarios/S1").json()
                vehicle, dispenser = CASES[case][:2]
                scenario["arrivals"] = {"kind": "trace", "vehicles": [vehicle]}
                scenario["station"]["dispenser"].update(dispenser)
                asked = {"id": case, "scenario": scenario, "controller": "remote", "speed": 2}
                answer = http.post("/v1/twins", json=asked)
                assert answer.status_code == 201, answer.text
                found[case] = _refused(http, case)
            return found[case]

        yield made


def _refused(http, twin):
    """Let it run until the program was heard and refused, then stand still."""
    until = time.monotonic() + 60
    while time.monotonic() < until:
        time.sleep(0.5)
        http.patch(f"/v1/twins/{twin}", json={"paused": True})
        state = http.get(f"/v1/twins/{twin}").json()
        values = state["values"]
        if values and values["decision_status"] == Status.RULE and any(values[f"refused_{name}"] for name in VALVES):
            return state
        http.patch(f"/v1/twins/{twin}", json={"paused": False})
    raise AssertionError(state)


@pytest.mark.parametrize("case", CASES)
def test_the_picture_names_the_limit_that_refuses_a_real_command(browse, refused, case):
    values = refused(case)["values"]
    expected = CASES[case][3]
    assert {name: Limit(int(values[f"refused_{name}"])) for name in VALVES if values[f"refused_{name}"]} == expected
    page = browse(f"#/live/{case}")
    for name in VALVES:
        valve = page.locator(f'[data-valve="{name}"]')
        limit = expected.get(name)
        said = "open" if values[name] else "refused" if limit else "closed"
        expect(valve.locator(".valve-state")).to_have_text(said)
        expect(valve.locator(".limit")).to_have_text(re.compile(rf"\({EQUATIONS[limit]}\)$" if limit else "^$"))
    sentences = page.locator(".reasons li")
    expect(sentences).to_have_count(len(expected))
    for name, sentence in zip((name for name in VALVES if name in expected), sentences.all(), strict=True):
        words = f"{name.replace('_', ' ').capitalize()} refused, Eq. ({EQUATIONS[expected[name]]}): "
        assert sentence.text_content().startswith(words)
    told = page.locator(".events .shield_refusal .details").first
    for name in expected:
        expect(told).to_contain_text(name.replace("_", " "))
        expect(told).to_contain_text(f"Eq. ({EQUATIONS[expected[name]]})")


LAID_OUT = """() => {
    const all = (selector) => [...document.querySelectorAll(`.schematic ${selector}`)];
    const boxes = (selector) => all(selector).map((each) => [each.textContent, each.getBoundingClientRect()]);
    const texts = boxes("text").filter(([said, box]) => said && box.width);
    const shells = boxes(".tank .rim");
    const apart = ([, a], [, b]) =>
        a.right <= b.left || b.right <= a.left || a.bottom <= b.top || b.bottom <= a.top;
    const limits = texts.filter(([said]) => /\\(7/.test(said));
    const others = (one) => [...texts.filter((other) => other !== one), ...shells];
    const beneath = (one) => others(one).filter((other) => !apart(one, other)).map(([said]) => said);
    return [limits.length, limits.flatMap(beneath)];
}"""


@pytest.mark.slow
@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("size", [WIDE, NARROW], ids=["wide", "narrow"])
def test_a_refusal_is_readable_for_everybody(browse, refused, dark, size):
    refused("stubborn")
    page = browse("#/live/stubborn", dark=dark, size=size)
    expect(page.locator(".reasons li")).to_have_count(3)
    assert page.evaluate(LAID_OUT) == [3, []]  # no name of a limit stands on another text or on a tank
    assert not overflows(page)
    assert violations(page) == []
