"""What a stranger on zenoh may send: questions, commands, puts, and decisions for a twin that asks for them."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import httpx
import orjson
import zenoh
from hypothesis import strategies as st

from api.telemetry.session import connect
from station import Status
from station.geometry import VALVES
from tests.fuzz.documents import HUGE, as_json, broken, mutated, values
from tests.fuzz.properties import Property

PATIENCE_S = 60.0
"""An answer, or a twin's next second, is waited for so long on the slowest machine [s]."""

COMMANDS = [
    {"command": "pause"}, {"command": "continue"}, {"command": "speed", "speed": 60},
    {"command": "controller", "controller": "minlp1:horizon=2"}, {"command": "vehicle", "start_pressure_bar": 120.0},
]  # fmt: skip
ANSWERS = [{"command": ["inlet_low", "outlet_high"]}, {"command": 12, "cost": 3.5, "bound": 2.0}]

twins = st.sampled_from(("told", "asking", "nobody", "*", "**", "fuz$*", "x" * 200, "Ä", "%00"))
ends = st.sampled_from(("sample", "signal/*", "signal/pressure_high", "event", "history", "command", "decide"))
keys = st.tuples(twins, ends).map(lambda parts: "/".join(("hrs/v1", *parts)))
numbers = st.integers().map(str) | st.sampled_from([*map(repr, HUGE[:1]), "9" * 5000, "-1", "0", "1e3", "", "\ufeff1"])
parameters = st.dictionaries(
    st.sampled_from(("from", "limit", "after", "_time", "")), numbers | st.text(max_size=5)
).map(lambda given: ";".join(f"{name}={value}" for name, value in given.items()))
documents = st.sampled_from(COMMANDS).flatmap(mutated) | values
payloads = (
    st.none() | st.binary(max_size=300) | documents.map(as_json) | st.just(b"x" * 70_000) | st.just(b"[" * 60_000)
    | documents.map(as_json).flatmap(broken)
)  # fmt: skip
answers = (st.sampled_from(ANSWERS).flatmap(mutated) | values).map(as_json)
decisions = st.tuples(
    answers | answers.flatmap(broken) | st.sampled_from([*map(as_json, ANSWERS), b"", b"x" * 20_000]) | st.binary(),
    st.sampled_from(("once", "twice", "late", "error", "silence")),
)


class Stranger:
    """Answers `decide` of the twin `asking` with what it was told."""

    def __init__(self) -> None:
        self.asked = 0
        self.says: tuple[bytes, str] = (b"", "silence")

    def __call__(self, query: zenoh.Query) -> None:
        self.asked += 1
        answer, how = self.says
        with query:
            if how == "late":
                time.sleep(0.1)
            if how == "error":
                query.reply_err(answer)
            elif how != "silence":
                for _ in range(2 if how == "twice" else 1):
                    query.reply(query.key_expr, answer)


def decides(says: tuple[bytes, str]) -> bool:
    """Whether an answer names a command, so that it may be used."""
    content, how = says
    try:
        command = orjson.loads(content)["command"]
    except (ValueError, TypeError, KeyError):
        return False
    listed = isinstance(command, list) and all(isinstance(name, str) and name in VALVES for name in command)
    return how in {"once", "twice"} and (listed or (type(command) is int and 0 <= command < 64))


@contextmanager
def properties(url: str, endpoint: str) -> Iterator[list[Property]]:
    """Of the service at `url` with its router at `endpoint`, from a session that is a client of it."""
    with httpx.Client(base_url=url, timeout=PATIENCE_S, trust_env=False) as http, connect(endpoint) as session:
        for twin, controller in (("told", "logic"), ("asking", "remote")):
            asked = {"id": twin, "scenario": "S1", "controller": controller, "speed": 50, "at_end": "repeat"}
            http.post("/v1/twins", json=asked).raise_for_status()
        stranger = Stranger()
        queryable = session.declare_queryable("hrs/v1/asking/decide", stranger)
        yield [
            Property("zenoh questions", st.tuples(keys, parameters, payloads), lambda drawn: _ask(session, *drawn)),
            Property("zenoh commands", payloads, lambda payload: _command(session, http, payload)),
            Property("zenoh puts", st.tuples(keys, payloads), lambda drawn: _put(session, *drawn)),
            Property("zenoh decisions", decisions, lambda says: _decide(http, stranger, says)),
        ]
        queryable.undeclare()


def _told(session: zenoh.Session, selector: str, payload: bytes | None = None) -> list[dict[str, Any]]:
    replies = session.get(selector, payload=payload, timeout=PATIENCE_S)
    told = [json.loads((reply.ok or reply.err).payload.to_bytes()) for reply in replies]
    assert all(document.get("status", 200) < 500 for document in told), told
    return told


def _ask(session: zenoh.Session, key: str, given: str, payload: bytes | None) -> None:
    """Whatever is asked, the answers are documents, and nothing is the service's fault."""
    if "decide" in key or ("command" in key and payload is not None):
        return  # asked of the stranger; tried apart
    try:
        zenoh.Selector(f"{key}?{given}")
    except zenoh.ZError:
        return  # zenoh itself sends no such thing
    _told(session, f"{key}?{given}", payload)
    assert _told(session, "hrs/v1/told/sample")


def _command(session: zenoh.Session, http: httpx.Client, payload: bytes | None) -> None:
    """A command is done or refused with a reason, and the twin lives."""
    (told,) = _told(session, "hrs/v1/told/command", payload)
    assert told["type"].startswith("urn:hrs-twin:problem:") if "type" in told else told["id"] == "told"
    assert http.get("/v1/twins/told").json()["state"] in {"running", "paused"}


def _put(session: zenoh.Session, key: str, payload: bytes | None) -> None:
    """What is put where the service publishes reaches its subscribers, not the service."""
    before = _told(session, "hrs/v1/told/history?from=0;limit=1")
    session.put(key, payload or b"")
    if "*" not in key:
        session.delete(key)
    assert _told(session, "hrs/v1/told/history?from=0;limit=1")[0]["samples"] == before[0]["samples"]


def _decide(http: httpx.Client, stranger: Stranger, says: tuple[bytes, str]) -> None:
    """The twin goes on: with the command if it is one, else with logic's, and says which."""
    stranger.says = says
    asked = stranger.asked
    until = time.monotonic() + PATIENCE_S
    while stranger.asked < asked + 3:
        assert time.monotonic() < until
        time.sleep(0.005)
    twin = http.get("/v1/twins/asking").json()
    status = twin["values"]["decision_status"]
    assert twin["state"] == "running"
    assert status in ({Status.RULE, Status.FALLBACK} if decides(says) else {Status.FALLBACK}), (says, status)
