"""Comparisons: the thesis's tables, replications, and the documents they make."""

from __future__ import annotations

import dataclasses
import io
import json
import math
import re

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from api.comparisons import report, schedule, tables
from api.comparisons.gantt import gantt, pieces
from api.comparisons.schedule import SCHEDULES_MAX, VALVES, schedule_of, schedules, spans
from api.comparisons.service import as_document, compare
from api.comparisons.summary import pareto_front, summaries
from api.comparisons.tables import _cell
from api.comparisons.thesis import cells_of, closeness, printed
from controllers import create
from station import InputError, load_scenario, load_station, simulate
from station.metrics import UNITS
from tests.api.conftest import ended

FOUR = ["logic", "minlp1", "minlp2", "minlp3"]
SCENARIOS = [load_scenario(name) for name in ("S1", "S2", "S3", "S4")]


@pytest.fixture(scope="module")
def results():
    return compare(SCENARIOS, FOUR)


def test_the_fitted_station_reproduces_the_printed_tables(results):
    """Signs and orderings of tables 7.4-7.7; all 36 signs are a knife edge, so 34 is what must hold."""
    found = closeness(cells_of(results))
    assert (found.signs_of, found.orderings_of) == (36, 72)
    assert found.signs >= 34
    assert found.orderings >= 68
    assert found.log_error_median <= 0.13


def test_t_avg_is_t_total_by_vehicles_as_printed():
    for (scenario, controller, column), value in printed().items():
        if column == "t_avg":
            total = printed()[scenario, controller, "t_total"]
            assert value == pytest.approx(total / (5 if scenario in ("S1", "S2") else 96), abs=1.0)


# What the fitted sets gave their fitter: [t_total, t_comp, t_dis] in seconds.
FITTED = {
    ("thesis-fit", "S1", "logic"): (1054, 1352, 1858),
    ("thesis-fit", "S1", "minlp1"): (846, 1517, 1695),
    ("thesis-fit", "S1", "minlp2"): (1114, 1321, 1874),
    ("thesis-fit", "S1", "minlp3"): (1115, 1308, 1843),
    ("thesis-fit", "S3", "logic"): (36411, 28566, 39098),
    ("thesis-fit", "S3", "minlp3"): (50703, 27712, 39132),
    ("thesis-fit", "S4", "logic"): (40438, 28602, 39079),
    ("thesis-fit", "S4", "minlp3"): (53387, 27719, 39126),
    ("thesis-fit-cascade", "S1", "logic"): (3087, 2478, 2060),
    ("thesis-fit-cascade", "S1", "minlp1"): (2473, 2829, 1979),
    ("thesis-fit-cascade", "S1", "minlp2"): (5611, 2191, 2071),
    ("thesis-fit-cascade", "S3", "logic"): (38057, 35222, 38395),
    ("thesis-fit-cascade", "S3", "minlp1"): (426, 43462, 28532),
    ("thesis-fit-cascade", "S3", "minlp2"): (47783, 32597, 38797),
    ("thesis-fit-cascade", "S3", "minlp3"): (52083, 32541, 38897),
    ("thesis-fit-a", "S1", "logic"): (1405, 1737, 1893),
    ("thesis-fit-a", "S1", "minlp3"): (2458, 1577, 1871),
    ("thesis-fit-a", "S3", "logic"): (35846, 38479, 37427),
    ("thesis-fit-a", "S3", "minlp2"): (42193, 34541, 39575),
}


@pytest.mark.parametrize(("preset", "scenario", "controller"), FITTED)
def test_presets_give_what_their_fit_gave(preset, scenario, controller):
    found = simulate(load_scenario(scenario).on(load_station(preset)), create(controller)).metrics()
    assert (found.t_total, found.t_comp, found.t_dis) == FITTED[preset, scenario, controller]


def test_same_seed_same_bytes_on_one_core_or_two():
    chosen = [load_scenario("S2")]
    one, two = (
        json.dumps(as_document(compare(chosen, FOUR, replications=5, seed=4, workers=workers))) for workers in (1, 2)
    )
    assert one == two
    other = json.dumps(as_document(compare(chosen, FOUR, replications=5, seed=5)))
    assert other != one


