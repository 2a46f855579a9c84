"""A live twin whose model does not fit says so, and tells no part's health."""

from __future__ import annotations

import pytest

from api.measurements.written import parquet_of
from controllers import create
from station import parse_scenario, simulate
from station.batches import batches_of
from station.measured_day import measured_day, tags_of_day
from tests.waiting import wait_until

WORKERS = 0
SECONDS = 3000


@pytest.mark.parametrize("skew", [0, 1])
def test_a_clock_that_is_off_is_no_failing_station(http, skew):
    arrivals = {"kind": "trace", "vehicles": [{"time_s": 300.0 * k, "start_pressure_bar": 120.0} for k in range(10)]}
    faults = [{"kind": "clock_skew", "skew_s": skew, "begin_s": 0.0}] if skew else []
    scenario = {"name": "x", "about": "x", "arrivals": arrivals, "time_limit_s": SECONDS + 10.0, "faults": faults}
    day, tags = measured_day(simulate(parse_scenario(scenario), create("logic")), 5), tags_of_day()
    order = {"id": f"skew{skew}", "scenario": "S1", "source": "measured"}
    order["tags"] = tags.model_dump(mode="json", exclude_unset=True)
    assert http.post("/v1/twins", json=order).status_code == 201
    path = f"/v1/twins/skew{skew}"
    for sequence, batch in enumerate(batches_of(day, tags, 600.0)):
        sent = {"params": {"source": "plc", "sequence": sequence}, "content": parquet_of(batch, tags)}
        sent["headers"] = {"content-type": "application/vnd.apache.parquet"}
        wait_until(lambda sent=sent: http.post(f"{path}/measurements", **sent).status_code == 202)
    wait_until(lambda: http.get(path).json()["samples"] > SECONDS - 20)
    found = http.get(f"{path}/estimate").json()
    assert bool(found["refused"]) == bool(skew)
    assert set(found["health"].values()) == ({"unknown"} if skew else {"sound"})
    http.post(f"{path}/stop")
