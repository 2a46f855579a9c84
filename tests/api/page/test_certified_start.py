"""Starting a twin with a certificate from the page: what is known of it, what is refused, and the word on the twin."""

from __future__ import annotations

import json
import time

import pytest
from playwright.sync_api import expect

from tests.api.page.conftest import NARROW, WIDE, overflows, violations

# Small ones, so that no test waits for minutes: a vehicle of S1 starves under the first, the second is only tested.
STARVES = {"name": "minlp2", "station": "thesis-fit-a", "options": "liveness=false"}


def _choose(page, controller, station="", name=None):
    expect(page.get_by_role("button", name="Start the twin")).to_be_visible()
    page.locator(".start").get_by_label("Controller").fill(controller)
    page.get_by_label("Station", exact=True).select_option(station)
    if name:
        page.get_by_label("Name").fill(name)


CERTIFICATE = f"/v1/controllers/{STARVES['name']}/certificate"
SUBJECT = {"station": STARVES["station"], "options": STARVES["options"]}


def _state(http):
    return http.get(f"{CERTIFICATE}/state", params=SUBJECT).json()


@pytest.mark.slow
def test_what_is_known_of_a_certificate_is_said_and_asking_begins_nothing(browse, http):
    page = browse("#/live")
    _choose(page, "minlp2:liveness=false", "thesis-fit-a")
    known = page.locator(".certificate .known")
    expect(known).to_contain_text("No certificate of minlp2:liveness=false at thesis-fit-a has been made")
    assert _state(http) == {"state": "none", "verdict": None, "claim": None}
    page.get_by_role("button", name="Have it made").click()
    expect(known.locator(".tag")).to_have_text("not certified", timeout=240_000)
    found = _state(http)
    assert found["state"] == "made"
    expect(known).to_contain_text(found["claim"])
    expect(known).to_contain_text("A twin that is started with it is refused.")
    page.locator(".start").get_by_label("Controller").fill("remote")
    expect(known).to_contain_text('Nothing is proved of "remote"')
    page.locator(".start").get_by_label("Controller").fill("logic")
    expect(known).to_contain_text("No certificate of logic at thesis-fit-a has been made")
    _choose(page, "minlp2:liveness=false", "thesis-fit-a")
    expect(known.locator(".tag")).to_have_text("not certified")
    known.get_by_role("link", name="What is proved").click()
    expect(page.locator("h1")).to_have_text("Service of minlp2:liveness=false")
    expect(page.locator(".statement .tag")).to_have_text("not certified")


@pytest.mark.slow
def test_what_certifies_nothing_is_refused_unless_the_user_allows_it(browse, http):
    page = browse("#/live", expected=("422",))
    _choose(page, "minlp2:liveness=false", "thesis-fit-a", "allowed")
    choice = page.get_by_label("Certificate of service")
    choice.select_option("own")
    page.get_by_role("button", name="Start the twin").click()
    wrong = page.locator('.certificate [name="certificate"] ~ .wrong')
    expect(wrong).to_have_text("must be 'certified'; given 'not certified'", timeout=240_000)
    assert http.get("/v1/twins/allowed").status_code == 404
    page.get_by_label("if it is refused, start uncertified all the same").check()
    page.get_by_role("button", name="Start the twin").click()
    expect(page.locator("h1")).to_have_text("allowed")
    expect(page.locator(".twin-head .service")).to_have_text("uncertified")
    expect(page.locator(".events .started .details")).to_contain_text("uncertified")
    assert http.get("/v1/twins/allowed").json()["service"] == "uncertified"
    http.post("/v1/twins/allowed/stop")