def test_replication_0_is_the_pattern_and_every_controller_meets_the_same_vehicles():
    chosen = [load_scenario("S1")]
    rows = as_document(compare(chosen, FOUR, replications=3, seed=1))["results"]
    assert [row["replication"] for row in rows] == [0, 1, 2] * 4
    pattern = {row["controller"]: row for row in as_document(compare(chosen, FOUR))["results"]}
    assert all(row["t_total"] == pattern[row["controller"]]["t_total"] for row in rows if row["replication"] == 0)


@pytest.mark.slow
def test_options_make_another_controller_of_the_same_name():
    chosen = [load_scenario("S1")]
    rows = as_document(compare(chosen, ["minlp2", "minlp2:horizon=5", "logic:dispense=cascade"]))["results"]
    assert [row["controller"] for row in rows] == ["minlp2", "minlp2:horizon=5", "logic:dispense=cascade"]
    longer = simulate(chosen[0], create("minlp2", horizon=5)).metrics()
    assert rows[1]["t_total"] == longer.t_total != rows[0]["t_total"]


def test_rows_have_what_the_documentation_names(results):
    row = as_document(results)["results"][0]
    assert row["scenario"] == "S1"
    assert row["controller"] == "logic"
    assert {"replication", "seed", "t_total", "t_avg", "t_comp", "t_comp_restored", "t_dis"} <= set(row)
    json.dumps(as_document(results), allow_nan=False)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"controllers": ["logic", "nobody"]}, "none is called 'nobody'"),
        ({"controllers": ["logic", "logic"]}, "'logic' stands twice"),
        ({"controllers": ["minlp1:horizon=99"]}, "horizon: Input should be less than or equal to 20"),
        ({"controllers": []}, "must name at least one"),
        ({"replications": 0}, "replications: must be 1 to"),
        ({"seed": -1}, "seed: must not be negative"),
    ],
)
def test_wrong_comparisons_are_refused_before_anything_runs(arguments, message):
    with pytest.raises(InputError, match=message):
        compare([load_scenario("S1")], **{"controllers": FOUR, **arguments})


def test_tables_stand_beside_the_thesis(results):
    found = tables.tables(SCENARIOS, results)
    assert [table.title[:9] for table in found] == ["Table 7.4", "Table 7.5", "Table 7.6", "Table 7.7"]
    logic = [row for row in found[0].rows if row.controller == "logic" or row.origin == "thesis"][:2]
    assert logic[0].cells[0] == "1 054"
    assert logic[1].cells[0] == "1 148"
    assert "of 72 pairwise orderings" in tables.verdict(SCENARIOS, results)
    elsewhere = [load_scenario("S1").on(load_station("light-duty-700"))]
    plain = tables.tables(elsewhere, compare(elsewhere, FOUR))[0]
    assert {row.origin for row in plain.rows} == {"ours"}


@pytest.mark.slow
@given(data=st.data())
def test_whatever_part_of_the_runs_is_done_can_be_told(results, data):
    """A page that follows a comparison asks for what has come so far, whichever runs those are."""
    part = data.draw(st.lists(st.sampled_from(results), unique_by=id))
    names = {(run.scenario, run.controller) for run in part}
    assert {(each.scenario, each.controller) for each in summaries(SCENARIOS, part)} == names
    assert len(tables.tables(SCENARIOS, part)) == len(SCENARIOS)
    pairs = sum(math.comb(sum(name == scenario.name for name, _ in names), 2) for scenario in SCENARIOS)
    verdict = tables.verdict(SCENARIOS, part)
    assert f" {3 * pairs} pairwise orderings" in verdict if pairs else verdict == ""


@pytest.mark.slow
def test_the_report_is_one_page_that_loads_nothing(results):
    page = report.html(SCENARIOS, results, tables.tables(SCENARIOS, results))
    assert page.count("<table>") == 4
    assert page.count("<svg") == 2 + len(SCENARIOS)
    for elsewhere in ("src=", "@import", "url(http", "<script", "<link"):
        assert elsewhere not in page
    assert page == report.html(SCENARIOS, results, tables.tables(SCENARIOS, results))
    assert "36 signs" in page


