"""The figures of a window as files, a report, a command and in the client; and notes, beside them."""

from __future__ import annotations

import csv
import io
import json

import httpx
import pytest

from api.client import Service
from api.client.series import Series
from api.comparisons.gantt import clock
from api.twins.figure_schemas import UNITS
from api.twins.window_tally import WINDOW_UNITS
from tests.api.conftest import RunningService
from tests.api.here import hrs
from tests.waiting import wait_until

WORKERS = 0
GAS = {
    "name": "gas",
    "station": {"preset": "h70-light"},
    "arrivals": {"kind": "uniform", "count": 3, "period_s": 300.0},
}


@pytest.fixture(scope="module")
def twin(http):
    """Path of a twin of a station with real gas that has run to its end."""
    order = {"id": "gas", "scenario": GAS, "controller": "logic", "speed": "max", "at_end": "stop"}
    assert http.post("/v1/twins", json=order).status_code == 201
    wait_until(lambda: http.get("/v1/twins/gas").json()["state"] == "finished")
    return "/v1/twins/gas"


def test_every_format_has_the_same_figures(http, twin):
    query = {"from_s": 60, "to_s": 660, "by": "hour"}
    answer = http.get(f"{twin}/figures", params=query)
    assert answer.status_code == 200, answer.text
    found = answer.json()
    assert (found["twin"], found["by"], found["units"]) == ("gas", "hour", UNITS)
    (item,) = found["items"]
    assert item["delivered_kg"] > 1
    assert item["total_eur"] == pytest.approx(item["energy_eur"] + item["demand_eur"] + item["stock_eur"], rel=1e-12)
    text = http.get(f"{twin}/figures", params={**query, "format": "csv"})
    assert text.headers["content-type"] == "text/csv; charset=utf-8"
    (row,) = csv.DictReader(io.StringIO(text.text))
    table = Series(http.get(f"{twin}/figures", params={**query, "format": "parquet"}).content)
    assert table.units == WINDOW_UNITS
    assert list(row) == list(WINDOW_UNITS)
    for name in UNITS:
        wanted = None if item[name] is None else float(item[name])
        assert (float(row[name]) if row[name] else None) == wanted, name
        figure = float(table[name][0])
        assert (None if figure != figure else figure) == wanted, name
    assert float(row["refused_gap"]) == item["refused"]["gap"]


def test_what_is_asked_for_wrongly_is_named_with_its_limit(http, twin):
    for query, field, part in (
        ({"from_s": -1}, "from_s", "greater than or equal to 0"),
        ({"from_s": 1.5}, "from_s", "integer"),
        ({"to_s": 10**9}, "to_s", "must be at most"),
        ({"from_s": 100, "to_s": 100}, "to_s", "must lie behind from_s = 100 s"),
        ({"by": "week"}, "by", "window"),
        ({"by": "shift", "shift_h": 0}, "shift_h", "greater than or equal to 1"),
        ({"format": "xml"}, "format", "json"),
        ({"form_s": 1}, "form_s", "from_s"),
    ):
        for what in ("figures", "report"):
            if what == "report" and field == "format":
                continue
            answer = http.get(f"{twin}/{what}", params=query)
            assert answer.status_code == 422, (query, answer.text)
            (error,) = answer.json()["errors"]
            assert error["field"] == field
            assert part in error["message"], error
    for what in ("figures", "report", "notes"):
        assert http.get(f"/v1/twins/nobody/{what}").status_code == 404


def test_a_twin_that_has_told_nothing_has_no_figures(http):
    http.post("/v1/twins", json={"id": "new", "scenario": "S1", "paused": True})
    answer = http.get("/v1/twins/new/figures")
    assert (answer.status_code, answer.json()["errors"][0]["field"]) == (422, "to_s")
    http.post("/v1/twins/new/stop")


