"""The view of certificates: ask, read, verify; pictures that show what the document says."""

from __future__ import annotations

import json
import math
import tomllib
from pathlib import Path

import pytest
from playwright.sync_api import expect

from tests.api.conftest import ended
from tests.api.page.conftest import NARROW, WIDE, overflows, violations

ROOT = Path(__file__).parents[3]
EXAMPLES = ROOT / "docs" / "examples" / "theory"
REACH = tomllib.loads((EXAMPLES / "peak.toml").read_text())
UNSTABLE = {"ask": "stability", "constraint": {"kind": "arbitrary"}, "modes": [{"A": [[1.5]]}, {"A": [[0.5]]}]}


@pytest.fixture(scope="module")
def asked(http):
    """The answered example of a reachable set."""
    answer = http.post("/v1/certificates", json=REACH)
    assert answer.status_code == 202
    return ended(http, answer.headers["location"])


def test_the_examples_are_those_of_the_documentation():
    shown = json.loads((ROOT / "api/page/static/certificates/questions.json").read_text())
    assert shown.keys() == {path.stem for path in EXAMPLES.glob("*.toml")}
    for name, item in shown.items():
        assert item["question"] == tomllib.loads((EXAMPLES / f"{name}.toml").read_text())


@pytest.mark.slow
def test_a_question_is_asked_and_its_proof_verified_again(browse, http):
    page = browse("#/certificates")
    page.get_by_label("Begin with").select_option("dwell")
    page.get_by_role("button", name="Ask", exact=True).click()
    expect(page.locator(".statement .tag")).to_have_text("certified")
    name = page.url.rsplit("/", 1)[-1]
    answer = http.get(f"/v1/certificates/{name}").json()["answer"]
    expect(page.locator(".statement")).to_contain_text(answer["claim"])
    expect(page.locator("tr", has_text="smallest tau")).to_contain_text(str(answer["tau"]))
    expect(page.locator("tr", has_text="margin")).to_contain_text(f"{answer['document']['about']['margin']:.3g}")
    page.get_by_role("button", name="Verify again").click()
    expect(page.locator(".claim [role=status]")).to_contain_text("verified")
    proof = answer["document"]["proof"]  # each node's matrix is positive definite, and each edge's inequality holds
    count = proof["nodes"] + len(proof["edges"]) + len(proof["jumps"])
    expect(page.locator(".claim [role=status]")).to_contain_text(f"{count} inequalities hold")
    with page.expect_download() as download:
        page.get_by_role("button", name="Download the document").click()
    assert json.loads(Path(download.value.path()).read_text()) == answer["document"]


def test_graph_ellipsoids_and_tube_are_those_of_the_document(browse, asked):
    document = asked["answer"]["document"]
    page = browse(f"#/certificates/{asked['id']}")
    expect(page.locator(".graph .node")).to_have_count(document["proof"]["nodes"])
    pairs = {(edge[0], edge[-1]) for edge in document["proof"]["edges"]}
    expect(page.locator(".graph .edge")).to_have_count(len(pairs))
    expect(page.locator(".ellipsoid")).to_have_count(document["proof"]["nodes"])
    # Half the width of an ellipsoid is the root of an entry of the inverse matrix: of P11 P22 - P12^2 and P22.
    unit = document["proof"]["denominator"]
    halves = [math.sqrt(c * unit / (a * c - b * b)) for a, b, c in document["proof"]["matrices"]]
    boxes = [page.locator(".ellipsoid").nth(k).evaluate("e => e.getBBox().width") for k in range(len(halves))]
    assert boxes[0] / boxes[1] == pytest.approx(halves[0] / halves[1], rel=0.01)
    assert page.locator(".strip").count() == 40
    # The runs stay in the tube: the proof says so, and here it is seen.
    ends = "e => { const box = e.getBBox(); return [box.y, box.y + box.height]; }"
    top, bottom = page.locator("path.tube").evaluate(ends)
    runs = [run.evaluate(ends) for run in page.locator("path.inside").all()]
    assert len(runs) == 6
    assert all(top <= high < low <= bottom for high, low in runs)


