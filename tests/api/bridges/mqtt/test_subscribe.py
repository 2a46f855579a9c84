"""Readings from a broker: followed as those sent to the service, through kills of each who takes part."""

from __future__ import annotations

import json
import queue
import shutil
import signal
import subprocess
import threading
import time

import numpy as np
import pytest
from paho.mqtt.publish import single

from api.bridges.mqtt.broker import Broker, client_of, connect
from api.bridges.mqtt.outbox import Outbox
from api.bridges.mqtt.publish import Publisher
from api.bridges.mqtt.subscribe import Subscriber, rows_of
from api.client import Service
from tests.api.conftest import RunningService
from tests.api.measured import ORDER, batches, followed, rows
from tests.api.test_cli_send import HRS
from tests.api.test_measurements import _rows
from tests.waiting import wait_until


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    """A service that computes no jobs."""
    started = RunningService(tmp_path_factory.mktemp("mqtt"), "--workers", "0")
    yield started
    started.stop()


@pytest.fixture
def service(running):
    with Service(url=running.url) as client:
        yield client


class Gateway:
    """A gateway that publishes readings in order, and tells again what a broker that was killed may have lost."""

    def __init__(self, broker) -> None:
        place = Broker.parse(broker.url)
        self._outbox = Outbox(
            lambda: client_of(place, "gateway"), lambda client: connect(client, place), lambda client: None
        )
        self._waiting: queue.SimpleQueue = queue.SimpleQueue()
        self._ending = threading.Event()
        self._outbox.open()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def publish(self, topic, samples) -> None:
        self._waiting.put((topic, {"samples": samples}))

    def _run(self) -> None:
        while (told := self._waiting.get()) is not None:
            self._outbox.send(*told, None, self._ending)
        self._outbox.flush(10.0, self._ending)

    def close(self) -> None:
        self._waiting.put(None)
        self._thread.join(20)
        self._ending.set()
        self._outbox.close()


class Subscribing:
    """A subscriber in a thread of its own."""

    def __init__(self, service, twin, broker, topic) -> None:
        self.ending = threading.Event()
        self.subscriber = Subscriber(service, twin, Broker.parse(broker.url), topic, "gateway-1")
        self.thread = threading.Thread(target=self.subscriber.run, args=(self.ending,))
        self.thread.start()
        assert self.subscriber._ready.wait(10)

    def end(self) -> None:
        self.ending.set()
        self.thread.join(30)


def ordered(service, name):
    return service.start(**{**ORDER, "id": name})


def rows_as_followed(running, name):
    import httpx

    with httpx.Client(base_url=running.url, trust_env=False) as http:
        return _rows(http, f"/v1/twins/{name}")


def test_readings_are_followed_as_those_that_are_sent(service, running, broker):
    sent = batches(200, 5)
    twin = ordered(service, "followed")
    subscribing, gateway = Subscribing(service, "followed", broker, "plant/#"), Gateway(broker)
    for batch in sent:
        gateway.publish("plant/all", rows(batch))
    for strange in ({"tag": "T.unknown", "time": 1.0, "value": 2.0}, "no reading"):
        single("plant/all", json.dumps(strange), 1, port=broker.port)
    total = sum(len(batch.tag) for batch in sent)
    counts = subscribing.subscriber.counts
    wait_until(lambda: (counts.stored, counts.refused) == (total, 2))
    subscribing.end()
    wait_until(lambda: twin.state()["samples"] >= 190)
    twin.stop()
    assert rows_as_followed(running, "followed").tobytes() == followed(sent, finish=True).tobytes()
    gateway.close()


