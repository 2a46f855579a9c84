"""A station with real gas over REST: runs, comparisons and twins like any other, with the columns of its own."""

from __future__ import annotations

import math
import time

import pytest

from api.comparisons.tables import COSTS
from controllers import create_from
from station import parse_scenario, simulate
from station.plants.real_gas.entries import FIGURES, LEVELS, RATES
from tests.api.conftest import ended

WORKERS = 1
SCENARIO = {
    "name": "two",
    "station": {"preset": "h70-light"},
    "arrivals": {"kind": "uniform", "count": 2, "period_s": 300.0},
}


@pytest.mark.slow
def test_a_run_keeps_what_the_plant_tells(http):
    answer = http.post("/v1/runs", json={"scenario": SCENARIO, "controller": "logic"})
    assert answer.status_code == 202, answer.text
    run = ended(http, f"/v1/runs/{answer.json()['id']}")
    assert run["state"] == "succeeded", run
    path = f"/v1/runs/{run['id']}"
    series = http.get(f"{path}/series", params={"columns": "energy_compressor,power_precooler"}).json()
    assert series["units"] == {"time": "s", "energy_compressor": "kWh", "power_precooler": "kW"}
    assert set(LEVELS) < set(http.get(f"{path}/series", params={"columns": ",".join(LEVELS)}).json()["columns"])
    vehicles = http.get(f"{path}/vehicles").json()
    assert set(FIGURES) < set(vehicles["columns"])
    assert vehicles["columns"]["state_of_charge"] == pytest.approx([0.95] * 2, abs=2e-4)
    figures = run["metrics"]
    assert figures["energy_kwh"] > 0.5
    assert figures["total_eur"] == sum(figures[name] for name in ("energy_eur", "demand_eur", "stock_eur"))
    assert "revenue_eur" not in figures


def test_a_comparison_of_controllers(http):
    given = {"scenarios": [SCENARIO], "controllers": ["logic", "reserve"], "replications": 1}
    answer = http.post("/v1/comparisons", json=given)
    assert answer.status_code == 202, answer.text
    path = f"/v1/comparisons/{answer.json()['id']}"
    assert ended(http, path)["state"] == "succeeded"
    assert http.get(f"{path}/table").json()["tables"][0]["headings"][-4:] == list(COSTS.values())
    results, figures = (http.get(f"{path}/{name}").json() for name in ("results", "figures"))
    assert results["units"] == figures["units"]
    assert results["units"]["eur_per_kg"] == "EUR/kg"
    assert figures["items"][0]["mean"]["total_eur"] == results["results"][0]["total_eur"]
    text = http.get(f"{path}/results", params={"format": "csv"}).text
    assert text.splitlines()[0].endswith("eur_per_kg,kwh_per_kg,peak_kw")


def test_a_twin(http):
    answer = http.post(
        "/v1/twins", json={"id": "gas", "scenario": SCENARIO, "controller": "logic", "speed": "max", "at_end": "stop"}
    )
    assert answer.status_code == 201, answer.text
    until = time.monotonic() + 30
    while http.get("/v1/twins/gas").json()["state"] != "finished" and time.monotonic() < until:
        time.sleep(0.2)
    ends = [event for event in http.get("/v1/twins/gas/events").json()["items"] if event["kind"] == "fill_end"]
    assert len(ends) == 2
    own = [*RATES, *LEVELS]
    # Every second of a twin has a row, so that the record must have one, too.
    record = simulate(parse_scenario({**SCENARIO, "idle_period_s": 1}), create_from("logic"))
    told = http.get("/v1/twins/gas/history", params={"columns": ",".join(own)}).json()
    assert {name: told["units"][name] for name in own} == {**RATES, **LEVELS}
    for name in own:
        expected = [None if math.isnan(figure) else figure for figure in record[name].tolist()]
        assert told["columns"][name] == expected, name
    text = http.get("/v1/twins/gas/history", params={"format": "csv"}).text
    assert set(own) < set(text.splitlines()[0].replace('"', "").split(","))
    values = http.get("/v1/twins/gas").json()["values"]
    assert {name: values[name] for name in RATES} == dict.fromkeys(RATES, 0.0)
    (day,) = http.get("/v1/twins/gas/days").json()["items"]
    assert day["energy_eur"] == pytest.approx(record.metrics()["energy_eur"], rel=1e-9)