def test_a_document_that_was_tampered_with_is_refused(browse, asked):
    document = asked["answer"]["document"]
    page = browse("#/certificates")
    place = page.get_by_label("Document", exact=True)
    place.fill(json.dumps(document))
    page.get_by_role("button", name="Verify", exact=True).click()
    expect(page.locator("form [role=status]")).to_contain_text("verified")
    place.fill(json.dumps(document | {"claim": document["claim"] | {"value": "0.9"}}))
    page.get_by_role("button", name="Verify", exact=True).click()
    expect(page.locator("form [role=status]")).to_contain_text("refused")
    place.fill("no JSON")
    page.get_by_role("button", name="Verify", exact=True).click()
    expect(page.locator("form .wrong", has_text="is no JSON document")).to_be_visible()


def test_wrong_questions_are_shown_and_not_asked(browse, http):
    page = browse("#/certificates", expected=("422",))
    expect(page.locator("main h1")).to_have_text("Certificates")
    before = http.get("/v1/certificates").json()["items"]
    page.get_by_label("Question", exact=True).fill(json.dumps(REACH | {"peak": -1}))
    page.get_by_role("button", name="Ask", exact=True).click()
    expect(page.locator(".wrong", has_text="peak")).to_be_visible()
    assert http.get("/v1/certificates").json()["items"] == before


def test_a_counterproof_names_its_word(browse, http):
    job = ended(http, http.post("/v1/certificates", json=UNSTABLE).headers["location"])
    page = browse(f"#/certificates/{job['id']}")
    expect(page.locator(".statement .tag")).to_have_text("not certified")
    expect(page.locator(".claim code")).to_have_text("1")


@pytest.mark.slow
def test_what_is_proved_of_a_controller(browse, http):
    page = browse("#/certificates")
    page.get_by_label("Controller", exact=True).select_option("minlp2")
    page.get_by_label("Station", exact=True).select_option("thesis-fit-a")
    page.get_by_label("Options", exact=True).fill("liveness=false")
    page.get_by_role("button", name="Show what is proved").click()
    expect(page.locator(".statement .tag")).to_have_text("not certified", timeout=240_000)
    asked = {"station": "thesis-fit-a", "options": "liveness=false"}
    found = http.get("/v1/controllers/minlp2/certificate", params=asked).json()
    expect(page.locator(".statement")).to_contain_text(found["claim"])
    expect(page.locator("h2", has_text="A state that starves")).to_be_visible()
    with page.expect_download() as download:
        page.get_by_role("button", name="Download the document").click()
    assert json.dumps(json.loads(download.value.path().read_text())) == json.dumps(found)  # to the last digit
    page.get_by_role("button", name="Verify again").click()
    expect(page.locator(".check p .tag")).to_have_text("verified", timeout=240_000)


@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("size", [WIDE, NARROW], ids=["wide", "narrow"])
def test_a_proof_is_readable_for_everybody(browse, asked, dark, size):
    page = browse(f"#/certificates/{asked['id']}", dark=dark, size=size)
    expect(page.locator("path.tube")).to_be_visible()
    assert not overflows(page)
    assert violations(page) == []


@pytest.mark.slow
def test_a_certificate_of_service_that_was_downloaded_passes_the_check_of_a_document(browse, tmp_path):
    """Its figures are compared to the last digit and by their kind, so they must reach the checker as they are."""
    page = browse("#/certificates/service/minlp2/thesis-fit-a/liveness%3Dfalse")
    with page.expect_download(timeout=240_000) as begun:
        page.get_by_role("button", name="Download").click(timeout=240_000)
    begun.value.save_as(tmp_path / "service.json")
    page.goto(page.url.split("#")[0] + "#/certificates")
    page.get_by_label("File").set_input_files(tmp_path / "service.json")
    page.get_by_role("button", name="Verify").click()
    said = page.locator("form", has=page.get_by_label("File")).locator("p[role=status]")
    expect(said.locator(".tag")).to_have_text("verified", timeout=120_000)
    expect(said).to_contain_text("not certified: ")
    page.get_by_label("Document").fill((tmp_path / "service.json").read_text().replace("minlp2", "minlp3", 1))
    page.get_by_role("button", name="Verify").click()
    expect(said.locator(".tag")).to_have_text("refused", timeout=120_000)
