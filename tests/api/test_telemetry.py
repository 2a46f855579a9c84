"""Telemetry as strangers see it: real sessions, in other processes, against a running service."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from importlib.metadata import distribution
from pathlib import Path

import httpx
import numpy as np
import pytest
import zenoh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from api.telemetry.session import connect
from api.twins.messages import COLUMNS
from controllers import create
from station import InputError, Status, load_scenario, simulate
from tests.api.conftest import RunningService
from tests.stalls import Stalls
from tests.waiting import wait_until
from tests.warm import run_hrs

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples" / "telemetry"


@pytest.fixture(scope="module")
def session(service):
    with connect(service.zenoh) as opened:
        yield opened


@pytest.fixture(scope="module")
def stranger(tmp_path_factory):
    """Python with eclipse-zenoh and nothing else."""
    folder = tmp_path_factory.mktemp("stranger")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder], check=True)
    (packages,) = folder.glob("lib/python*/site-packages")
    here = distribution("eclipse-zenoh")
    for file in here.files:
        (packages / file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(here.locate_file(file), packages / file)
    return folder / "bin" / "python"


def _start(http, name, **more):
    request = {"id": name, "scenario": "S1", "controller": "minlp1", "speed": 20, **more}
    answer = http.post("/v1/twins", json=request)
    assert answer.status_code == 201, answer.text
    return answer.json()


def _get(session, selector, payload=None):
    replies = list(session.get(selector, payload=payload, timeout=10))
    assert len(replies) == 1, (selector, replies)
    reply = replies[0]
    return json.loads((reply.ok or reply.err).payload.to_bytes())


def _rows(samples):
    return np.array(
        [[np.nan if figure is None else figure for figure in sample["values"].values()] for sample in samples]
    )


@pytest.mark.slow
def test_a_stranger_rebuilds_the_record_through_every_interruption(stranger, tmp_path):
    """Late start, SIGSTOP, SIGKILL of the subscriber, SIGKILL of the service: bit for bit the simulation's record."""
    service = RunningService(tmp_path / "data", HRS_CHECKPOINT_S="0.5")
    with httpx.Client(base_url=service.url, trust_env=False) as http:
        _start(http, "told", speed=150, at_end="stop")
    record = simulate(load_scenario("S1"), create("minlp1"))
    command = [
        stranger, EXAMPLES / "rebuild.py", "told", tmp_path / "record.jsonl", "--endpoint", service.zenoh, "--until",
        str(len(record) - 1),
    ]  # fmt: skip
    time.sleep(1.0)
    first = subprocess.Popen(command)
    time.sleep(1.5)
    first.send_signal(signal.SIGSTOP)
    time.sleep(1.0)
    first.send_signal(signal.SIGCONT)
    time.sleep(0.5)
    first.kill()
    first.wait()
    second = subprocess.Popen(command)
    time.sleep(1.5)
    service.kill()
    time.sleep(1.0)
    service.start()
    try:
        assert second.wait(60) == 0
        lines = [json.loads(line) for line in (tmp_path / "record.jsonl").read_text().splitlines()]
        with httpx.Client(base_url=service.url, trust_env=False) as http:
            stored = http.get("/v1/twins/told/history").json()["columns"]
            kinds = [event["kind"] for event in http.get("/v1/twins/told/events?limit=1000").json()["items"]]
    finally:
        service.stop()
    rebuilt = {sample["seq"]: sample for sample in lines}
    assert sorted(rebuilt) == list(range(len(record)))
    assert {sample["epoch"] for sample in rebuilt.values()} == {1, 2}
    assert "resumed" in kinds
    rows = _rows([rebuilt[seq] for seq in range(len(record))])
    for place, name in enumerate(COLUMNS):
        expected = np.asarray(record[name], float)
        assert rows[:, place].tobytes() == expected.tobytes(), name
        kept = np.array([np.nan if figure is None else figure for figure in stored[name]], float)
        assert kept.tobytes() == expected.tobytes(), name


def test_a_late_joiner_has_the_current_state_at_once(service, http, session):
    _start(http, "late", speed=1)
    wait_until(lambda: http.get("/v1/twins/late").json()["samples"] > 1)
    sample = _get(session, "hrs/v1/late/sample")
    assert list(sample["values"]) == list(COLUMNS)
    assert sample["seq"] >= 1
    signal_ = _get(session, "hrs/v1/late/signal/pressure_high")
    assert (signal_["unit"], signal_["value"]) == ("bar", sample["values"]["pressure_high"])
    every = list(session.get("hrs/v1/late/signal/*", timeout=10))
    assert {str(reply.ok.key_expr).rpartition("/")[2] for reply in every} == set(COLUMNS)
    events = _get(session, "hrs/v1/late/event")
    assert [event["kind"] for event in events["events"]][:4] == ["started", "arrival", "fill_start", "valve_change"]
    assert [event["seq"] for event in events["events"]] == list(range(events["told"]))


