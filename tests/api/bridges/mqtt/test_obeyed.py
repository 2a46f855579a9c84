"""Commands from a broker: obeyed where a user has switched them on, with a key that may operate, and answered."""

from __future__ import annotations

import json
import os
import subprocess
import threading

import pytest

from api.bridges.mqtt.broker import Broker
from api.bridges.mqtt.commands import WAITING_MAX, CommandWorker
from api.bridges.mqtt.payload import BOOLEAN, DOUBLE, STRING, Metric, decode, encode
from api.bridges.mqtt.publish import Publisher
from api.bridges.mqtt.sparkplug import EdgeNode
from api.client import Service, ServiceError
from station import InputError
from tests.api.bridges.mqtt.conftest import Listener
from tests.api.bridges.mqtt.test_sparkplug import Host, read
from tests.api.conftest import RunningService
from tests.api.here import hrs
from tests.api.test_cli_send import HRS
from tests.waiting import wait_until


@pytest.fixture(scope="module")
def guarded(tmp_path_factory):
    """A service that asks for keys, and a key of each scope."""
    folder = tmp_path_factory.mktemp("obeyed")
    keys = {
        scope: hrs("keys", "create", scope, "--scope", scope, "--data", folder).stdout.strip()
        for scope in ("read", "operate", "measure")
    }
    running = RunningService(folder, "--host", "0.0.0.0", "--workers", "0")  # noqa: S104  # what needs the keys
    yield running, keys
    running.stop()


class Sender:
    """A client in the broker's network that sends commands and hears their answers; nothing of it is the product's."""

    def __init__(self, broker, twin) -> None:
        self._topic = f"hrs/v1/{twin}/command"
        self.listener = Listener(broker, f"{self._topic}/answer", "sender")

    def send(self, document, *, retain=False):
        content = document if isinstance(document, bytes) else json.dumps(document).encode()
        self.listener.client.publish(self._topic, content, 1, retain=retain).wait_for_publish(5)

    def ask(self, document):
        """The answer to a command."""
        before = len(self.listener.heard)
        self.send(document)
        wait_until(lambda: len(self.listener.heard) > before)
        return json.loads(self.listener.heard[before][1])


@pytest.mark.slow
def test_a_command_is_done_and_answered(guarded, broker):
    running, keys = guarded
    alive = Listener(broker, "hrs/v1/obeys/alive", "alive")
    sender = Sender(broker, "obeys")
    sender.send({"command": "stop"}, retain=True)  # a retained one is nobody's
    with Service(url=running.url, key=keys["operate"]) as service:
        twin = service.start("S1", id="obeys", speed=20, at_end="repeat")
        command = [HRS, "mqtt", "publish", "obeys", broker.url, "--commands", "--url", running.url]
        publishing = subprocess.Popen(
            command, stderr=subprocess.PIPE, text=True, env={**os.environ, "HRS_API_KEY": keys["operate"]}
        )
        try:
            wait_until(lambda: [payload for _, payload, _ in alive.heard] == [b"online"])
            answer = sender.ask({"command": "pause", "id": "a"})
            assert (answer["done"], answer["id"], answer["twin"]) == (True, "a", "obeys")
            assert answer["state"]["state"] == twin.state()["state"] == "paused"
            assert sender.ask({"command": "speed", "speed": 60})["state"]["speed"] == 60
            assert sender.ask({"command": "controller", "controller": "minlp1"})["state"]["controller"] == "minlp1"
            assert sender.ask({"command": "continue"})["state"]["state"] == "running"
            queue = twin.state()["events"]
            vehicle = {"command": "vehicle", "start_pressure_bar": 120.0, "id": "v"}
            first, again = sender.ask(vehicle), sender.ask(vehicle)
            assert (first["done"], first["repeated"], again["repeated"]) == (True, False, True)
            assert {**again, "repeated": False} == first
            wait_until(lambda: twin.state()["events"] > queue)
            for wrong, named in [
                (b"{", "is not JSON"),
                (b"x" * 64_001, "must not exceed 64000 bytes; given 64001"),
                ({"command": "explode"}, "command"),
                ({"command": "speed", "speed": 0}, "speed"),
                ({"command": "controller", "controller": "nobody"}, "nobody"),
                ({"command": "pause", "id": 3}, "id: must be a text"),
                ([1], "command"),
            ]:
                answer = sender.ask(wrong)
                assert (answer["done"], named in answer["error"]) == (False, True), answer
            assert twin.state()["state"] == "running"
            assert sender.ask({"command": "stop"})["state"]["state"] == "stopped"
            _, errors = publishing.communicate(timeout=60)
            assert (publishing.returncode, "retained is not obeyed" in errors) == (0, True), errors
        finally:
            publishing.kill()
            publishing.wait()
            alive.close()
            sender.listener.close()


