"""Measurements over zenoh, from sessions in other processes: stored once they are answered, whatever the payload."""

from __future__ import annotations

import json
import random
import subprocess
import sys

import pytest
import zenoh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from api.telemetry.session import connect
from tests.api.measured import TAGS, batches, followed, rows
from tests.api.test_measurements import WRITTEN, _rows
from tests.waiting import wait_until

WORKERS = 0

SENDER = """
import json, sys, zenoh
endpoint, key, sequence = sys.argv[1:]
config = {"mode": "client", "connect": {"endpoints": [endpoint]}, "scouting": {"multicast": {"enabled": False}}}
with zenoh.open(zenoh.Config.from_json5(json.dumps(config))) as session:
    selector = f"{key}?source=gateway-1;sequence={sequence}"
    for reply in session.get(selector, payload=sys.stdin.buffer.read(), encoding="application/json", timeout=10):
        print((reply.ok or reply.err).payload.to_string())
"""


@pytest.fixture(scope="module")
def session(service):
    with connect(service.zenoh) as opened:
        yield opened


@pytest.fixture
def twin(measured_twin):
    """The id of a measured twin that nobody has used."""
    return measured_twin


def _ask(session, twin, parameters="", **more):
    (reply,) = session.get(f"hrs/v1/{twin}/measurement{parameters}", timeout=20, **more)
    return json.loads((reply.ok or reply.err).payload.to_bytes())


def _send(session, twin, sequence, payload, media="application/json", source="plc"):
    """Send a payload, again as long as the twin is behind, as whoever sends must."""
    answers = []

    def sent():
        parameters = f"?source={source};sequence={sequence}"
        answers.append(_ask(session, twin, parameters, payload=payload, encoding=media))
        return answers[-1].get("status") != 503

    wait_until(sent)
    return answers[-1]


def test_another_process_sends_over_zenoh_and_again_over_rest(service, http, session, twin):
    sent = [json.dumps(rows(batch)).encode() for batch in batches(2)]
    for n, payload in enumerate(sent):
        command = [sys.executable, "-c", SENDER, service.zenoh, f"hrs/v1/{twin}/measurement", str(n)]
        done = subprocess.run(command, input=payload, capture_output=True, check=True, timeout=60)
        assert json.loads(done.stdout) == {"number": n + 1, "samples": 17, "repeated": False}
    again = http.post(
        f"/v1/twins/{twin}/measurements", params={"source": "gateway-1", "sequence": 1}, content=sent[1],
        headers={"content-type": "application/json"},
    )  # fmt: skip
    assert (again.status_code, again.json()) == (200, {"number": 2, "samples": 17, "repeated": True})
    wanted = {"sources": [{"source": "gateway-1", "sequence": 1}]}
    assert _ask(session, twin) == http.get(f"/v1/twins/{twin}/measurements").json() == wanted


def test_the_formats_are_those_of_rest_and_json_where_none_is_said(http, session, twin):
    sent, medias = batches(70), list(WRITTEN)
    for n, batch in enumerate(sent):
        media = medias[n % 4]
        assert _send(session, twin, n, WRITTEN[media](rows(batch)), media)["number"] == n + 1
    again = _ask(session, twin, "?source=plc;sequence=1", payload=WRITTEN[medias[0]](rows(sent[1])))
    assert again == {"number": 2, "samples": 17, "repeated": True}
    assert http.post(f"/v1/twins/{twin}/stop").json()["samples"] == 71
    assert _rows(http, f"/v1/twins/{twin}").tobytes() == followed(sent, finish=True).tobytes()


def test_what_is_wrong_is_told_and_nothing_is_stored(http, session, twin):
    payload = WRITTEN["application/json"](rows(batches(1)[0]))
    for parameters, field in (
        ("?sequence=0", "source"), ("?source=a/b;sequence=0", "source"), ("?source=plc", "sequence"),
        ("?source=plc;sequence=-1", "sequence"), ("?source=plc;sequence=9007199254740992", "sequence"),
        ("?source=plc;sequence=x", "sequence"),
    ):  # fmt: skip
        problem = _ask(session, twin, parameters, payload=payload)
        assert (problem["status"], [each["field"] for each in problem["errors"]]) == (422, [field]), parameters
    assert _send(session, twin, 0, payload, "text/plain")["type"] == "urn:hrs-twin:problem:media-type"
    assert _send(session, twin, 0, b"[" * 4_000_001)["type"] == "urn:hrs-twin:problem:body-too-large"
    assert _send(session, twin, 0, b"[" * 65_000_000)["type"] == "urn:hrs-twin:problem:full"
    assert _ask(session, "*", "?source=plc;sequence=0", payload=payload)["status"] == 422
    assert list(session.get("hrs/v1/nobody/measurement", timeout=5)) == []
    http.post("/v1/twins", json={"id": "simulated", "scenario": "S1"})
    assert _send(session, "simulated", 0, payload)["status"] == 409
    http.post("/v1/twins/simulated/stop")
    session.put(f"hrs/v1/{twin}/measurement", payload)
    assert _ask(session, twin) == {"sources": []}
    assert _send(session, twin, 0, payload)["number"] == 1
    assert _send(session, twin, 0, WRITTEN["application/json"](rows(batches(2)[1])))["status"] == 409


CELLS = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | st.sampled_from(["T.vehicle"]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)
ROWS = st.lists(
    st.fixed_dictionaries(
        {"tag": st.sampled_from([each["tag"] for each in TAGS["tags"]]) | CELLS, "time": CELLS, "value": CELLS},
        optional={"quality": CELLS},
    ),
    max_size=4,
)
PAYLOADS = st.binary(max_size=200) | st.one_of(CELLS, ROWS).map(lambda value: json.dumps(value).encode())


@pytest.mark.slow
def test_whatever_comes_is_answered_and_the_twin_goes_on(http, session, twin):
    # what is drawn may be right, and its times such that what follows is late: the last is another twin's
    @settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))
    @given(PAYLOADS, st.sampled_from([*WRITTEN, "application/x+json", "zenoh/bytes", "text/plain", "x"]))
    def attacked(payload, media):
        found = _send(session, twin, random.SystemRandom().randrange(2**53), payload, media, source="fuzz")
        assert "number" in found or found["status"] in (409, 413, 415, 422), found

    attacked()
    assert http.get(f"/v1/twins/{twin}").json()["state"] == "running"
    assert "number" in _send(session, twin, 0, WRITTEN["application/json"](rows(batches(1)[0])))


def test_parameters_of_any_text_are_answered(session, twin):
    @settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
    @given(st.text(st.characters(exclude_characters="\x00", exclude_categories=["Cs"]), max_size=30))
    def asked(text):
        try:
            replies = list(session.get(f"hrs/v1/{twin}/measurement?{text}", payload=b"[]", timeout=20))
        except zenoh.ZError:  # no parameters at all
            return
        (reply,) = replies
        assert json.loads(reply.err.payload.to_bytes())["status"] == 422

    asked()
