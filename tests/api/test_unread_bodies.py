"""A body that an operation does not read is refused: whoever sends one would believe that it counts."""

from __future__ import annotations

import pytest

from tests.api.test_half_characters import PLAIN

WORKERS = 0
JSON = {"content-type": "application/json"}
FILLED = {"name": "S1", "run_id": "run-x", "comparison_id": "comparison-x", "forecast_id": "forecast-x",
          "certificate_id": "certificate-x", "calibration_id": "calibration-x", "twin_id": "none",
          "note_id": "note-x", "number": "0"}  # fmt: skip


@pytest.fixture(scope="module")
def unread(http):
    """Every operation below /v1 whose description has no body."""
    paths = http.get("/openapi.json").json()["paths"]
    found = [
        (method.upper(), path.format(**FILLED))
        for path, methods in paths.items()
        for method, operation in methods.items()
        if path.startswith("/v1") and "requestBody" not in operation
    ]
    assert len(found) > 30
    assert ("POST", "/v1/twins/none/stop") in found
    return found


@pytest.mark.parametrize("content", [b'{"station": "light-duty-700"}', b'{"foo": 1}', b"[]", b"null", b"{", b" " * 70])
def test_a_body_that_is_not_read_is_refused(http, unread, content):
    taken = []
    for method, path in unread:
        answer = http.request(method, path, content=content, headers=JSON)
        told = [error["message"] for error in answer.json().get("errors", [])]
        if answer.status_code != 422 or not told or not told[0].startswith("this request takes no body"):
            taken.append((method, path, answer.status_code, told))
    assert taken == []


def test_a_body_in_pieces_is_none_the_less(http):
    answer = http.post("/v1/controllers/logic/certificate", content=iter([b"[", b"]"]), headers=JSON)
    assert answer.status_code == 422


def test_the_parameters_are_named(http):
    answer = http.post("/v1/controllers/thesis-fit/certificate", json={"station": "light-duty-700"})
    (error,) = answer.json()["errors"]
    assert error["message"] == "this request takes no body; parameters of its query are station, options, of"


@pytest.mark.parametrize("content", [None, b"", b"{}", b" { }\n", iter([])])
def test_nothing_is_no_body(http, content):
    assert http.post("/v1/twins", json={"id": "ends", "scenario": PLAIN, "paused": True}).status_code == 201
    assert http.post("/v1/twins/ends/stop", content=content, headers=JSON).status_code == 200
    assert http.request("DELETE", "/v1/twins/ends", content=content, headers=JSON).status_code == 204