@pytest.mark.slow
def test_a_report_is_one_page_that_needs_nothing_else(http, twin):
    text = "<script>alert(1)</script> & valve replaced"
    note = http.post(f"{twin}/notes", json={"time_s": 100, "to_s": 200, "text": text})
    assert note.status_code == 201, note.text
    answer = http.get(f"{twin}/report", params={"from_s": 0, "to_s": 900, "by": "hour"})
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == "text/html; charset=utf-8"
    assert answer.headers["content-security-policy"].startswith("default-src 'none'")
    page = answer.text
    assert "@page { size: A4" in page
    assert page.count("<svg") == 1
    assert "<script" not in page
    assert "&lt;script&gt;alert(1)&lt;/script&gt; &amp; valve replaced" in page
    assert "http" not in page.split("</style>")[0]
    (item,) = http.get(f"{twin}/figures", params={"from_s": 0, "to_s": 900}).json()["items"]
    said = page.replace("\N{NARROW NO-BREAK SPACE}", " ")
    assert f"<dd>{item['delivered_kg']:.1f} kg</dd>" in said
    assert f"<dd>{item['total_eur']:.2f} EUR</dd>" in said
    assert "<h2>By" not in page, "one window is no table"
    http.delete(f"{twin}/notes/{note.json()['id']}")


def test_shifts_are_those_of_the_station_unless_others_are_asked_for(http):
    station = {"preset": "thesis-fit", "shifts": {"shift_h": 2, "first_h": 1}}
    arrivals = {"kind": "uniform", "count": 2, "period_s": 300.0}
    scenario = {"name": "shifts", "station": station, "arrivals": arrivals, "time_limit_s": 8000, "idle_period_s": 1}
    order = {"id": "shifts", "scenario": scenario, "controller": "logic", "speed": "max", "at_end": "idle"}
    assert http.post("/v1/twins", json=order).status_code == 201
    path, cut = "/v1/twins/shifts", {"to_s": 7600, "by": "shift"}
    wait_until(lambda: http.get(path).json()["samples"] > 7700)
    http.patch(path, json={"paused": True})
    own = http.get(f"{path}/figures", params=cut).json()
    assert (own["shift_h"], [each["from_s"] for each in own["items"]]) == (2, [0, 3600])
    other = http.get(f"{path}/figures", params={**cut, "shift_h": 1}).json()
    assert (other["shift_h"], [each["from_s"] for each in other["items"]]) == (1, [0, 3600, 7200])
    page = http.get(f"{path}/report", params={"to_s": 7600}).text
    assert "<h2>By shift of 2 h</h2>" in page
    assert clock(3600) in page
    http.post(f"{path}/stop")
    http.delete(path)


@pytest.mark.slow
def test_the_command_and_the_client_tell_the_same(service, http, twin, tmp_path):
    items = http.get(f"{twin}/figures", params={"by": "shift", "shift_h": 1}).json()["items"]
    with Service(url=service.url) as client:
        found = client.twin("gas")
        assert found.figures(by="shift", shift_h=1) == items
        assert found.figures(from_s=10, to_s=20)[0]["whole_s"] == 10
        assert "<svg" in found.report(to_s=300)
        note = found.note("looked at", 12.5)
        assert [each["id"] for each in found.notes()] == [note["id"]]
        found.delete_note(note["id"])
        assert found.notes() == []
    done = hrs(
        "figures",
        "gas",
        "--by",
        "shift",
        "--shift",
        1,
        "--out",
        "f.json",
        "--html",
        "r.html",
        cwd=tmp_path,
        HRS_URL=service.url,
    )
    assert done.returncode == 0, done.stderr
    assert f"{items[0]['delivered_kg']:.1f}" in done.stdout
    assert "EUR/kg" in done.stdout
    assert json.loads((tmp_path / "f.json").read_text())["items"] == items
    assert "<svg" in (tmp_path / "r.html").read_text()
    hrs("figures", "gas", "--from", 5, "--to", 65, "--out", "f.csv", cwd=tmp_path, HRS_URL=service.url)
    assert (tmp_path / "f.csv").read_text().splitlines()[1].startswith("5,65,")
    wrong = hrs("figures", "gas", "--out", "f.txt", cwd=tmp_path, HRS_URL=service.url)
    assert (wrong.returncode, "must end in .csv or .parquet or .json" in wrong.stderr) == (2, True)
    late = hrs("figures", "gas", "--to", 10**8, HRS_URL=service.url)
    assert (late.returncode, "to_s: must be at most" in late.stderr) == (2, True)