@pytest.mark.slow
def test_a_key_that_reads_publishes_and_obeys_nobody(guarded, broker):
    running, keys = guarded
    with Service(url=running.url, key=keys["operate"]) as operator:
        operator.start("S1", id="safe", speed=20, at_end="repeat")
    for scope in ("read", "measure"):
        with Service(url=running.url, key=keys[scope]) as service, pytest.raises(ServiceError, match="operate"):
            Publisher(service.twin("safe"), Broker.parse(broker.url), commands=True)
        with Service(url=running.url, key=keys[scope]) as service, pytest.raises(ServiceError, match="operate"):
            EdgeNode(service.twin("safe"), Broker.parse(broker.url), "plant", commands=True)
    listener, ending = Listener(broker, "hrs/v1/safe/#"), threading.Event()
    with Service(url=running.url, key=keys["operate"]) as service:
        publisher = Publisher(service.twin("safe"), Broker.parse(broker.url))  # not switched on
        thread = threading.Thread(target=publisher.run, args=(ending,))
        thread.start()
        wait_until(lambda: len(listener.heard) > 10)
        listener.client.publish("hrs/v1/safe/command", b'{"command": "stop"}', 1).wait_for_publish(5)
        heard = len(listener.heard)
        wait_until(lambda: len(listener.heard) > heard + 40)
        assert service.twin("safe").state()["state"] == "running"
        assert not any(topic.endswith("answer") for topic, _, _ in listener.heard)
        ending.set()
        thread.join(30)
    listener.close()


class Writer(Host):
    """A host that leaves out what it has sent itself."""

    def told(self):
        own = [each for each in list(self.listener.heard) if "/NCMD/" not in each[0]]
        return [(topic.split("/")[2], read(payload)) for topic, payload, _ in own]


@pytest.mark.slow
def test_a_host_writes_the_metrics_of_a_node(guarded, broker):
    running, keys = guarded
    with Service(url=running.url, key=keys["operate"]) as service:
        twin = service.start("S1", id="written", speed=20, at_end="repeat")
        listener, ending = Listener(broker, "spBv1.0/plant/#"), threading.Event()
        host = Writer(listener)
        node = EdgeNode(twin, Broker.parse(broker.url), "plant", commands=True)
        thread = threading.Thread(target=node.run, args=(ending,))
        thread.start()
        wait_until(lambda: any(kind == "NBIRTH" for kind, _ in host.told()))
        birth = next(payload for kind, payload in host.told() if kind == "NBIRTH")
        born = {metric.name: metric for metric in birth.metrics}
        assert born["Command/Paused"].boolean_value is False
        assert (born["Command/Speed"].double_value, born["Command/Controller"].string_value) == (20.0, "logic")

        def write(*metrics):
            listener.client.publish("spBv1.0/plant/NCMD/written", encode(metrics, timestamp=1, seq=None), 1)

        def told(name):
            """What the node has told of a metric since its birth."""
            values = (metric for kind, payload in host.told() if kind == "NDATA" for metric in payload.metrics)
            return [metric for metric in values if metric.alias == born[name].alias]

        write(Metric(value=True, datatype=BOOLEAN, name="Command/Paused"), Metric(60.0, DOUBLE, "Command/Speed"))
        wait_until(lambda: told("Command/Speed"))
        state = twin.state()
        assert (state["state"], state["speed"]) == ("paused", 60.0)
        assert (told("Command/Paused")[0].boolean_value, told("Command/Speed")[0].double_value) == (True, 60.0)
        write(Metric("minlp1", STRING, alias=born["Command/Controller"].alias))  # by alias, as a host may
        wait_until(lambda: len(told("Command/Controller")) == 2)
        assert twin.state()["controller"] == told("Command/Controller")[1].string_value == "minlp1"
        write(Metric(0.5, DOUBLE, "Command/Speed"))  # refused: told what it still is
        listener.client.publish("spBv1.0/plant/NCMD/written", b"\xff\xff", 1)
        wait_until(lambda: len(told("Command/Speed")) == 3)
        assert told("Command/Speed")[2].double_value == twin.state()["speed"] == 60.0
        write(Metric(value=False, datatype=BOOLEAN, name="Command/Paused"))
        wait_until(lambda: twin.state()["state"] == "running")
        sequences = [payload.seq for kind, payload in host.told() if kind in ("NBIRTH", "NDATA")]
        assert [seq % 256 for seq in range(len(sequences))] == sequences  # commands leave no hole
        ending.set()
        thread.join(30)
        listener.close()