@pytest.mark.slow
def test_samples_signals_and_events_are_published(http, session):
    heard = {"sample": [], "event": [], "signal": []}
    subscribers = [
        session.declare_subscriber(f"hrs/v1/heard/{kind}", heard[kind.partition("/")[0]].append)
        for kind in ("sample", "event", "signal/mass_low")
    ]
    _start(http, "heard", speed=20, at_end="repeat")
    wait_until(lambda: len(heard["sample"]) > 60 and heard["signal"])
    for subscriber in subscribers:
        subscriber.undeclare()
    samples = [json.loads(item.payload.to_bytes()) for item in heard["sample"]]
    assert [sample["seq"] for sample in samples] == list(range(samples[0]["seq"], samples[0]["seq"] + len(samples)))
    assert str(heard["sample"][0].encoding) == "application/json"
    by_seq = {sample["seq"]: sample for sample in samples}
    for item in heard["signal"]:
        told = json.loads(item.payload.to_bytes())
        if told["seq"] in by_seq:
            assert told["value"] == by_seq[told["seq"]]["values"]["mass_low"]
            assert told["unit"] == "g"
    assert "valve_change" in [json.loads(item.payload.to_bytes())["kind"] for item in heard["event"]]


def test_history_is_paged_without_hole_or_double(http, session):
    _start(http, "paged", speed="max", at_end="stop")
    record = simulate(load_scenario("S1"), create("minlp1"))
    rows, until = [], time.monotonic() + 60
    while len(rows) < len(record) and time.monotonic() < until:
        answer = _get(session, f"hrs/v1/paged/history?from={len(rows)};limit=100")
        assert answer["first"] == len(rows)
        assert [sample["seq"] for sample in answer["samples"]] == list(range(len(rows), answer["next"]))
        rows += answer["samples"]
        if len(answer["samples"]) < 100:
            time.sleep(0.1)  # it is being written
    assert len(rows) == len(record)
    np.testing.assert_array_equal(_rows(rows)[:, list(COLUMNS).index("pressure_low")], record["pressure_low"])


def test_a_twin_is_alive_while_it_runs(http, session):
    news = []
    # The router may hear of the twin before it hears of this subscription: history has it told all the same.
    watching = session.liveliness().declare_subscriber("hrs/v1/*/alive", news.append, history=True)
    _start(http, "alive", speed=1)

    def told():
        return [item.kind for item in news if str(item.key_expr) == "hrs/v1/alive/alive"]

    def tokens():
        return [str(reply.ok.key_expr) for reply in session.liveliness().get("hrs/v1/alive/alive", timeout=5)]

    wait_until(told)
    wait_until(lambda: tokens() == ["hrs/v1/alive/alive"])  # a busy router tells subscribers first
    http.post("/v1/twins/alive/stop")
    wait_until(
        lambda: (
            [item.kind for item in news if str(item.key_expr) == "hrs/v1/alive/alive"][-1:] == [zenoh.SampleKind.DELETE]
        )
    )
    watching.undeclare()


def test_commands_do_what_rest_does(http, session):
    _start(http, "ordered", speed=5, at_end="idle")

    def order(**document):
        return _get(session, "hrs/v1/ordered/command", json.dumps(document))

    assert order(command="pause")["state"] == "paused"
    before = http.get("/v1/twins/ordered").json()["samples"]
    time.sleep(0.5)
    assert http.get("/v1/twins/ordered").json()["samples"] == before
    assert order(command="speed", speed=50)["speed"] == 50
    assert order(command="continue")["state"] == "running"
    assert order(command="controller", controller="logic")["controller"] == "logic"
    assert order(command="vehicle", start_pressure_bar=100)["state"] == "running"
    assert order(command="controller", controller="nobody")["status"] == 422
    assert order(command="vehicle", start_pressure_bar=5000)["errors"][0]["field"] == "vehicle.start_pressure_bar"
    assert order(command="dance")["status"] == 422
    assert order(command="stop")["state"] == "stopped"
    kinds = [event["kind"] for event in http.get("/v1/twins/ordered/events?limit=1000").json()["items"]]
    for kind in ("paused", "speed_changed", "continued", "controller_changed", "vehicle_added", "stopped"):
        assert kind in kinds


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(payload=st.one_of(st.binary(max_size=200), st.text(max_size=200).map(str.encode)))
def test_whatever_is_sent_as_a_command_is_answered(service, session, target, payload):
    answer = _get(session, f"hrs/v1/{target}/command", payload)
    assert answer["status"] == 422
    assert answer["type"] == "urn:hrs-twin:problem:invalid"


@pytest.fixture(scope="module")
def target(http):
    return _start(http, "target", speed=1)["id"]


@pytest.mark.parametrize("selector", ["history?from=-1", "history?from=x", "history?limit=1001", "event?after=-2"])
def test_wrong_parameters_are_named(session, target, selector):
    answer = _get(session, f"hrs/v1/{target}/{selector}")
    assert answer["status"] == 422
    assert answer["errors"][0]["field"] in selector


def test_large_commands_are_refused_and_unknown_twins_silent(session, target):
    assert "64000 bytes" in _get(session, f"hrs/v1/{target}/command", b"x" * 70_000)["errors"][0]["message"]
    assert list(session.get("hrs/v1/nobody/history", timeout=5)) == []