def test_mosquitto_s_own_clients_do_what_the_page_shows(service, running, broker):
    """Programs that know of us what the page says: one publishes a reading, one hears a twin."""
    publish, subscribe = shutil.which("mosquitto_pub"), shutil.which("mosquitto_sub")
    if publish is None or subscribe is None:
        pytest.skip("mosquitto's clients are not installed")
    there = ("-h", "127.0.0.1", "-p", str(broker.port), "-q", "1")
    twin = ordered(service, "typed")
    subscribing = Subscribing(service, "typed", broker, "plant/+")
    reading = json.dumps({"value": 812.5, "time": "2026-11-21T09:20:00.250Z"})
    subprocess.run([publish, *there, "-t", "plant/T.pressure_high", "-m", reading], check=True)
    wait_until(lambda: subscribing.subscriber.counts.messages == 1)
    assert (subscribing.subscriber.counts.stored, subscribing.subscriber.counts.refused) == (1, 0)
    subscribing.end()
    twin.stop()
    told = service.start("S1", id="heard", speed=100, at_end="repeat")
    command = [subscribe, *there, "-t", "hrs/v1/heard/sample", "-C", "20"]
    hearing = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    ending = threading.Event()
    publisher = Publisher(told, Broker.parse(broker.url))
    thread = threading.Thread(target=publisher.run, args=(ending,))
    thread.start()
    lines = hearing.communicate(timeout=60)[0].splitlines()
    told.stop()
    thread.join(30)
    seconds = [json.loads(line) for line in lines]
    numbers = [second["seq"] for second in seconds]
    assert numbers == list(range(numbers[0], numbers[0] + 20))
    pressure = told.history(["pressure_high"])["pressure_high"]
    assert [second["values"]["pressure_high"] for second in seconds] == pressure[numbers].tolist()


@pytest.mark.slow
def test_500_readings_a_second_through_kills_are_each_followed_once(service, running, broker):
    """The broker is killed and stopped, the command is killed: every reading is stored, and the result is the same."""
    seconds = 400
    sent = batches(seconds, 1)
    twin = ordered(service, "killed")
    command = [HRS, "mqtt", "subscribe", "killed", broker.url, "--topic", "plant/+", "--url", running.url]
    subscriber = subprocess.Popen(command)
    wait_until(lambda: _connections(broker) >= 1)
    gateway = Gateway(broker)
    for number, batch in enumerate(sent):
        began = time.monotonic()
        gateway.publish("plant/second", rows(batch))
        if number in {100, 250}:
            broker.kill() if number == 100 else broker.stop()
            time.sleep(1.0)
            broker.start()
        if number == 180:
            subscriber.kill()
            subscriber.wait()
            subscriber = subprocess.Popen(command)
            wait_until(lambda: _connections(broker) >= 2)  # the gateway is there, too; it would end without a broker
        time.sleep(max(0.0, 0.034 - (time.monotonic() - began)))  # 17 readings: 500 a second
    try:
        wait_until(lambda: twin.state()["samples"] >= seconds - 10)
    except AssertionError:
        print("stored", twin.state()["samples"], service.get("/v1/twins/killed/measurements"))
        raise
    finally:
        subscriber.send_signal(signal.SIGINT)
        subscriber.wait(20)
    subscriber.send_signal(signal.SIGINT)
    assert subscriber.wait(20) == 0
    twin.stop()
    found, expected = rows_as_followed(running, "killed"), followed(sent, finish=True)
    assert found.shape == expected.shape
    assert np.array_equal(found, expected, equal_nan=True)
    gateway.close()


def _connections(broker):
    """Connections to the broker's port that are established."""
    with open("/proc/net/tcp", encoding="ascii") as table:  # noqa: PTH123  # of the kernel, no file of ours
        lines = table.read().splitlines()[1:]
    return sum(line.split()[1].endswith(f":{broker.port:04X}") and line.split()[3] == "01" for line in lines)


@pytest.mark.parametrize(
    ("topic", "payload", "expected"),
    [
        ("plant/PT-101", b"812.5", [{"tag": "PT-101", "time": 9.0, "value": 812.5}]),
        ("plant/V-1", b"true", [{"tag": "V-1", "time": 9.0, "value": True}]),
        ("plant/V-1", b"null", [{"tag": "V-1", "time": 9.0, "value": None}]),
        ("a", b'{"value": 1, "time": 2.5}', [{"tag": "a", "time": 2.5, "value": 1}]),
        ("a/b", b'[{"tag": "x", "value": 1, "quality": "bad"}, 3]',
         [{"tag": "x", "time": 9.0, "value": 1, "quality": "bad"}, {"tag": "b", "time": 9.0, "value": 3}]),
        ("a", b'{"samples": [{"tag": "x", "time": 1, "value": 2}]}', [{"tag": "x", "time": 1, "value": 2}]),
    ],
)  # fmt: skip
def test_forms_of_a_message(topic, payload, expected):
    assert rows_of(topic, payload, 9.0) == expected


@pytest.mark.parametrize("payload", [b"", b"{", b'"text"', b'[["nested"]]', b"\xff\xfe"])
def test_what_is_no_reading_is_refused(payload):
    with pytest.raises(ValueError, match=r"."):
        rows_of("a", payload, 0.0)
