"""The view "compare": what it submits and what it shows is what the service says."""

from __future__ import annotations

import csv
import io
import random
import re
from collections import Counter

import pyarrow.parquet as pq
import pytest
from playwright.sync_api import expect

from api.comparisons.summary import front
from tests.api.conftest import ended
from tests.api.page.conftest import NARROW, WIDE, overflows, violations

TWO = {"scenarios": ["S1", "S2"], "controllers": ["logic", "minlp1"]}
BY = "\N{MULTIPLICATION SIGN}"
VALVES = [f"{side}_{buffer}" for side in ("outlet", "inlet") for buffer in ("high", "medium", "low")]


def compared(http, **asked) -> str:
    """Path of a comparison that is done."""
    path = http.post("/v1/comparisons", json={**TWO, **asked}).headers["location"]
    assert ended(http, path)["state"] == "succeeded"
    return path


@pytest.fixture(scope="module")
def done(http):
    return compared(http, replications=2, seed=3)


def place(path: str) -> str:
    return f"#/compare/{path.rsplit('/', maxsplit=1)[-1]}"


def opened(browse, path, **how):
    page = browse(place(path), **how)
    expect(page.locator(".schedule h2")).to_be_visible()
    return page


def only(page, **chosen) -> None:
    """Choose these scenarios and controllers in the form, and no others."""
    expect(page.locator("form.new")).to_be_visible()
    for name, wanted in chosen.items():
        for box in page.locator(f"input[name={name}]").all():
            box.set_checked(box.get_attribute("value") in wanted)


def data(page, selector, *names) -> list[tuple]:
    """Attributes data-* of the elements a selector finds, numbers as such."""
    found = page.locator(selector).evaluate_all("all => all.map(each => ({...each.dataset}))")
    return [tuple(_read(item.get(name)) for name in names) for item in found]


def _read(text):
    try:
        return float(text)
    except (TypeError, ValueError):
        return text


def counted(http) -> int:
    return len(http.get("/v1/comparisons", params={"limit": 200}).json()["items"])


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
            (scenario, here[p]["controller"]) for p in front([(i["mean"][axis], i["mean"]["t_avg"]) for i in here])
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
        assert page.evaluate(script, points) == [points[p] for p in front([tuple(point) for point in points])]


def spans(time, column) -> list[list[float]]:
    """From when to when a valve is open."""
    found = []
    for row, (since, is_open) in enumerate(zip(time, column, strict=True)):
        if is_open and (row == 0 or not column[row - 1]):
            found.append([since, time[-1]])
        if not is_open and row and column[row - 1]:
            found[-1][1] = since
    return [span for span in found if span[1] > span[0]]


def drawn(page, run, valve) -> list[list[float]]:
    """From when to when a row's blocks reach on the time axis, as its path says."""
    script = """(group, valve) => {
      const [from, to] = [group.ownerSVGElement.dataset.from, group.ownerSVGElement.dataset.to].map(Number);
      const path = group.querySelector(".rows").getAttribute("d").match(/^M(\\d+) [^H]*H(\\d+)/).slice(1).map(Number);
      const second = (path[1] - path[0]) / (to - from);
      const d = [...group.querySelectorAll(`[data-valve=${valve}] path`)].map(each => each.getAttribute("d")).join("");
      return [...d.matchAll(/M([\\d.]+) [\\d.]+H([\\d.]+)/g)]
        .map(([, a, b]) => [a, b].map(x => from + (x - path[0]) / second));
    }"""
    return page.locator(f'[data-run="{run}"]').evaluate(script, valve)