@pytest.mark.slow
def test_a_program_elsewhere_decides_and_logic_when_it_is_gone(service, http, stranger):
    _start(http, "remote", speed=5, at_end="repeat")
    program = subprocess.Popen(
        [stranger, EXAMPLES / "controller.py", "remote", "--endpoint", service.zenoh], stdout=subprocess.PIPE, text=True
    )
    assert "answering" in program.stdout.readline()
    assert http.patch("/v1/twins/remote", json={"controller": "remote"}).json()["controller"] == "remote"

    def statuses():
        table = http.get("/v1/twins/remote/history", params={"columns": "decision_status,outlet_high"}).json()[
            "columns"
        ]
        return table["decision_status"]

    wait_until(lambda: statuses().count(Status.RULE) > 20)
    program.kill()
    program.wait()
    program.stdout.close()
    wait_until(lambda: statuses()[-5:] == [Status.FALLBACK] * 5)
    kinds = [event["kind"] for event in http.get("/v1/twins/remote/events?limit=1000").json()["items"]]
    assert "controller_changed" in kinds
    assert "deadline_missed" in kinds
    http.post("/v1/twins/remote/stop")


@pytest.mark.parametrize(
    ("name", "answer"),
    [
        ("nothing", b""),
        ("list", b"[]"),
        ("no-command", b"{}"),
        ("unknown-valve", b'{"command": ["door"]}'),
        ("seventh-valve", b'{"command": 64}'),
        ("true", b'{"command": true}'),
    ],
)
def test_nonsense_is_no_decision(session, http, name, answer):
    queryable = session.declare_queryable(f"hrs/v1/{name}/decide", lambda query: _reply(query, answer))
    _start(http, name, speed=20, controller="remote")
    wait_until(lambda: http.get(f"/v1/twins/{name}").json()["samples"] > 5)
    assert http.get(f"/v1/twins/{name}").json()["values"]["decision_status"] == Status.FALLBACK
    http.post(f"/v1/twins/{name}/stop")
    queryable.undeclare()


def _reply(query, answer):
    with query:
        query.reply(query.key_expr, answer)


SUBSCRIBER = """
import json, sys, time, zenoh
endpoint, twin, wait = sys.argv[1], sys.argv[2], float(sys.argv[3])
config = {"mode": "client", "connect": {"endpoints": [endpoint]}, "scouting": {"multicast": {"enabled": False}}}
heard = []
def hear(sample):
    document = json.loads(sample.payload.to_bytes())
    heard.append((document["seq"], time.time() - document["sent"]))
    time.sleep(wait)
with zenoh.open(zenoh.Config.from_json5(json.dumps(config))) as session:
    subscriber = session.declare_subscriber(f"hrs/v1/{twin}/sample", hear)
    print("ready", flush=True)
    sys.stdin.readline()
    subscriber.undeclare()
    print(json.dumps(heard))
"""


@pytest.fixture
def subscribe(service):
    """Starts a subscriber in a process of its own, which waits so long over each sample [s]; all are ended behind."""
    with ExitStack() as started:

        def start(twin, wait):
            command = [sys.executable, "-c", SUBSCRIBER, service.zenoh, twin, str(wait)]
            process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
            started.callback(process.communicate)
            started.callback(process.kill)
            assert process.stdout.readline() == "ready\n"
            return process

        yield start


@pytest.mark.slow
@pytest.mark.timed
def test_a_frozen_and_a_slow_subscriber_disturb_nobody(http, subscribe):
    _start(http, "crowd", speed=100, at_end="repeat")
    with Stalls() as stalls:
        others = [subscribe("crowd", 0.0) for _ in range(8)]
        frozen, _slow = subscribe("crowd", 0.0), subscribe("crowd", 0.02)
        frozen.send_signal(signal.SIGSTOP)
        wanted = http.get("/v1/twins/crowd").json()["samples"] + 500
        wait_until(lambda: http.get("/v1/twins/crowd").json()["samples"] > wanted)
        state = http.get("/v1/twins/crowd").json()
    for process in others:
        heard = json.loads(process.communicate("\n", timeout=20)[0])
        numbers = [seq for seq, _ in heard]
        assert numbers == sorted(set(numbers))
        lost = numbers[-1] - numbers[0] + 1 - len(numbers)
        assert lost / 100 <= stalls.total  # queues outlive no machine that stands still
        assert len(numbers) > 400 - lost
        assert np.quantile([lateness for _, lateness in heard], 0.5) < 0.1
    assert state["lateness_max_s"] < 0.5 + 3 * stalls.worst  # seconds, where a twin waits for who stands still
    http.post("/v1/twins/crowd/stop")


@pytest.mark.slow
def test_no_router_and_a_taken_endpoint_are_told(service, tmp_path):
    with pytest.raises(InputError, match="no router answers"):
        connect("tcp/127.0.0.1:1")
    refused = run_hrs("serve", "--port", 0, "--data", tmp_path, "--zenoh-listen", service.zenoh)
    assert refused.returncode == 2
    assert "zenoh_listen" in refused.stderr
    assert "cannot be listened on" in refused.stderr
    assert "Traceback" not in refused.stderr