def test_spans_are_the_stretches_of_a_column():
    time = np.arange(8.0)
    assert spans(time, np.array([1, 1, 0, 1, 0, 0, 1, 1])) == ((0.0, 2.0), (3.0, 4.0), (6.0, 7.0))
    assert spans(time, np.zeros(8)) == ()
    assert spans(time, np.eye(8)[7]) == ()  # the last row holds for no time


def test_the_schedule_is_that_of_the_record(results):
    record = simulate(SCENARIOS[1], create("minlp1"))
    one = schedule_of(record)
    assert one == schedules(SCENARIOS, results)["S2"][1]
    for valve, found in zip(VALVES, one.valves, strict=True):
        assert sum(end - begin for begin, end in found) == record[valve][:-1].sum()
    assert [begin for begin, _ in one.waits] == record.vehicles["arrival"].tolist()
    assert [list(span) for span in one.fills] == np.stack(
        [record.vehicles["connected"], record.vehicles["finished"]], axis=1
    ).tolist()
    assert (one.finished, one.end) == (len(one.waits), record["time"][-1])


@pytest.mark.slow
def test_the_first_replication_is_drawn_and_not_too_many(results):
    drawn = schedules(SCENARIOS, results)
    assert {name: [each.controller for each in found] for name, found in drawn.items()} == dict.fromkeys(
        ("S1", "S2", "S3", "S4"), FOUR
    )
    many = compare(SCENARIOS[:1], ["logic"], replications=3, seed=2)
    assert schedules(SCENARIOS, many[1:])["S1"][0] == schedule_of(
        simulate(SCENARIOS[0], create("logic"), replication=1, seed=2)
    )
    names = [SCENARIOS[0].model_copy(update={"name": f"s{n}"}) for n in range(SCHEDULES_MAX + 3)]
    page = report.html(names, compare(names, ["logic"]), [])
    assert page.count('<svg class="gantt"') == SCHEDULES_MAX
    assert "3 of the runs are not drawn" in page


def test_what_is_drawn_is_where_the_record_says():
    one = schedule_of(simulate(SCENARIOS[0], create("minlp1")))
    drawing = gantt("S<1>", [one])
    assert "S&lt;1&gt;" in drawing
    assert "5 of 5 vehicles finished" in drawing
    scale = (1100 - 112 - 14) / one.end
    (bars,) = re.findall(r'<path fill="#15803d" opacity="1" d="([^"]+)"', drawing)
    assert [tuple(map(float, pair)) for pair in re.findall(r"M([\d.]+) [\d.]+h([\d.]+)", bars)] == [
        pytest.approx((112 + begin * scale, (end - begin) * scale - 1.6), abs=0.06) for begin, end in one.fills
    ]


def test_a_long_run_makes_no_long_drawing():
    """A valve that switches every second for a day, and ten thousand vehicles."""
    every = tuple((float(t), t + 1.0) for t in range(0, 86_400, 2))
    busy = schedule.Schedule("c", 86_400.0, every[:10_000], every[:10_000], 10_000, (every,) * 6)
    drawing = gantt("S", [busy])
    assert len(drawing) < 40_000
    assert pieces([(a / 100, b / 100) for a, b in every]) == [(0.0, pytest.approx(863.99), 1)]
    apart = [(0.0, 3.0), (10.0, 12.0)]
    assert pieces(apart) == [(*span, 3) for span in apart]


@pytest.mark.slow
def test_a_report_of_another_station_claims_nothing_about_the_thesis():
    elsewhere = [load_scenario("S1").on(load_station("light-duty-700"))]
    found = compare(elsewhere, FOUR[:2])
    assert "Against the thesis" not in report.html(elsewhere, found, tables.tables(elsewhere, found))
    assert [summary.thesis for summary in summaries(elsewhere, found)] == [{}, {}]


def test_a_report_of_what_is_there_so_far(results):
    """A comparison that was cancelled may lack a scenario, or a controller of one."""
    first = results[:2]
    page = report.html(SCENARIOS[:2], first, tables.tables(SCENARIOS[:2], first))
    assert page.count("<table>") == 2