def test_notes_are_written_listed_and_forgotten(http, twin):
    given = {"time_s": 900.5, "text": "Kompressor gewartet \N{SNOWMAN}"}
    answer = http.post(f"{twin}/notes", json=given)
    assert answer.status_code == 201
    note = answer.json()
    assert answer.headers["location"] == f"{twin}/notes/{note['id']}"
    assert {name: note[name] for name in (*given, "to_s", "by")} == {**given, "to_s": None, "by": "local"}
    other = http.post(f"{twin}/notes", json={"time_s": 10, "to_s": 50, "text": "earlier"}).json()
    listed = http.get(f"{twin}/notes").json()
    assert (listed["twin"], listed["items"]) == ("gas", [other, note])
    for query, expected in (
        ({"from_s": 50}, [other, note]), ({"from_s": 50.5}, [note]), ({"to_s": 9}, []), ({"to_s": 10}, [other]),
        ({"from_s": 20, "to_s": 30}, [other]),
    ):  # fmt: skip
        assert http.get(f"{twin}/notes", params=query).json()["items"] == expected, query
    headers = {"Idempotency-Key": "once"}
    first, again = (http.post(f"{twin}/notes", json=given, headers=headers) for _ in range(2))
    assert first.json() == again.json()
    for each in (note, other, first.json()):
        assert http.delete(f"{twin}/notes/{each['id']}").status_code == 204
        assert http.delete(f"{twin}/notes/{each['id']}").status_code == 404
    assert http.get(f"{twin}/notes").json()["items"] == []


@pytest.mark.parametrize(
    ("given", "field"),
    [
        ({"time_s": -1, "text": "x"}, "time_s"),
        ({"time_s": 1e13, "text": "x"}, "time_s"),
        ({"time_s": "1", "text": "x"}, "time_s"),
        ({"time_s": 5, "to_s": 4, "text": "x"}, ""),
        ({"time_s": 5, "text": ""}, "text"),
        ({"time_s": 5, "text": "   "}, "text"),
        ({"time_s": 5, "text": "a\x00b"}, "text"),
        ({"time_s": 5, "text": "a\nb"}, "text"),
        ({"time_s": 5, "text": "x" * 501}, "text"),
        ({"time_s": 5, "text": "x", "by": "me"}, "by"),
        ({"text": "x"}, "time_s"),
    ],
)
def test_a_note_that_is_none_is_refused(http, twin, given, field):
    answer = http.post(f"{twin}/notes", json=given)
    assert answer.status_code == 422, answer.text
    assert [error["field"] for error in answer.json()["errors"]] == [field]
    assert http.get(f"{twin}/notes").json()["items"] == []


@pytest.mark.slow
def test_a_note_has_the_name_of_its_key_and_goes_with_its_twin(tmp_path):
    keys = {
        scope: hrs("keys", "create", f"the {scope}", "--scope", scope, "--data", tmp_path).stdout.strip()
        for scope in ("read", "operate")
    }
    running = RunningService(tmp_path, "--host", "0.0.0.0", "--workers", "0")  # noqa: S104  # what needs the keys
    try:
        http = {
            scope: httpx.Client(
                base_url=running.url, headers={"Authorization": f"Bearer {key}"}, trust_env=False, timeout=30
            )
            for scope, key in keys.items()
        }
        order = {"id": "t", "scenario": "S1", "paused": True}
        assert http["operate"].post("/v1/twins", json=order).status_code == 201
        given = {"time_s": 1, "text": "mine"}
        assert http["read"].post("/v1/twins/t/notes", json=given).status_code == 403
        note = http["operate"].post("/v1/twins/t/notes", json=given).json()
        assert note["by"] == "the operate"
        running.kill()
        running.start()
        assert http["read"].get("/v1/twins/t/notes").json()["items"] == [note]
        assert http["read"].delete(f"/v1/twins/t/notes/{note['id']}").status_code == 403
        http["operate"].post("/v1/twins/t/stop")
        assert http["operate"].delete("/v1/twins/t").status_code == 204
        http["operate"].post("/v1/twins", json=order)
        assert http["read"].get("/v1/twins/t/notes").json()["items"] == []
    finally:
        for each in http.values():
            each.close()
        running.stop()
