"""What clients do wrong hurts nobody but themselves: they freeze, they ask for too much, they are gone."""

from __future__ import annotations

import json
import math
import signal
import subprocess
import sys
import threading
import time
from types import SimpleNamespace

import pytest
import zenoh

from api.settings import Settings
from api.telemetry.publisher import Telemetry
from api.telemetry.session import connect, open_session
from api.twins.messages import COLUMNS, Event, EventKind, Sample
from station import InputError
from tests.api.conftest import free_port
from tests.pace import slowness
from tests.stalls import Stalls
from tests.waiting import wait_until

ROW = tuple(math.nan if name.startswith("decision_") else float(place) for place, name in enumerate(COLUMNS))


class ScriptedTwins:
    """One twin called `told`, whose history is one row again and again."""

    alarms = None

    def __init__(self) -> None:
        self.current: Sample | None = None
        self.answering = threading.Event()
        self.answering.set()
        self.commands: list[object] = []
        self.obeying = threading.Event()
        self.obeying.set()

    def live(self, twin):
        return self if twin == "told" and self.current else None

    def known(self, twin):
        self.answering.wait(30)
        return twin == "told"

    def command(self, twin, document):
        self.commands.append(document)
        self.obeying.wait(30)
        return SimpleNamespace(model_dump_json=lambda: json.dumps({"id": twin}))

    def history(self, twin, first, limit):
        return [Sample(twin, 1, first + k, None, ROW) for k in range(limit)]

    def epochs(self, twin):
        return {1: 0}

    def samples(self, twin):
        return 10**6

    def thinned_to(self, twin):
        return 0


@pytest.fixture
def endpoint():
    return f"tcp/127.0.0.1:{free_port()}"


@pytest.fixture
def server(endpoint):
    """(twins, telemetry) on a router of their own."""
    twins = ScriptedTwins()
    with open_session(Settings(zenoh_listen=endpoint)) as session:
        telemetry = Telemetry(session, twins)
        telemetry.opened("told")
        yield twins, telemetry
        twins.answering.set()
        twins.obeying.set()
        telemetry.close()


@pytest.fixture
def client(server, endpoint):
    with connect(endpoint) as session:
        yield session


def _ask(session, selector, payload=None):
    return [json.loads((reply.ok or reply.err).payload.to_bytes()) for reply in session.get(selector, payload=payload)]


FREEZER = """
import json, os, signal, sys, zenoh
config = {"mode": "client", "connect": {"endpoints": [sys.argv[1]]}, "scouting": {"multicast": {"enabled": False}}}
with zenoh.open(zenoh.Config.from_json5(json.dumps(config))) as session:
    heard = []
    subscriber = session.declare_subscriber("hrs/v1/told/sample", heard.append)
    print("ready", flush=True)
    sys.stdin.readline()
    for _ in range(40):
        session.get("hrs/v1/told/history?from=0;limit=1000", lambda reply: None, timeout=60)
    print("frozen", flush=True)
    os.kill(os.getpid(), signal.SIGSTOP)
    already = len(heard)
    while len(heard) < already + 10:
        signal.sigtimedwait([], 0.05)
    print("hears again", flush=True)
    subscriber.undeclare()
"""


@pytest.fixture
def freezer(server, endpoint):
    """A client that asks for 32 MB of history and stands still before it has read them."""
    command = [sys.executable, "-c", FREEZER, endpoint]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "ready\n"
    yield process
    process.kill()
    process.communicate()


@pytest.mark.slow
@pytest.mark.timed
def test_a_client_that_freezes_while_it_is_answered_stops_neither_twin_nor_others(server, client, freezer):
    twins, telemetry = server
    heard = []
    other = client.declare_subscriber(
        "hrs/v1/told/sample", lambda item: heard.append(json.loads(item.payload.to_bytes()))
    )
    freezer.stdin.write("\n")
    freezer.stdin.flush()
    assert freezer.stdout.readline() == "frozen\n"
    took = []
    with Stalls() as stalls:
        for seq in range(600):
            began = time.perf_counter()
            telemetry.sample(Sample("told", 1, seq, time.time(), ROW))
            took.append(time.perf_counter() - began)
            time.sleep(0.005)
        wait_until(lambda: heard and heard[-1]["seq"] == 599)
    assert max(took) < 0.5 + stalls.worst  # 5 s where samples wait behind answers
    assert sorted(took)[300] < 0.005 * slowness()
    numbers = [sample["seq"] for sample in heard]
    assert numbers == sorted(set(numbers))
    lost = numbers[-1] - numbers[0] + 1 - len(numbers)
    assert 0.005 * lost <= stalls.total  # a machine that stands still loses what it was told meanwhile, and no more
    twins.current = Sample("told", 1, 599, time.time(), ROW)
    assert _ask(client, "hrs/v1/told/sample")[0]["seq"] == 599
    other.undeclare()

    freezer.send_signal(signal.SIGCONT)
    ending = threading.Event()

    def continue_():
        for seq in range(600, 6000):
            if ending.wait(0.01):
                return
            telemetry.sample(Sample("told", 1, seq, time.time(), ROW))

    publishing = threading.Thread(target=continue_)
    publishing.start()
    assert freezer.stdout.readline() == "hears again\n"
    ending.set()
    publishing.join()


@pytest.mark.parametrize(
    "selector", ["hrs/v1/*/history", "hrs/v1/*/event", "hrs/v1/*/command", "hrs/v1/t$*/command", "hrs/v1/*/measurement"]
)
def test_one_twin_must_be_named(server, client, selector):
    answers = _ask(client, selector, json.dumps({"command": "stop"}))
    assert [answer["status"] for answer in answers] == [422]
    assert answers[0]["errors"][0]["field"] == "key"
    assert selector in answers[0]["errors"][0]["message"]
    assert server[0].commands == []


