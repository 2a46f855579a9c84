"""Certificates as a user gets them: from the command line, and over REST as jobs."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import pytest

from tests.api.conftest import RunningService, ended
from tests.api.test_cli import hrs
from theory import verify

PROBLEMS = sorted((Path(__file__).parents[2] / "docs" / "examples" / "theory").glob("*.toml"))

OSCILLATOR = {"A": [[0, 1], ["-0.8", 0]], "vary": [{"A": [[0, 0], [0, "0.5"]]}]}
SLOW = {"low": -1, "high": 1, "rate": "0.02"}
MEASURED = {"A": [["1.1"]], "B": [[1]], "C": [[1]], "E": [[1, 0]], "M": [[1]], "N": [[0, "0.1"]]}


def problem(name):
    """A problem of the documentation as a request body; decimals as texts, so that they stay decimals."""
    path = next(path for path in PROBLEMS if path.stem == name)
    return tomllib.loads(path.read_text(), parse_float=str)


@pytest.mark.parametrize("path", PROBLEMS, ids=lambda path: path.stem)
def test_a_problem_is_certified_and_the_certificate_verified(tmp_path, path):
    done = hrs("certify", path, "--out", tmp_path / "cert.json")
    assert done.returncode == 0, done.stderr
    for word in ("certified: for every ", "margin", "time"):
        assert word in done.stdout
    checked = hrs("verify", tmp_path / "cert.json")
    assert checked.returncode == 0
    assert checked.stdout.startswith("verified: for every ")


def test_what_is_not_certified_says_why_and_writes_the_counterproof(tmp_path):
    path = next(path for path in PROBLEMS if path.stem == "arbitrary")
    done = hrs("certify", path, "--ask", "stability", "--lift", "1", "--out", tmp_path / "against.json")
    assert done.returncode == 1
    assert done.stdout.startswith("NOT certified")
    assert "no quadratic functions" in hrs("verify", tmp_path / "against.json").stdout


def test_a_rate_from_both_sides_and_the_limits_of_a_check(tmp_path):
    (tmp_path / "pair.toml").write_text(
        "ask = 'decay-rate'\n[constraint]\nkind = 'arbitrary'\n"
        "[[modes]]\nA = [[1, 0], [1, 0]]\n[[modes]]\nA = [[0, 1], [0, -1]]\n"
    )
    done = hrs("certify", tmp_path / "pair.toml", "--gap", "1e-4", "--budget", "5", "--out", tmp_path / "cert.json")
    assert "at least      1, " in done.stdout
    assert json.loads((tmp_path / "cert.json").read_text())["about"]["lift"] == 1
    large = tmp_path / "large.json"
    large.write_text(json.dumps({"format": "hrs-certificate", "filling": "x" * 100_000}))
    done = hrs("verify", large, "--memory-limit", "1")
    assert done.returncode == 2
    assert "--memory-limit is 1 MB" in done.stderr


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"ask": "mean-square"}, "chain: a mean square needs"),
        ({"chain": [["1"]]}, "chain: is for the mean square alone"),
        ({"ask": "mean-square", "chain": [["0.5"]]}, "sum up to 1"),
        (
            {"ask": "mean-square", "chain": [["1"]], "constraint": {"kind": "dwell", "tau": 2}},
            "constraint: is arbitrary",
        ),
        ({"modes": [OSCILLATOR]}, "vary: is by the value of parameters, and there are none"),
        ({"modes": [OSCILLATOR], "parameters": [SLOW], "ask": "reach"}, "parameters: are for stability"),
        ({"modes": [OSCILLATOR], "parameters": [{**SLOW, "low": 1}]}, "has to be below high"),
        ({"modes": [OSCILLATOR], "parameters": [SLOW, SLOW]}, "vary: of mode 1 has 1 tables"),
        ({"modes": [OSCILLATOR], "parameters": [SLOW], "period": "0.1"}, "parameters: are for stability"),
        ({"period": "0"}, "period: 0 is not positive"),
        ({"modes": [{"A": [["-400"]]}], "period": "0.1"}, "the exponent has the norm 40, the limit is 30"),
        ({"modes": [MEASURED], "ask": "minimize-reach"}, "M: minimize-reach finds gains of the whole state"),
        ({"modes": [MEASURED], "ask": "stabilize", "symmetric": True}, "symmetric: is for gains of the whole state"),
        ({"modes": [MEASURED], "gains": [{"mode": 1, "clock": 0}]}, "needs either K, or A, B and C"),
    ],
)
def test_what_does_not_belong_together_is_refused(change, says):
    from api.certificates import service
    from station import InputError

    asked = {"ask": "stability", "modes": [{"A": [["0.5"]]}], "constraint": {"kind": "arbitrary"}, **change}
    with pytest.raises(InputError, match=says):
        service.check(service.question_of(asked, "question"))


@pytest.mark.parametrize(("rate", "certified"), [("0.02", True), (None, False)])
def test_a_plant_with_parameters_is_asked_about(rate, certified):
    from api.certificates import service

    slow = {name: value for name, value in {**SLOW, "rate": rate}.items() if value is not None}
    asked = {"ask": "stability", "modes": [OSCILLATOR], "constraint": {"kind": "arbitrary"}, "parameters": [slow]}
    answer = service.answer(service.question_of(asked, "question"))
    assert answer.certified == certified
    assert ("parameters within bounds and rates" in answer.claim) == certified


def test_a_given_controller_is_asked_about():
    """Its D, left out, is zero, and the loop unstable."""
    from api.certificates import service

    own = {"mode": 1, "clock": 0, "A": [["0.1"]], "B": [["0.4"]], "C": [["-0.1"]]}
    asked = {"ask": "gain", "lift": 0, "clock": 0, "constraint": {"kind": "arbitrary"}, "modes": [MEASURED]}
    assert not service.answer(service.question_of({**asked, "gains": [own]}, "question")).certified
    answer = service.answer(service.question_of({**asked, "gains": [{**own, "D": [["-0.4"]]}]}, "question"))
    assert answer.certified
    assert verify(answer.document).claim == answer.claim


def test_a_changed_certificate_does_not_verify(tmp_path):
    path = next(path for path in PROBLEMS if path.stem == "dwell")
    hrs("certify", path, "--out", tmp_path / "cert.json")
    document = json.loads((tmp_path / "cert.json").read_text())
    document["problem"]["constraint"]["tau"] = 4
    from theory.checker import checksum

    (tmp_path / "cert.json").write_text(json.dumps({**document, "checksum": checksum(document)}))
    done = hrs("verify", tmp_path / "cert.json")
    assert done.returncode == 1
    assert "refused: uncovered word" in done.stdout


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("ask = 'stability'", "modes"),
        ("ask = 'magic'\n[constraint]\nkind='arbitrary'\n[[modes]]\nA=[[1]]", "ask"),
        ("ask = 'stability'\n[constraint]\nkind='dwell'\ntau=0\n[[modes]]\nA=[[1]]", "greater than or equal to 1"),
        ("ask = 'stability'\n[constraint]\nkind='dwell'\n[[modes]]\nA=[[1]]", "tau"),
        ("ask = 'stability'\n[constraint]\nkind='asynchronous'\ntau=2\ndelay=2\n[[modes]]\nA=[[1]]", "delay"),
        ("ask = 'stability'\n[constraint]\nkind='arbitrary'\n[[modes]]\nA=[[1, 2]]", "A of mode 1"),
        ("ask = 'gain'\n[constraint]\nkind='arbitrary'\n[[modes]]\nA=[['0.5']]", "C: an l2 gain needs"),
        (
            "ask = 'stability'\nlift = 40\n[constraint]\nkind='arbitrary'\n[[modes]]\nA=[[0]]\n[[modes]]\nA=[[0]]",
            "an estimated",
        ),
        ("ask = 'stability'\n[constraint]\nkind='graph'\nedges=[['a', 1, 'b']]\n[[modes]]\nA=[[0]]", "dead end"),
        ("ask = ", "Invalid value"),
    ],
)
def test_wrong_problems_name_field_and_limit(tmp_path, text, says):
    (tmp_path / "bad.toml").write_text(text)
    done = hrs("certify", "bad.toml", "--out", "cert.json", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith("error: ")
    assert says in done.stderr
    assert not (tmp_path / "cert.json").exists()


@pytest.mark.parametrize("text", ["", "[]", "3", '{"format": "hrs-certificate"}', "[" * 100_000])
def test_what_is_no_certificate_is_refused(tmp_path, text):
    (tmp_path / "x.json").write_text(text)
    done = hrs("verify", tmp_path / "x.json")
    assert done.returncode == 1
    assert done.stdout.startswith("refused")
    assert "Traceback" not in done.stderr


def test_a_question_over_rest_is_a_job(http):
    answer = http.post("/v1/certificates", json=problem("asynchronous"))
    assert answer.status_code == 202
    job = ended(http, answer.headers["location"])
    assert job["state"] == "succeeded"
    assert job["answer"]["certified"]
    assert job["answer"]["value"] < 5.56 < job["answer"]["bound"]
    document = http.get(f"{answer.headers['location']}/document").json()
    assert document == job["answer"]["document"]
    assert f"{job['answer']['value']:.6f}" in verify(document).claim
    assert http.post("/v1/certificates/verify", json=document).json()["verified"]
    document["claim"]["value"] = "0.1"
    refused = http.post("/v1/certificates/verify", json=document).json()
    assert not refused["verified"]
    page = http.get("/v1/certificates").json()
    assert page["items"][0]["id"] == job["id"]
    assert page["items"][0]["answer"]["document"] is None
    assert http.delete(f"/v1/certificates/{job['id']}").status_code == 204
    assert http.get(f"/v1/certificates/{job['id']}").status_code == 404


def test_a_question_that_cannot_be_answered_yes_succeeds_without_a_claim(http):
    answer = http.post("/v1/certificates", json={**problem("arbitrary"), "ask": "stability", "lift": 0})
    job = ended(http, answer.headers["location"])
    assert job["state"] == "succeeded"
    assert not job["answer"]["certified"]
    assert job["answer"]["value"] is None
    assert job["answer"]["document"]["claim"]["kind"] == "infeasible"


@pytest.mark.parametrize(
    ("change", "field", "says"),
    [
        ({"ask": "wisdom"}, "ask", "Input should be"),
        ({"constraint": {"kind": "dwell", "tau": 0}}, "constraint.dwell.tau", "greater than or equal to 1"),
        ({"constraint": {"kind": "asynchronous", "tau": 2, "delay": 2}}, "delay", "not below tau"),
        ({"modes": [{"A": [["1", "2"]]}]}, "A of mode 1", "has to be"),
        ({"ask": "gain"}, "C", "needs this matrix"),
        ({"lift": 50}, "", "an estimated"),
        ({"surprise": 1}, "surprise", "Extra inputs"),
    ],
)
def test_wrong_questions_are_refused_at_once(http, change, field, says):
    answer = http.post("/v1/certificates", json={**problem("arbitrary"), **change})
    assert answer.status_code == 422, answer.text
    errors = answer.json()["errors"]
    assert any(error["field"] == field and says in error["message"] for error in errors), errors


@pytest.mark.slow
def test_a_certificate_survives_kill_9(tmp_path):
    """Submitted, killed, restarted: answered once."""
    service = RunningService(tmp_path)
    try:
        import httpx

        slow = {**problem("peak"), "lift": 3}
        with httpx.Client(base_url=service.url, trust_env=False, timeout=30) as client:
            place = client.post("/v1/certificates", json=slow).headers["location"]
            service.kill()
            service.start()
            job = ended(client, place)
        assert job["state"] == "succeeded"
        assert verify(job["answer"]["document"]).inequalities > 0
    finally:
        service.stop()
