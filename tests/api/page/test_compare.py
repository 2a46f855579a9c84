"""The view "compare": what it submits and what it shows is what the service says."""

from __future__ import annotations

import csv
import io
import random
import re

import pyarrow.parquet as pq
import pytest
from playwright.sync_api import expect

from api.comparisons.summary import pareto_front
from tests.api.page.comparing import BY, TWO, counted, data, only, opened, place
from tests.api.page.conftest import NARROW, WIDE, overflows, violations


@pytest.mark.slow
def test_what_the_form_submits_is_computed_and_shown(browse, http):
    page = browse("#/compare")
    only(page, scenario={"S1", "S2"}, controller={"logic", "minlp1"})
    page.get_by_label("Replications").fill("2")
    page.get_by_label("Seed").fill("3")
    expect(page.locator("output.runs")).to_have_text(f"2 scenarios {BY} 2 controllers {BY} 2 replications = 8 runs")
    page.get_by_role("button", name="Compare", exact=True).click()
    expect(page.locator(".tables table")).to_have_count(2)
    path = f"/v1/comparisons/{page.url.split('/')[-1]}"
    job = http.get(path).json()
    assert {name: job[name] for name in ("scenarios", "controllers", "replications", "seed")} == {
        **TWO, "replications": 2, "seed": 3,
    }  # fmt: skip
    expect(page.locator(".head .tag")).to_have_text("succeeded")
    for shown, table in zip(
        page.locator(".tables table").all(), http.get(f"{path}/table").json()["tables"], strict=True
    ):
        cells = shown.locator("tbody tr").evaluate_all(
            "rows => rows.map(row => [...row.cells].slice(1).map(cell => cell.textContent))"
        )
        expected = [[row["origin"], *(cell or "\N{EN DASH}" for cell in row["cells"])] for row in table["rows"]]
        assert [[re.sub(r"\s", " ", cell).replace("\N{MINUS SIGN}", "-") for cell in row] for row in cells] == expected
        assert shown.locator("thead th").all_text_contents()[2:] == table["headings"]


def test_bars_are_the_means_spreads_and_printed_figures(browse, http, done):
    page = opened(browse, done)
    figures = http.get(f"{done}/figures").json()
    page.get_by_text("Choose figures").click()
    page.get_by_label("hydrogen delivered [kg]").check()
    for name in ("t_avg", "t_comp_restored", "t_dis", "t_total", "energy", "delivered"):
        metric = page.locator(f'[data-metric="{name}"]')
        expect(metric.locator(".unit")).to_have_text(f"[{figures['units'][name]}]")
        shown = data(page, f'[data-metric="{name}"] .bar', "scenario", "controller", "value", "deviation", "thesis")
        assert shown == [
            (
                item["scenario"],
                item["controller"],
                item["mean"][name],
                item["deviation"][name],
                item["thesis"].get(name),
            )
            for item in figures["items"]
        ]
    lengths = page.locator('[data-metric="t_dis"] .bar rect').evaluate_all("all => all.map(b => b.width.baseVal.value)")
    means = [item["mean"]["t_dis"] for item in figures["items"]]
    assert lengths[0] / lengths[1] == pytest.approx(means[0] / means[1], rel=0.02)
    page.get_by_label("hydrogen delivered [kg]").uncheck()
    expect(page.locator('[data-metric="delivered"]')).to_have_count(0)


@pytest.mark.parametrize("axis", ["t_comp_restored", "t_comp"])
def test_the_trade_off_shows_means_spread_front_and_thesis(browse, http, done, axis):
    page = opened(browse, done)
    page.locator(f"input[name=axis][value={axis}]").check()
    items = http.get(f"{done}/figures").json()["items"]
    best = set()
    for scenario in TWO["scenarios"]:
        here = [item for item in items if item["scenario"] == scenario]
        best |= {
            (scenario, here[p]["controller"])
            for p in pareto_front([(i["mean"][axis], i["mean"]["t_avg"]) for i in here])
        }
    assert data(page, ".tradeoff .mark[data-scenario]", "scenario", "controller", "x", "y", "front") == [
        (i["scenario"], i["controller"], i["mean"][axis], i["mean"]["t_avg"],
         str((i["scenario"], i["controller"]) in best).lower())
        for i in items
    ]  # fmt: skip
    assert data(page, ".tradeoff .panel .whisker", "controller", "dx", "dy") == [
        (i["controller"], i["deviation"][axis], i["deviation"]["t_avg"]) for i in items
    ]
    assert data(page, ".tradeoff .cloud", "controller", "runs") == [(i["controller"], 2) for i in items]
    printed = [(i["controller"], i["thesis"]["t_comp"], i["thesis"]["t_avg"]) for i in items]
    assert data(page, ".tradeoff .panel .mark.hollow", "thesis", "x", "y") == (printed if axis == "t_comp" else [])


def test_the_front_is_the_same_here_and_there(browse):
    page = browse("#/compare")
    draw = random.Random(7)
    for count in (0, 1, 2, 5, 40):
        points = [[draw.randint(0, 9), draw.randint(0, 9)] for _ in range(count)]
        script = "points => import('/static/compare/tradeoff.js').then(({ front }) => front(points))"
        assert page.evaluate(script, points) == [points[p] for p in pareto_front([tuple(point) for point in points])]