@pytest.mark.parametrize("selector", ["**", "hrs/**", "hrs/v1/told/**"])
def test_whoever_asks_for_everything_has_the_current_state(server, client, selector):
    server[0].current = Sample("told", 1, 7, time.time(), ROW)
    replies = list(client.get(selector, timeout=10))
    found = {str(reply.ok.key_expr) for reply in replies if reply.ok is not None}
    assert found >= {"hrs/v1/told/sample", *(f"hrs/v1/told/signal/{name}" for name in COLUMNS)}
    refused = [json.loads(reply.err.payload.to_bytes())["status"] for reply in replies if reply.ok is None]
    assert refused == [422] * 4  # history, event, command, measurement: each asks for one twin by its name


@pytest.mark.parametrize("number", ["1_0", "+1", "", "%31", "٣", "1.0", "9" * 50, "0x1"])
def test_a_number_has_digits_alone(server, client, number):
    answer = _ask(client, f"hrs/v1/told/history?from={number}")[0]
    assert answer["errors"][0]["field"] == "from"
    assert "whole number from 0 to" in answer["errors"][0]["message"]


def test_too_many_queries_are_told_so_at_once_and_the_end_waits_for_none(server, client, monkeypatch):
    twins, telemetry = server
    monkeypatch.setattr(telemetry._answers.questions._waiting, "maxsize", 5)
    twins.answering.clear()
    answers = []
    for _ in range(20):
        client.get("hrs/v1/told/history?limit=1", lambda reply: answers.append(reply.err), timeout=30)
    wait_until(lambda: len(answers) >= 14)  # one is being answered, five wait
    assert {json.loads(error.payload.to_bytes())["status"] for error in answers} == {429}
    began = time.monotonic()
    telemetry.close()
    assert time.monotonic() - began < 5 * slowness()


def test_a_command_that_waits_for_the_store_keeps_no_question_waiting(server, client):
    twins, _ = server
    twins.obeying.clear()
    answers = []
    client.get(
        "hrs/v1/told/command",
        lambda reply: answers.append(reply.ok),
        payload=json.dumps({"command": "stop"}),
        timeout=30,
    )
    wait_until(lambda: twins.commands)
    assert len(_ask(client, "hrs/v1/told/history?limit=3")[0]["samples"]) == 3
    assert not answers
    twins.obeying.set()
    wait_until(lambda: answers)
    assert json.loads(answers[0].payload.to_bytes())["id"] == "told"


def test_a_session_that_is_gone_ends_no_twin(endpoint):
    session = open_session(Settings(zenoh_listen=endpoint))
    telemetry = Telemetry(session, ScriptedTwins())
    telemetry.opened("told")
    session.close()
    telemetry.sample(Sample("told", 1, 0, 0.0, ROW))
    telemetry.event(Event("told", 1, 0, 0.0, 0.0, EventKind.STARTED, {}))


@pytest.mark.slow
def test_sessions_come_and_go_without_a_thread_left(endpoint):
    before = set(threading.enumerate())
    for _ in range(3):
        with open_session(Settings(zenoh_listen=endpoint)) as session:
            telemetry = Telemetry(session, ScriptedTwins())
            telemetry.opened("told")
            telemetry.close()
        assert session.is_closed()
    until = time.monotonic() + 20
    while not set(threading.enumerate()) <= before:  # zenoh ends its own behind `close`
        assert time.monotonic() < until, threading.enumerate()
        time.sleep(0.05)


def test_signals_are_published_while_somebody_listens_to_one(server, client):
    _, telemetry = server
    whole, heard = [], []
    telling = client.declare_subscriber("hrs/v1/told/sample", whole.append)
    channel = telemetry._channels["told"]

    def tell(seq):
        channel.looked = 0.0
        telemetry.sample(Sample("told", 1, seq, 0.0, ROW))
        return channel.wanted

    wait_until(lambda: not tell(1) and whole)
    listening = client.declare_subscriber("hrs/v1/told/signal/pressure_$*", heard.append)
    wait_until(lambda: tell(2) and len(heard) >= 4)
    documents = [json.loads(item.payload.to_bytes()) for item in heard[:4]]
    assert [(told["seq"], told["value"], told["unit"]) for told in documents] == [(2, k, "bar") for k in range(1, 5)]
    assert all(item.congestion_control == zenoh.CongestionControl.DROP for item in heard + whole)
    listening.undeclare()
    wait_until(lambda: not tell(3))
    telling.undeclare()


@pytest.mark.slow
def test_who_listens_to_every_signal_misses_none(server, client):
    _, telemetry = server
    heard = []
    listening = client.declare_subscriber("hrs/v1/told/signal/*", heard.append)
    channel = telemetry._channels["told"]
    wait_until(lambda: telemetry.sample(Sample("told", 1, 0, 0.0, ROW)) or channel.wanted)
    for seq in range(1, 201):
        telemetry.sample(Sample("told", 1, seq, 0.0, ROW))
        time.sleep(0.01)
    wait_until(lambda: len(heard) >= 200 * len(COLUMNS))
    found = {(str(item.key_expr).rpartition("/")[2], json.loads(item.payload.to_bytes())["seq"]) for item in heard}
    assert found >= {(name, seq) for name in COLUMNS for seq in range(1, 201)}
    listening.undeclare()


def test_a_taken_endpoint_is_named(endpoint):
    with open_session(Settings(zenoh_listen=endpoint)), pytest.raises(InputError, match="zenoh_listen"):
        open_session(Settings(zenoh_listen=endpoint))
