"""A live twin whose sources' clocks are apart puts them right, and no part seems to fail."""

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


@pytest.mark.parametrize("skew", [0, 1, -6])
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
    assert not found["refused"]
    assert set(found["health"].values()) == {"sound"}
    assert found["lasting"] == (["clock_skew_transmitters"] if skew else [])
    told = [event for event in found["events"] if event["name"] == "clock_skew_transmitters"]
    assert [(event["size"], event["unit"]) for event in told] == ([(float(skew), "s")] if skew else [])
    alarms = {alarm["name"]: alarm for alarm in http.get(f"{path}/alarms").json()["items"]}
    assert ("clock_skew" in alarms) == bool(skew)
    http.post(f"{path}/stop")
    refused = http.post("/v1/calibrations", json={"twin": f"skew{skew}"}).json()  # six hours are needed
    kept = int(refused["errors"][0]["message"].rpartition("given ")[2])
    samples = http.get(path).json()["samples"]
    assert samples - kept == max([0, *(int(event["found_s"]) - 1 for event in told)]), "of wrong clocks"