@pytest.mark.slow
def test_what_is_downloaded_is_what_the_service_gives(browse, http, done):
    page = opened(browse, done)
    files = {}
    for name in ("CSV", "Parquet", "Report"):
        with page.expect_download() as download:
            page.get_by_role("button", name=name).click()
        files[download.value.suggested_filename.split(".")[-1]] = download.value.path().read_bytes()
    rows = http.get(f"{done}/results").json()["results"]
    assert pq.read_table(io.BytesIO(files["parquet"])).to_pylist() == rows
    read = list(csv.DictReader(io.StringIO(files["csv"].decode())))
    assert [float(row["t_comp_restored"]) for row in read] == [row["t_comp_restored"] for row in rows]
    report = files["html"].decode()
    assert report == http.get(f"{done}/report").text
    assert not re.search(r"<script|<link|@import|\ssrc=|url\(\s*['\"]?http|href=\"(?!#)", report)
    assert report.count("<svg") == 4


@pytest.mark.parametrize(
    ("fill", "field", "says"),
    [
        (
            ("Controllers with settings", "minlp1:horizon=99"),
            "typed",
            "minlp1:horizon=99: horizon: Input should be less",
        ),
        (("Controllers with settings", "minlp1:horizon=2, nobody"), "typed", "nobody: none is called 'nobody'"),
        (("Controllers with settings", "logic"), "typed", "'logic' stands twice"),
        (("Replications", "0"), "replications", "greater than or equal to 1; given 0"),
        (("Replications", ""), "replications", "valid integer"),
        (("Seed", "-1"), "seed", "greater than or equal to 0; given -1"),
    ],
)
def test_what_is_wrong_is_said_at_its_field_and_nothing_is_submitted(browse, http, fill, field, says):
    before = counted(http)
    page = browse("#/compare", expected=["422"])
    only(page, scenario={"S1"}, controller={"logic"})
    page.get_by_label(fill[0]).fill(fill[1])
    page.get_by_role("button", name="Compare", exact=True).click()
    control = page.locator(f"[name={field}]")
    expect(control).to_have_attribute("aria-invalid", "true")
    expect(control).to_be_focused()
    expect(page.locator(".field", has=control).locator(".wrong")).to_contain_text(says)
    expect(page.locator("form .problem")).to_be_hidden()
    assert counted(http) == before


def test_nothing_chosen_is_said_at_both_groups(browse, http):
    page = browse("#/compare", expected=["422"])
    only(page, scenario=set(), controller=set())
    page.get_by_role("button", name="Compare", exact=True).click()
    for name in ("scenario", "controller"):
        expect(page.locator(f"#{name}-wrong")).to_contain_text("at least 1 item")
    assert violations(page) == []


def test_another_station_has_no_printed_figures(browse, http):
    page = browse("#/compare")
    only(page, scenario={"S1"}, controller={"logic"})
    page.get_by_label("Station").select_option("light-duty-700")
    page.get_by_role("button", name="Compare", exact=True).click()
    expect(page.locator(".tables caption")).to_contain_text("station light-duty-700")
    expect(page.locator(".mark.hollow")).to_have_count(0)
    path = f"/v1/comparisons/{page.url.split('/')[-1]}"
    given = http.get(f"{path}/scenarios").json()[0]
    assert given["station"] == http.get("/v1/stations/light-duty-700").json()
    assert given["arrivals"] == http.get("/v1/scenarios/S1").json()["arrivals"]
    page.get_by_role("button", name="Show the schedule").click()
    expect(page.locator(".gantt [data-run]")).to_have_count(1)
    ((run,),) = data(page, ".gantt [data-run]", "run")
    assert http.get(f"/v1/runs/{run}").json()["station"] == "light-duty-700"


def test_a_comparison_is_cancelled_and_deleted(browse, http):
    asked = {"scenarios": ["S3", "S4"], "controllers": ["minlp1", "minlp2"], "replications": 200}
    path = http.post("/v1/comparisons", json=asked).headers["location"]
    page = browse(place(path))
    expect(page.locator(".working progress")).to_have_attribute("max", "800")
    expect(page.locator(".working p")).to_contain_text("of 800 runs")
    page.locator(".working").get_by_role("button", name="Cancel").click()
    expect(page.locator(".head .tag")).to_have_text("cancelled")
    expect(page.locator(".note")).to_contain_text("Cancelled after")
    assert http.get(path).json()["state"] == "cancelled"
    page.get_by_role("link", name="All comparisons").click()
    line = page.locator(f'[data-id="{path.split("/")[-1]}"]')
    expect(line.locator(".why")).to_contain_text("Cancelled after")
    line.get_by_role("button", name="Delete").click()
    page.get_by_role("dialog").get_by_role("button", name="Cancel").click()
    expect(line).to_be_visible()
    line.get_by_role("button", name="Delete").click()
    page.get_by_role("dialog").get_by_role("button", name="Delete").click()
    expect(line).to_have_count(0)
    assert http.get(path).status_code == 404


