"""What the schema of a body refuses is refused: numbers are numbers, booleans booleans, texts texts."""

from __future__ import annotations

import json

import pytest

from api.certificates.questions import Question
from api.certificates.service import read_question
from station import InputError, load_scenario, parse_scenario
from tests.api.test_idempotency import SYSTEM

SCENARIO = {
    "name": "mine", "arrivals": {"kind": "uniform", "count": 2, "period_s": 60},
    "station": {"preset": "thesis-fit", "compressor": {"count": 2}}, "communication": True, "idle_period_s": 1,
    "disturbance": {"seed": 1, "shares": {"heat_exchange": 0}},
}  # fmt: skip
TRACE = {"name": "mine", "arrivals": {"kind": "trace", "vehicles": [{"time_s": 1, "start_pressure_bar": 90}]}}

BODIES = {
    "/v1/runs": {"scenario": SCENARIO, "controller": "logic", "replication": 1, "seed": 2},
    "/v1/comparisons": {"scenarios": [SCENARIO, "S1"], "controllers": ["logic"], "replications": 2, "seed": 3},
    "/v1/twins": {"scenario": TRACE, "speed": 10, "replication": 0, "seed": 0, "paused": True, "at_end": "stop"},
    "/v1/scenarios/resolve": SCENARIO,
    "/v1/certificates": {
        **SYSTEM, "constraint": {"kind": "graph", "edges": [["a", 1, 2], [2, 1, "a"]], "initial": ["a"]}, "lift": 0,
        "rate": 1, "shared": False, "alpha": [0.5],
    },
    "/v1/scenarios/trace": {"csv": "time_s,start_pressure_bar\n60,120\n"},
    "/v1/keys": {"name": "x", "scopes": ["read"]},
}  # fmt: skip


def _places(value, path=()):
    """Every number, boolean and text of a document, with its path."""
    if isinstance(value, dict | list):
        for key, item in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _places(item, (*path, key))
    else:
        yield path, value


def _with(body, path, value):
    changed = json.loads(json.dumps(body))
    place = changed
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    return changed


def _others(value):
    """Values of other JSON types that mean as much to a lenient reader."""
    if isinstance(value, bool):
        return [int(value), str(value).lower(), "yes", float(value)]
    if isinstance(value, str):
        return [1, True, [value]]
    return [value != 0, str(value), f" {value} ", f"{value}.0", [value]]


def _either(path, place):
    """A text may stand for an exact number there, and a node of a graph is either."""
    exact = path == "/v1/certificates" and (place[0] == "modes" or place == ("rate",))
    return exact or "edges" in place or "initial" in place


CASES = [
    (path, place, other)
    for path, body in BODIES.items()
    for place, value in _places(body)
    if not _either(path, place)
    for other in _others(value)
]

INTEGERS = {"count", "seed", "replication", "replications", "lift", "idle_period_s"}


def test_every_value_of_another_type_is_refused(http):
    assert len(CASES) > 150
    wrong = []
    for path, place, other in CASES:
        answer = http.post(path, json=_with(BODIES[path], place, other))
        if answer.status_code != 422:
            wrong.append((path, place, other, answer.status_code, answer.text[:80]))
    assert wrong == []


def test_an_integer_may_be_written_as_json_writes_one(http):
    for path, body in BODIES.items():
        whole = json.loads(json.dumps(body), parse_int=float)
        if path == "/v1/twins":
            whole["id"] = "whole"
        answer = http.post(path, json=whole)
        assert answer.status_code in {200, 201, 202}, (path, answer.text)
        halves = [place for place, _ in _places(body) if place[-1] in INTEGERS]
        for place in halves:
            assert http.post(path, json=_with(body, place, 1.5)).status_code == 422, (path, place)


@pytest.mark.parametrize("given", [True, "1", "true", 1.5, [1]])
def test_a_scenario_file_is_read_as_strictly(tmp_path, given):
    path = tmp_path / "mine.json"
    path.write_text(json.dumps({**SCENARIO, "idle_period_s": given}))
    with pytest.raises(InputError, match="idle_period_s: Input should be a valid integer"):
        load_scenario(path)
    path = tmp_path / "mine.toml"
    path.write_text(
        f'name = "mine"\nidle_period_s = {json.dumps(given)}\n[arrivals]\nkind = "uniform"\ncount = 2\nperiod_s = 60\n'
    )
    with pytest.raises(InputError, match="idle_period_s: Input should be a valid integer"):
        load_scenario(path)


def test_a_station_and_a_controller_are_read_as_strictly():
    for wrong in ({"compressor": {"count": True}}, {"buffers": {"low": {"volume_m3": "1"}}}):
        with pytest.raises(InputError, match="valid"):
            parse_scenario({**SCENARIO, "station": {"preset": "thesis-fit", **wrong}})


def test_controllers_options_keep_their_types(http):
    for wrong in ("minlp1:horizon=true", 'minlp1:horizon="2"', "minlp1:horizon=1.5", "minlp1:liveness=1"):
        assert http.post("/v1/runs", json={"scenario": "S1", "controller": wrong}).status_code == 422, wrong
    assert http.post("/v1/runs", json={"scenario": "S1", "controller": "minlp1:horizon=2.0"}).status_code == 202


def test_a_problem_file_keeps_the_digits_of_its_decimals(tmp_path):
    digits = "0.1234567890123456789012345678901234567890"
    path = tmp_path / "question.toml"
    modes = f"modes = [{{A = [[{digits}]], E = [[1.0]]}}]"
    constraint = '[constraint]\nkind = "dwell"\ntau = 2.0\n'
    path.write_text(f'ask = "reach"\npeak = 2.50\nalpha = [0.5]\n{modes}\n{constraint}')
    found = read_question(path)
    assert [[digits]] == found.modes[0].A
    assert (found.peak, found.alpha, found.constraint.tau) == ("2.50", [0.5], 2)
    path.write_text(path.read_text().replace("tau = 2.0", 'tau = "2"'))
    with pytest.raises(InputError, match="tau: Input should be a valid integer"):
        read_question(path)
    assert Question.model_validate(found.model_dump(mode="json")) == found
