"""What a station with real gas tells besides stands in the live view, with units."""

from __future__ import annotations

from playwright.sync_api import expect

WORKERS = 0
SCENARIO = {
    "name": "gas",
    "station": {"preset": "h70-light"},
    "arrivals": {"kind": "uniform", "count": 2, "period_s": 300.0},
}


def test_state_of_charge_and_powers_are_shown(browse, http):
    request = {"id": "gas", "scenario": SCENARIO, "controller": "logic", "speed": "max", "at_end": "stop"}
    assert http.post("/v1/twins", json=request).status_code == 201
    page = browse("#/live/gas")
    figure = ".own [data-value={}]".format
    expect(page.locator(figure("power_compressor"))).to_have_text("0.0\N{NARROW NO-BREAK SPACE}kW", timeout=30_000)
    expect(page.locator(figure("state_of_charge_vehicle"))).to_have_text("\N{EN DASH}")