def test_summaries_hold_mean_spread_and_what_is_not_finite():
    found = compare([load_scenario("S1")], ["logic"], replications=3, seed=2)
    one = summaries([load_scenario("S1")], found)[0]
    waits = [result.metrics.t_avg for result in found]
    mean = sum(waits) / 3
    assert (one.runs, one.thesis["t_comp"]) == (3, 1420)
    assert one.mean["t_avg"] == pytest.approx(mean)
    assert one.deviation["t_avg"] == pytest.approx(math.sqrt(sum((wait - mean) ** 2 for wait in waits) / 2))
    endless = dataclasses.replace(found[0], metrics=dataclasses.replace(found[0].metrics, t_comp_restored=math.inf))
    one = summaries([load_scenario("S1")], [endless, *found[1:]])[0]
    assert math.isinf(one.mean["t_comp_restored"])
    assert one.mean["energy_kwh"] == pytest.approx(sum(result.metrics.energy_kwh for result in found) / 3)
    powerless = dataclasses.replace(found[0], metrics=dataclasses.replace(found[0].metrics, energy_kwh=None))
    assert math.isnan(summaries([load_scenario("S1")], [powerless, *found[1:]])[0].mean["energy_kwh"])


@pytest.mark.parametrize(
    ("points", "kept"),
    [
        ([], []),
        ([(2, 2)], [0]),
        ([(3, 1), (1, 3), (2, 2), (3, 3)], [1, 2, 0]),
        ([(1, 2), (1, 1), (2, 1)], [1]),
        ([(1, 1), (1, 1)], [0, 1]),
        ([(math.inf, 0), (1, 1), (math.nan, 0)], [1]),
    ],
)
def test_the_front_is_what_no_other_undercuts(points, kept):
    assert pareto_front(points) == kept


@pytest.mark.slow
def test_the_service_gives_every_file(http):
    asked = {"scenarios": ["S1"], "controllers": ["logic", "minlp1"], "replications": 2, "seed": 3}
    path = f"/v1/comparisons/{http.post('/v1/comparisons', json=asked).json()['id']}"
    assert ended(http, path)["state"] == "succeeded"
    rows = http.get(f"{path}/results").json()["results"]
    table = pq.read_table(io.BytesIO(http.get(f"{path}/results", params={"format": "parquet"}).content))
    assert table.to_pylist() == rows
    assert table.schema.field("t_comp").metadata == {b"unit": b"s"}
    assert http.get(f"{path}/results", params={"format": "csv"}).text.count("\n") == 5
    scenarios = [load_scenario("S1")]
    assert http.get(f"{path}/scenarios").json() == [json.loads(scenarios[0].model_dump_json())]
    here = compare(scenarios, ["logic", "minlp1"], replications=2, seed=3)
    figures = http.get(f"{path}/figures").json()
    assert figures["units"] == UNITS
    assert [(item["controller"], item["runs"]) for item in figures["items"]] == [("logic", 2), ("minlp1", 2)]
    for item, summary in zip(figures["items"], summaries(scenarios, here), strict=True):
        assert {name: value for name, value in item["mean"].items() if value is not None} == {
            name: value for name, value in summary.mean.items() if math.isfinite(value)
        }
        assert item["thesis"] == summary.thesis
    page = http.get(f"{path}/report")
    assert page.text == report.html(scenarios, here, tables.tables(scenarios, here))
    assert page.headers["content-type"] == "text/html; charset=utf-8"
    assert "default-src 'none'" in page.headers["content-security-policy"]


def test_nothing_done_yet_makes_no_report(http):
    asked = {"scenarios": ["S3", "S4"], "controllers": ["minlp1"], "replications": 50}
    path = f"/v1/comparisons/{http.post('/v1/comparisons', json=asked).json()['id']}"
    http.post(f"{path}/cancel")
    assert http.get(f"{path}/report").status_code == 409
    assert http.get(f"{path}/figures").json()["items"] == []
    assert http.delete(path).status_code == 204


@pytest.mark.parametrize(
    ("figure", "logic", "shown"),
    [(math.inf, math.inf, "inf"), (5.0, math.inf, "5"), (5.0, 4.0, "5 +25 %"), (5.0, 0.0, "5")],
)
def test_nothing_is_compared_with_what_never_ends(figure, logic, shown):
    assert _cell("t_comp_restored", {"t_comp_restored": figure}, {"t_comp_restored": logic}) == shown