def test_the_list_cancels_too_and_follows(browse, http):
    asked = {"scenarios": ["S3", "S4"], "controllers": ["minlp1", "minlp2"], "replications": 200}
    path = http.post("/v1/comparisons", json=asked).headers["location"]
    page = browse("#/compare")
    line = page.locator(f'[data-id="{path.split("/")[-1]}"]')
    expect(line.locator("progress")).to_be_visible()
    line.get_by_role("button", name="Cancel").click()
    expect(line.locator(".tag")).to_have_text("cancelled")
    assert http.delete(path).status_code == 204


def test_a_failed_comparison_says_why(browse, http, done):
    job = {**http.get(done).json(), "state": "failed", "runs_done": 0}
    job["problem"] = {"title": "ControllerError", "detail": "controller 'mine' failed at 12 s", "errors": []}
    page = browse()
    page.route(f"**{done}", lambda route: route.fulfill(json=job))
    page.goto(f"{page.url.split('#')[0]}{place(done)}")
    expect(page.locator(".problem")).to_have_text(
        "Failed after 0 of 8 runs: ControllerError. controller 'mine' failed at 12 s"
    )
    expect(page.locator(".empty")).to_contain_text("No run was done")


def test_an_empty_list_invites(browse):
    page = browse()
    page.route("**/v1/comparisons?*", lambda route: route.fulfill(json={"items": [], "before": None}))
    page.goto(f"{page.url.split('#')[0]}#/compare")
    expect(page.locator(".empty")).to_contain_text("four controllers on four scenarios")
    expect(page.locator("output.runs")).to_have_text(f"4 scenarios {BY} 4 controllers {BY} 1 replication = 16 runs")


def test_earlier_comparisons_come_page_by_page(browse, http):
    ids = [
        http.post("/v1/comparisons", json={"scenarios": ["S1"], "controllers": ["logic"]}).json()["id"]
        for _ in range(11)
    ]
    page = browse("#/compare")
    expect(page.locator(".jobs li")).to_have_count(10)
    shown = [item for (item,) in data(page, ".jobs li", "id")]
    page.get_by_role("button", name="Next page").click()
    expect(page.locator(f'[data-id="{ids[0]}"]')).to_be_visible()
    shown += [item for (item,) in data(page, ".jobs li", "id")]
    assert shown[:11] == ids[::-1]
    assert len(shown) == len(set(shown))
    page.reload()
    expect(page.locator(f'[data-id="{ids[0]}"]')).to_be_visible()
    page.get_by_label("Search comparisons").fill(ids[3])
    expect(page.locator(".jobs li")).to_have_count(1)
    page.get_by_label("Search comparisons").fill("S1 no-such-controller")
    expect(page.locator(".jobs li")).to_have_count(0)
    expect(page.locator(".list .hint").first).to_contain_text("match this search")


def test_what_is_gone_is_said(browse):
    page = browse("#/compare/comparison-0", expected=["404"])
    expect(page.locator(".problem")).to_contain_text("no such comparison")
    expect(page.locator("h1")).to_be_visible()


def tab_to(page, selector, most=80) -> None:
    for _ in range(most):
        page.keyboard.press("Tab")
        if page.evaluate("selector => document.activeElement?.matches(selector)", selector):
            return
    raise AssertionError(f"Tab never came to {selector}")


@pytest.mark.slow
def test_the_keyboard_alone_compares(browse):
    page = browse("#/compare")
    expect(page.locator("form.new")).to_be_visible()
    for name in ("S2", "S3", "S4"):
        tab_to(page, f"input[value={name}]")
        page.keyboard.press("Space")
    for name in ("minlp2", "minlp3"):
        tab_to(page, f"input[value={name}]")
        page.keyboard.press("Space")
    tab_to(page, "[name=replications]")
    page.keyboard.press("Enter")
    expect(page.locator(".schedule h2")).to_be_visible()
    tab_to(page, "input[name=axis]")
    page.keyboard.press("ArrowRight")
    expect(page.locator(".tradeoff .panel .mark.hollow")).to_have_count(2)
    tab_to(page, ".asking button")
    page.keyboard.press("Enter")
    expect(page.locator(".gantt svg [data-run]")).to_have_count(2)
    tab_to(page, ".gantt .chart")
    before = page.locator(".gantt output").text_content()
    page.keyboard.press("+")
    expect(page.locator(".gantt output")).not_to_have_text(before)


@pytest.mark.slow
@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("size", [WIDE, NARROW], ids=["wide", "narrow"])
def test_a_result_is_readable_for_everybody(browse, done, dark, size):
    page = opened(browse, done, dark=dark, size=size)
    page.get_by_role("button", name="Show the schedule").click()
    expect(page.locator(".gantt svg [data-run]")).to_have_count(2)
    for text in page.locator("summary").all():
        text.click()
    assert not overflows(page)
    assert violations(page) == []
    page.goto(f"{page.url.split('#')[0]}#/compare")
    expect(page.locator("form.new")).to_be_visible()
    expect(page.locator(".jobs li").first).to_be_visible()
    assert not overflows(page)
    assert violations(page) == []
