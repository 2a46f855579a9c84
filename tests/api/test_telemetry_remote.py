"""The slot filled over zenoh: asked in the documented form, waited for no longer than it may take."""

from __future__ import annotations

import json
import math
import threading
import time

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from api.settings import Settings
from api.telemetry.remote import RemoteController
from api.telemetry.session import connect, open_session
from controllers import DeadlineController
from station import ControllerError, Decision, Observation, Status, Valve, load_station
from station.geometry import VALVES
from tests.api.conftest import free_port

WORKERS = 0

SEEN = Observation(
    41.0, 1.0, (884.6838666864988, 784.28, 739.79), (24.9, 25.2, 25.0), -1, math.nan, math.nan, 0.1, True, 2, 33
)
TIMEOUT_S = 0.3


class Program:
    """Somebody else's: answers what it is told to, and remembers what it was asked."""

    def __init__(self) -> None:
        self.answer: bytes | None = b'{"command": []}'
        self.asked: list[dict[str, object]] = []
        self.go = threading.Event()
        self.go.set()

    def __call__(self, query):
        with query:
            self.asked.append(json.loads(query.payload.to_bytes()))
            self.go.wait(30)
            if self.answer is None:
                query.reply_err(b"no idea")
            else:
                query.reply(query.key_expr, self.answer)


@pytest.fixture(scope="module")
def sessions():
    """(of the service, of the program)."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with open_session(Settings(zenoh_listen=endpoint)) as service, connect(endpoint) as stranger:
        yield service, stranger


@pytest.fixture
def remote(sessions):
    controller = RemoteController(lambda: sessions[0], "demo", TIMEOUT_S)
    controller.start(load_station("thesis-fit"))
    return controller


@pytest.fixture
def program(sessions, remote):
    answering = Program()
    queryable = sessions[1].declare_queryable("hrs/v1/demo/decide", answering)
    until = time.monotonic() + 20
    while not answering.asked and time.monotonic() < until:  # until the router knows of it
        try:
            remote.decide(SEEN)
        except ControllerError:
            time.sleep(0.02)
    answering.asked.clear()
    yield answering
    answering.go.set()
    queryable.undeclare()
    until = time.monotonic() + 20
    while time.monotonic() < until:  # and until it has forgotten it
        try:
            remote.decide(SEEN)
        except ControllerError as error:
            if "nobody" in str(error):
                break


def test_the_question_is_the_observation(program, remote):
    remote.decide(SEEN)
    (asked,) = program.asked
    assert list(asked) == ["version", "twin", *Observation._fields]
    assert asked["pressure"] == list(SEEN.pressure)  # every digit
    assert asked["vehicle_pressure"] is None
    assert (asked["time"], asked["previous"], asked["communication"]) == (41.0, 33, True)


@pytest.mark.parametrize(
    ("answer", "expected"),
    [
        (b'{"command": ["inlet_low", "outlet_high"]}', Decision(Valve.INLET_LOW | Valve.OUTLET_HIGH)),
        (b'{"command": ["inlet_low", "inlet_low"]}', Decision(Valve.INLET_LOW)),
        (b'{"command": [], "note": "more fields do no harm"}', Decision(0)),
        (b'{"command": 12, "cost": 3, "bound": 2.5}', Decision(12, 0, 3.0, 2.5)),
    ],
)
def test_an_answer_is_a_decision(program, remote, answer, expected):
    program.answer = answer
    decided = remote.decide(SEEN)
    assert decided[:2] == (expected.command, Status.RULE)
    assert repr(decided[2:]) == repr(expected[2:])  # NaN where nothing was said


def test_nobody_is_told_at_once(remote):
    began = time.monotonic()
    with pytest.raises(ControllerError, match="nobody answers at hrs/v1/demo/decide"):
        remote.decide(SEEN)
    assert time.monotonic() - began < TIMEOUT_S


@pytest.mark.timed
def test_a_late_answer_is_not_waited_for(program, remote):
    program.go.clear()
    began = time.monotonic()
    with pytest.raises(ControllerError, match=r"no answer at hrs/v1/demo/decide within 0\.3 s"):
        remote.decide(SEEN)
    assert TIMEOUT_S <= time.monotonic() - began < TIMEOUT_S + 2
    program.go.set()


def test_an_error_is_told_as_such(program, remote):
    program.answer = None
    with pytest.raises(ControllerError, match="answered with an error"):
        remote.decide(SEEN)


NONSENSE = [b"", b"\xff", b"[]", b"{}", b'{"command": true}', b'{"command": ["door"]}', b'{"command": [["inlet_low"]]}']
NONSENSE += [b'{"command": 1.5}', b'{"command": null}', b" " * 10_001, b"[" * 5000]


@pytest.mark.parametrize("answer", NONSENSE)
def test_anything_else_is_an_error_that_says_what_is_wrong(program, remote, answer):
    program.answer = answer
    with pytest.raises(ControllerError, match=r"an answer must|command must"):
        remote.decide(SEEN)


_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=10),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)
_COMMANDS = st.lists(st.sampled_from(VALVES), max_size=7) | st.integers(0, 63) | _JSON
_ANSWERS = st.binary(max_size=50) | st.fixed_dictionaries(
    {"command": _COMMANDS}, optional={"cost": _JSON, "bound": _JSON}
).map(lambda document: json.dumps(document).encode())


@pytest.mark.slow
@settings(
    max_examples=100, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(answer=_ANSWERS)
def test_whatever_is_answered_the_station_has_a_command(program, remote, answer):
    """The deadline makes of every answer a command of six bits: the program's, or logic's with status FALLBACK."""
    program.answer = answer
    timed = DeadlineController(remote, 1.0)
    timed.start(load_station("thesis-fit"))
    decided = timed.decide(SEEN)
    timed.close()
    assert 0 <= decided.command < 64
    assert decided.status in {Status.RULE, Status.FALLBACK}
    try:
        given_command = json.loads(answer)["command"]
    except (ValueError, TypeError, KeyError):
        assert decided.status == Status.FALLBACK
    else:
        if isinstance(given_command, list) and given_command and set(map(str, given_command)) <= set(VALVES):
            assert decided.command == sum(Valve[name.upper()] for name in set(given_command))
