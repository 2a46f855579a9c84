"""A recorded day has nothing to draw: it is run once, and that is said, wherever replications are asked for."""

from __future__ import annotations

import json

import pytest

from api.comparisons.service import SAME, compare
from api.comparisons.tables import tables
from controllers import create
from station import load_scenario, parse_scenario, simulate
from tests.api.conftest import ended
from tests.api.test_cli import hrs

VEHICLES = [{"time_s": 30 * k, "start_pressure_bar": 100 + 9 * k} for k in range(3)]
TRACE = {"name": "day", "arrivals": {"kind": "trace", "vehicles": VEHICLES}, "time_limit_s": 400.0}
LAW = {**TRACE, "name": "law", "arrivals": {"kind": "uniform", "count": 3, "period_s": 90.0}}
EXACT = {"parameters": 0.0, "pressure_bar": 0.0, "temperature_k": 0.0}
SHARES = (
    "inlet_coefficient", "outlet_coefficient", "inlet_heating", "outlet_cooling", "vehicle_heating", "heat_exchange",
    "compressor_pressure", "ambient_temperature",
)  # fmt: skip
FIXED = {"sensors": "exact", "plant": "corner", "shares": dict.fromkeys(SHARES, 0.5)}


def _disturbed(**given):
    return {**TRACE, "disturbance": given}


SCENARIOS = {
    "trace": (TRACE, False),
    "law": (LAW, True),
    "noise": (_disturbed(sensors="uniform", plant="nominal"), True),
    "plant": (_disturbed(sensors="exact", plant="uniform"), True),
    "exact": (_disturbed(sensors="exact", plant="nominal"), False),
    "no error": (_disturbed(sensors="corner", plant="corner", uncertainty=EXACT), False),
    "fixed shares": (_disturbed(**FIXED), False),
    "fixed shares, silent": ({**_disturbed(**FIXED), "communication": False}, True),
    "temperature alone": (
        _disturbed(sensors="uniform", plant="nominal", uncertainty={**EXACT, "temperature_k": 0.5}),
        True,
    ),
}


def _told(scenario, replication):
    """All that a replication is made of."""
    sensors = scenario.sensor_model(replication)
    key = sensors.key if scenario.drawn else 0  # one that no sensor has an error to use
    return [scenario.plant(replication), key, [column.tolist() for column in scenario.vehicles(replication)]]


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_scenario_says_whether_its_replications_differ(name):
    given, drawn = SCENARIOS[name]
    scenario = parse_scenario(given)
    assert scenario.drawn is drawn
    runs = {simulate(scenario, create("logic"), replication=k).to_bytes() for k in range(4)}
    assert len({json.dumps(_told(scenario, k)) for k in range(4)}) == (4 if drawn else 1)
    assert len(runs) == 1 or drawn


def test_a_comparison_runs_it_once_beside_others(http):
    asked = {"scenarios": [TRACE, "S1"], "controllers": ["logic", "minlp1"], "replications": 5}
    job = ended(http, http.post("/v1/comparisons", json=asked).headers["location"])
    assert (job["state"], job["runs"], job["runs_done"]) == ("succeeded", 12, 12)
    assert job["scenario_replications"] == [
        {"scenario": "day", "replications": 1, "reason": SAME}, {"scenario": "S1", "replications": 5, "reason": None},
    ]  # fmt: skip
    path = f"/v1/comparisons/{job['id']}"
    figures = {(item["scenario"], item["controller"]): item for item in http.get(f"{path}/figures").json()["items"]}
    assert {key: item["runs"] for key, item in figures.items()} == {
        ("day", "logic"): 1, ("day", "minlp1"): 1, ("S1", "logic"): 5, ("S1", "minlp1"): 5,
    }  # fmt: skip
    assert figures["day", "logic"]["deviation"] is None
    assert figures["S1", "logic"]["deviation"]["t_total"] > 0
    rows = http.get(f"{path}/results").json()["results"]
    chosen = [parse_scenario(TRACE), load_scenario("S1")]
    assert rows == [each.as_row() for each in compare(chosen, ["logic", "minlp1"], replications=5)]
    day, others = http.get(f"{path}/table").json()["tables"]
    assert "nothing in it is drawn" in day["title"]
    assert {row["origin"] for row in day["rows"]} == {"ours"}
    assert {"mean of 5", "std dev"} <= {row["origin"] for row in others["rows"]}


def test_runs_are_counted_as_they_are_run(http):
    """Of a recorded day a million replications are one run."""
    answer = http.post("/v1/comparisons", json={"scenarios": [TRACE], "controllers": ["logic"], "replications": 10_000})
    assert answer.json()["runs"] == 1


def test_the_command_line_says_so_too(tmp_path):
    (tmp_path / "day.json").write_text(json.dumps(TRACE))
    arguments = ("compare", "day.json", "S1", "--controllers", "logic", "--replications", "3", "--json", "o.json")
    done = hrs(*arguments, cwd=tmp_path)
    assert f"day: {SAME}" in done.stderr
    assert "std dev" in done.stdout
    rows = json.loads((tmp_path / "o.json").read_text())["results"]
    assert [(row["scenario"], row["replication"]) for row in rows] == [("day", 0), ("S1", 0), ("S1", 1), ("S1", 2)]


def test_a_title_holds_no_sentence_of_another_scenario():
    day = parse_scenario(TRACE)
    (table,) = tables([day], compare([day], ["logic"]))
    assert table.title == "day: a scenario of yours; station thesis-fit; nothing in it is drawn: one run each"
    changed = parse_scenario({**TRACE, "station": {"preset": "thesis-fit", "compressor": {"count": 2}}})
    assert changed.station.about == "thesis-fit with changes in compressor"
    told = parse_scenario({**TRACE, "station": {"preset": "thesis-fit", "compressor": {"count": 2}, "about": "mine"}})
    assert told.station.about == "mine"


def test_the_printed_figures_stand_beside_its_own_scenarios_alone():
    own = parse_scenario({**load_scenario("S1").model_dump(), "arrivals": LAW["arrivals"]})
    for scenario, number in ((load_scenario("S1"), "Table 7.4  S1"), (own, "S1")):
        (table,) = tables([scenario], compare([scenario], ["logic"]))
        assert table.title.startswith(f"{number}: ")
        assert ("thesis" in {row.origin for row in table.rows}) == (scenario is not own)