@pytest.mark.slow
def test_a_certificate_of_another_station_is_refused(browse, http, proved, tmp_path):
    """From a file: the generous station's, for a twin at thesis-fit."""
    file = tmp_path / "generous.json"
    file.write_text(json.dumps(proved))
    page = browse("#/live", expected=("422",))
    _choose(page, "reserve", name="elsewhere")
    page.get_by_label("Certificate of service").select_option("file")
    page.get_by_role("button", name="Start the twin").click()
    expect(page.locator('[name="certificate_file"] ~ .wrong')).to_have_text("choose one, or start without")
    page.get_by_label("File").set_input_files(str(file))
    page.get_by_role("button", name="Start the twin").click()
    wrong = page.locator('.certificate [name="certificate"] ~ .wrong')
    expect(wrong).to_have_text("the certificate belongs to a station with other parameters")
    file.write_text("no document")
    page.get_by_label("File").set_input_files(str(file))
    page.get_by_role("button", name="Start the twin").click()
    expect(page.locator('[name="certificate_file"] ~ .wrong')).to_contain_text("is no JSON document")
    assert http.get("/v1/twins/elsewhere").status_code == 404


@pytest.mark.slow
def test_a_certified_twin_says_so_until_another_controller_sits_in_it(browse, http, proved):
    """The certificate holds: its twin is started over HTTP, for no preset's takes less than a minute."""
    scenario = {**http.get("/v1/scenarios/S1").json(), "station": proved["station"]["parameters"]}
    asked = {"id": "proved", "scenario": scenario, "controller": "reserve", "certificate": proved, "speed": 10}
    answer = http.post("/v1/twins", json=asked, timeout=240)
    assert answer.status_code == 201, answer.text
    page = browse("#/live/proved")
    tag = page.locator(".twin-head .service")
    expect(tag).to_have_text("certified")
    page.get_by_label("Controller", exact=True).fill("logic")
    page.get_by_role("button", name="Seat").click()
    expect(tag).to_have_text("uncertified")
    expect(page.locator(".events .controller_changed .details")).to_have_text("logic · uncertified")
    http.post("/v1/twins/proved/stop")


@pytest.mark.slow
def test_a_file_is_sent_to_the_last_digit(browse, http, proved, tmp_path):
    """0.0 must not become 0 on the way: the certificate would be refused for it."""
    file = tmp_path / "generous.json"
    file.write_text(json.dumps(proved, indent=1))
    page = browse("#/live", expected=("422",))
    _choose(page, "reserve", name="exact")
    page.get_by_label("Certificate of service").select_option("file")
    page.get_by_label("File").set_input_files(str(file))
    with page.expect_request(lambda request: request.method == "POST") as sent:
        page.get_by_role("button", name="Start the twin").click()
    body = json.loads(sent.value.post_data)
    assert json.dumps(body["certificate"]) == json.dumps(proved)
    assert "0.0," in file.read_text()
    assert (body["id"], body["controller"], body["allow_uncertified"]) == ("exact", "reserve", False)
    expect(page.locator('.certificate [name="certificate"] ~ .wrong')).to_contain_text("belongs to a station")


def test_what_the_telemetry_says_counts(browse, http):
    """A sample that says another word than the state is believed, and the state asked for again."""
    http.post("/v1/twins", json={"id": "told", "scenario": "S1", "speed": 10, "at_end": "repeat"})
    page = browse()
    state = http.get("/v1/twins/told").json()
    answers = iter([{**state, "service": "certified"}])

    def first(route):
        wrong = next(answers, None)
        route.fulfill(json=wrong) if wrong else route.continue_()

    page.route("**/v1/twins/told", first)
    page.goto(f"{page.url.split('#')[0]}#/live/told")
    expect(page.locator(".twin-head .service")).to_have_text("uncertified")
    http.post("/v1/twins/told/stop")


@pytest.mark.slow
@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("size", [WIDE, NARROW], ids=["wide", "narrow"])
def test_the_choice_is_readable_for_everybody(browse, http, dark, size):
    until = time.monotonic() + 240
    while http.post(CERTIFICATE, params=SUBJECT).json()["state"] != "made":
        assert time.monotonic() < until
        time.sleep(0.5)
    page = browse("#/live", dark=dark, size=size)
    _choose(page, "minlp2:liveness=false", "thesis-fit-a")
    page.get_by_label("Certificate of service").select_option("file")
    expect(page.locator(".certificate .known .tag")).to_have_text("not certified")
    assert not overflows(page)
    assert violations(page) == []