def test_a_payload_is_decoded_as_another_decoder_does():
    metrics = [
        Metric(2.5, DOUBLE, "Command/Speed", 3),
        Metric(value=True, datatype=BOOLEAN, name="Command/Paused"),
        Metric("logic", STRING, alias=300),
        Metric(None, DOUBLE, alias=4),
    ]
    content = encode(metrics, timestamp=1, seq=7)
    ours, theirs = decode(content), read(content).metrics
    assert [(each.name, each.alias, each.datatype, each.value) for each in ours] == [
        ("Command/Speed", 3, DOUBLE, 2.5),
        ("Command/Paused", None, BOOLEAN, True),
        (None, 300, STRING, "logic"),
        (None, 4, DOUBLE, None),
    ]
    assert [each.alias for each in theirs] == [3, 0, 300, 4]
    for cut in range(1, len(content)):
        try:
            decode(content[:cut])
        except ValueError:
            continue


@pytest.mark.parametrize("content", [b"\xff" * 12, b"\x12", b"\x12\x05a", b"\x13", b"\x12\x03\x0a\x05a"])
def test_what_is_no_payload_is_an_error(content):
    with pytest.raises(ValueError, match=r"has no end|is cut off|wire type"):
        decode(content)


class Message:
    """As paho hands it over."""

    def __init__(self, payload, *, retain=False) -> None:
        self.payload, self.retain = payload, retain


def test_commands_that_come_too_fast_are_left_out(caplog):
    worker = CommandWorker(None, lambda _answer: None)
    for _ in range(WAITING_MAX + 1):
        worker.on_message(None, None, Message(b"{}"))
    assert f"{WAITING_MAX} are waiting" in caplog.text


def test_an_id_that_was_answered_is_not_done_again():
    done, answers = [], []

    class Counting:
        id = "t"

        def change(self, **changes):
            done.append(changes)
            if changes == {"speed": 7.0}:
                raise InputError("the service", [("speed", "no")])
            return {"state": "paused"}

    worker = CommandWorker(Counting(), answers.append)
    for text in ('{"command":"pause","id":"1"}', '{"command":"pause","id":"1"}', '{"command":"pause"}'):
        worker.on_message(None, None, Message(text.encode()))
    worker.on_message(None, None, Message(b'{"command":"speed","speed":7,"id":"2"}'))
    worker.start()
    wait_until(lambda: len(answers) == 4)
    worker.close()
    assert done == [{"paused": True}, {"paused": True}, {"speed": 7.0}]
    assert [(each["id"], each["repeated"], each["done"]) for each in answers] == [
        ("1", False, True),
        ("1", True, True),
        (None, False, True),
        ("2", False, False),
    ]