def test_the_schedule_is_the_series(browse, http, done):
    page = opened(browse, done)
    page.locator("#gantt-scenario").select_option("S2")
    page.get_by_role("button", name="Show the schedule").click()
    expect(page.locator(".gantt svg [data-run]")).to_have_count(2)
    runs = data(page, ".gantt [data-run]", "controller", "run")
    table = page.locator(".gantt tbody tr")
    for row, (controller, run) in enumerate(runs):
        about = http.get(f"/v1/runs/{run}").json()
        assert (about["scenario"], about["controller"], about["replication"], about["seed"]) == ("S2", controller, 0, 3)
        columns = http.get(f"/v1/runs/{run}/series").json()["columns"]
        vehicles = http.get(f"/v1/runs/{run}/vehicles").json()["columns"]
        at = f'.gantt [data-run="{run}"]'
        assert data(page, f"{at} [data-vehicle]", "connected", "finished") == list(
            zip(vehicles["connected"], vehicles["finished"], strict=True)
        )
        assert [arrival for (arrival,) in data(page, f"{at} .arrival", "arrival")] == vehicles["arrival"]
        found = {valve: spans(columns["time"], columns[valve]) for valve in VALVES}
        assert data(page, f"{at} [data-valve]", "valve", "spans") == [(v, len(found[v])) for v in VALVES]
        cells = table.nth(row).locator("td").all_text_contents()[2:]
        for cell, valve in zip(cells, VALVES, strict=True):
            total = sum(end - since for since, end in found[valve])
            assert re.sub(r"(?<=\d)\s(?=\d)", "", cell) == f"{total:.0f}\u202fs in {len(found[valve])}"

    for _ in range(3):
        before = page.locator(".gantt output").text_content()
        page.get_by_role("button", name="Zoom in").click()
        expect(page.locator(".gantt output")).not_to_have_text(before)
    ((since, until),) = data(page, ".gantt .chart > svg", "from", "to")
    for _, run in runs:
        columns = http.get(f"/v1/runs/{run}/series").json()["columns"]
        for valve in VALVES:
            inside = [(a, b) for a, b in spans(columns["time"], columns[valve]) if since + 0.1 < a and b < until - 0.1]
            shown = [(a, b) for a, b in drawn(page, run, valve) if since + 0.1 < a and b < until - 0.1]
            assert len(shown) == len(inside)
            for ours, theirs in zip(sorted(shown), inside, strict=True):
                assert ours == pytest.approx(theirs, abs=0.05)


def _seconds(text: str) -> int:
    hours, minutes, seconds = (int(part) for part in text.split(":"))
    return 3600 * hours + 60 * minutes + seconds


def test_runs_that_are_kept_are_read_again(browse, http, done):
    for _ in range(2):
        page = opened(browse, done)
        page.locator("#gantt-replication").select_option("1")
        page.get_by_role("button", name="Show the schedule").click()
        expect(page.locator(".gantt svg [data-run]")).to_have_count(2)
    runs = http.get("/v1/runs", params={"limit": 200}).json()["items"]
    asked = Counter((run["scenario"], run["controller"], run["replication"], run["seed"]) for run in runs)
    assert asked["S1", "logic", 1, 3] == asked["S1", "minlp1", 1, 3] == 1


def test_mouse_and_keys_move_and_zoom_the_schedule(browse, done):
    page = opened(browse, done)
    page.get_by_role("button", name="Show the schedule").click()
    extent, chart = page.locator(".gantt output"), page.locator(".gantt .chart")
    expect(extent).to_contain_text("0:00:00 to ")
    whole = extent.text_content()
    chart.focus()

    def after(doing) -> tuple[int, int]:
        before = extent.text_content()
        doing()
        expect(extent).not_to_have_text(before)
        since, until = (_seconds(text) for text in extent.text_content().split(" to "))
        return since, until

    keys = page.keyboard
    since, until = after(lambda: keys.press("+"))
    assert until - since == pytest.approx(_seconds(whole.split(" to ")[1]) / 2, abs=2)
    assert after(lambda: keys.press("ArrowRight"))[0] > since
    assert after(lambda: keys.press("Home"))[0] == 0
    assert after(lambda: keys.press("End"))[1] == _seconds(whole.split(" to ")[1])
    after(lambda: keys.press("0"))
    expect(extent).to_have_text(whole)
    chart.scroll_into_view_if_needed()
    box = chart.bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 60)
    keys.down("Control")
    after(lambda: page.mouse.wheel(0, -400))
    keys.up("Control")
    page.mouse.down()
    zoomed = after(lambda: page.mouse.move(box["x"] + box["width"] / 2 + 80, box["y"] + 60))
    page.mouse.up()
    assert 0 < zoomed[1] - zoomed[0] < until
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 60)
    expect(page.locator(".gantt .cursor text")).to_have_text(re.compile(r"^\d:\d\d:\d\d$"))
    page.get_by_role("button", name="Whole run").click()
    expect(extent).to_have_text(whole)


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
    expect(page.locator(".working [role=status]")).to_contain_text("of 800 runs")
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
    page.get_by_role("button", name="Show earlier ones").click()
    expect(page.locator(f'[data-id="{ids[0]}"]')).to_be_visible()
    shown = [item for (item,) in data(page, ".jobs li", "id")]
    assert shown[:11] == ids[::-1]
    assert len(shown) == len(set(shown))


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
