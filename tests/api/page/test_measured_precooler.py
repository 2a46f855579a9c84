"""The health of a precooler on the page: told where the model has one, as the service says."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from tests.api.measured import TAGS, batches, rows
from tests.waiting import wait_until

WORKERS = 0


@pytest.mark.slow
@pytest.mark.parametrize(("station", "cools"), [("h70-light", True), ("thesis-fit", False)])
def test_a_precooler_is_told_where_there_is_one(browse, http, station, cools):
    scenario = {
        "name": "field", "station": station,
        "arrivals": {"kind": "trace", "vehicles": [{"time_s": 60.0, "start_pressure_bar": 120.0}]},
    }  # fmt: skip
    twin = f"cooled-{station}"
    asked = {"id": twin, "scenario": scenario, "source": "measured", "tags": TAGS}
    assert http.post("/v1/twins", json=asked).status_code == 201
    for place, batch in enumerate(batches(120, each=40)):
        path = f"/v1/twins/{twin}/measurements?source=plc&sequence={place}"
        assert http.post(path, json=rows(batch)).status_code == 202
    wait_until(lambda: http.get(f"/v1/twins/{twin}").json()["samples"] > 50, 300)  # the filter may be compiled
    found = http.get(f"/v1/twins/{twin}/estimate").json()["health"]
    assert ("precooler_deviation" in found) == cools
    page = browse(f"#/live/{twin}")
    tile = page.locator('[data-health="precooler_deviation"]')
    expect(page.locator('[data-health="leak_high"]')).to_contain_text("g/s")
    if cools:
        expect(tile).to_contain_text("Precooler")
        expect(tile).to_contain_text("K warmer than it should be")
        expect(tile.locator(".tag")).to_have_text("not known")
        expect(page.locator(".unknown")).to_contain_text("precooler")
    else:
        expect(tile).to_have_count(0)
    http.post(f"/v1/twins/{twin}/stop")
