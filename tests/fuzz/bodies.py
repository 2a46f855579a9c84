"""Bodies and queries that no schema draws: enormous numbers, lone surrogates, NaN, broken JSON, foreign cursors."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable
from typing import Any

import httpx
from hypothesis import strategies as st

from api.http.problems import MEDIA_TYPE
from station import load_scenario
from tests.fuzz.certificates import certificates
from tests.fuzz.documents import HUGE, TEXTS, as_json, broken, mutated, values
from tests.fuzz.properties import Property

DISTURBED = {"name": "noisy", "arrivals": {"kind": "uniform", "count": 5, "period_s": 1000.0}, "disturbance": {}}
SCENARIO = load_scenario("S1").model_dump(mode="json")
SYSTEM = {"ask": "stability", "modes": [{"A": [["0.5"]]}, {"A": [["0.4"]]}], "constraint": {"kind": "dwell", "tau": 2}}

POSTED: dict[str, list[Any]] = {
    "/v1/runs": [{"scenario": "S1", "controller": "minlp1:horizon=2", "seed": 1}, {"scenario": SCENARIO}],
    "/v1/comparisons": [{"scenarios": ["S1", DISTURBED], "controllers": ["logic"], "replications": 2}],
    "/v1/certificates": [SYSTEM],
    "/v1/certificates/verify": certificates(),
    "/v1/twins": [{"scenario": "S1", "speed": 60, "certificate": {"controller": {"name": "logic", "options": {}}}}],
    "/v1/calibrations": [{"twin": "fuzzed", "from_s": 0, "to_s": 30_000}],
    "/v1/twins/fuzzed/station": [{"calibration": "calibration-x"}],
    "/v1/twins/fuzzed/vehicles": [{"start_pressure_bar": 120.0, "volume_m3": 0.1}],
    "/v1/scenarios/resolve": [SCENARIO, DISTURBED],
    "/v1/scenarios/vehicles?replication=1": [SCENARIO, DISTURBED],
    "/v1/scenarios/trace": [{"csv": "time_s,start_pressure_bar\n60,120\n"}],
    "/v1/keys": [{"name": "ann", "scopes": ["read"]}],
}
"""Bodies that are accepted, by path."""

READ: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("/v1/runs", "/v1/comparisons", "/v1/certificates", "/v1/twins"), ("cursor", "limit", "state")),
    "/v1/calibrations": ("cursor", "limit", "state"),
    "/v1/twins/fuzzed/events": ("cursor", "after", "limit"),
    "/v1/twins/fuzzed/history": ("columns", "from_s", "to_s", "step_s", "fold", "format"),
    "/v1/controllers/logic/certificate/state": ("station", "options", "of"),
    "/v1/twins/fuzzed": ("speed",), "/v1/keys/%00": (), "/v1/runs/%00": (), "/v1/twins/%ff": (),
}  # fmt: skip
"""Fields of the query, by path."""

plain = st.text(st.characters(codec="utf-8"), max_size=8) | st.sampled_from(("\x00", "extremes", "csv", "parquet"))
figures = (
    st.integers().map(str) | st.floats().map(repr)
    | st.sampled_from(("1" * 5000, "1e999", "inf", "-0", "9" * 30, "1e-300", "\N{ARABIC-INDIC DIGIT ONE}"))
)  # fmt: skip
numbers = st.floats() | st.integers() | st.sampled_from(HUGE)
texts = st.sampled_from(TEXTS) | st.text(max_size=5)
cursors = (values | st.tuples(numbers, texts) | st.tuples(numbers)).map(
    lambda place: base64.urlsafe_b64encode(as_json(place)).decode().rstrip("=")
)


@st.composite
def bodies(draw: Callable[[Any], Any]) -> tuple[str, str, bytes]:
    """(method, path, body)."""
    path = draw(st.sampled_from(sorted(POSTED)))
    good = draw(st.sampled_from(POSTED[path]))
    made = as_json(draw(mutated(good) | values))
    return "POST", path, draw(st.just(made) | st.just(made) | broken(made))


@st.composite
def queries(draw: Callable[[Any], Any]) -> tuple[str, str, bytes]:
    """(method, path with a query, no body)."""
    path = draw(st.sampled_from(sorted(READ)))
    names = draw(st.lists(st.sampled_from(READ[path]), max_size=4)) if READ[path] else []
    query = {name: draw(cursors if name == "cursor" else figures | plain) for name in names}
    method = draw(st.sampled_from(("GET", "GET", "GET", "PATCH", "DELETE", "HEAD", "PUT")))
    return method, str(httpx.URL(path, params=query) if query else path), b""


names = st.sampled_from(("Idempotency-Key", "If-Match", "If-None-Match", "X-Request-ID", "Last-Event-ID", "Accept"))
letters = st.integers(32, 126) | st.integers(128, 255)  # what a server must take; others end in its own words
headers = st.dictionaries(names, st.lists(letters, max_size=20).map(lambda told: bytes(told).strip()))


def properties(client: httpx.Client) -> list[Property]:
    """Of the service that `client` asks; it gets a twin `fuzzed`."""
    twin = {"id": "fuzzed", "scenario": "S1", "at_end": "repeat", "speed": 60}
    client.post("/v1/twins", json=twin).raise_for_status()

    def check(drawn: tuple[tuple[str, str, bytes], dict[str, bytes]]) -> None:
        (method, path, body), told = drawn
        sent = [(b"content-type", b"application/json"), *((name.encode(), given) for name, given in told.items())]
        answer = client.request(method, path, content=body, headers=sent)
        assert answer.status_code < 500, (answer.status_code, answer.text)
        assert answer.headers["x-request-id"]
        if answer.status_code >= 400 and method != "HEAD":
            assert answer.headers["content-type"] == MEDIA_TYPE
            assert json.loads(answer.content)["status"] == answer.status_code

    return [
        Property("request bodies", st.tuples(bodies(), headers), check),
        Property("queries and headers", st.tuples(queries(), headers), check),
    ]
