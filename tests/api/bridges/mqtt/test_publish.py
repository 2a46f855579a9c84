"""A twin at a broker: every second and event of its history, bit for bit, through kills of each who takes part."""

from __future__ import annotations

import json
import threading
import time

import pytest

from api.bridges.mqtt.broker import Broker, BrokerError
from api.bridges.mqtt.publish import Publisher
from api.client import Service
from station import InputError
from tests.api.bridges.mqtt.conftest import MOSQUITTO, Listener, Mosquitto
from tests.api.conftest import RunningService
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


class Publishing:
    """A publisher in a thread of its own."""

    def __init__(self, url: str, twin: str, broker: Mosquitto, place=None) -> None:
        self.ending, self.whole = threading.Event(), None
        self._asked = url, twin, Broker.parse(broker.url), place
        self.thread = threading.Thread(target=self._run)
        self.thread.start()

    def _run(self) -> None:
        url, twin, broker, place = self._asked
        with Service(url=url) as service:
            self.whole = Publisher(service.twin(twin), broker, place).run(self.ending)

    def end(self) -> None:
        self.ending.set()
        self.thread.join(30)


def samples(listener, *, repeated=False):
    """Documents of the samples heard, those told again left out unless asked for."""
    found = [(json.loads(payload), dup) for topic, payload, dup in list(listener.heard) if topic.endswith("/sample")]
    return [document for document, dup in found if repeated or not (dup or document["repeated"])]


def check_complete(listener, twin):
    """Every second of a history was heard with its figures, in order; what came twice is marked. How many there are."""
    history = twin.history().numpy()
    seconds = len(history["time"])
    heard = samples(listener, repeated=True)
    by_number = {document["seq"]: document for document in heard}
    assert sorted(by_number) == list(range(seconds))
    for name, column in history.items():
        told = [by_number[seq]["values"][name] for seq in range(seconds)]
        expected = [None if value != value else value for value in column.tolist()]  # NaN
        assert told == expected, name
    first = samples(listener)
    assert len({document["seq"] for document in first}) == len(first), "what came twice is marked"
    return seconds


@pytest.mark.slow
def test_a_twin_is_told_whole_and_who_is_there(service, running, broker):
    listener = Listener(broker, "hrs/v1/told/#")
    twin = service.start("S1", id="told", speed="max", at_end="stop", seed=3, paused=True)
    publishing = Publishing(running.url, "told", broker)
    wait_until(lambda: any(payload == b"online" for _, payload, _ in listener.heard))
    twin.change(paused=False)
    publishing.thread.join(60)
    assert publishing.whole
    wait_until(lambda: listener.heard[-1][1] == b"offline")
    assert check_complete(listener, twin) > 1000
    told = [json.loads(payload) for topic, payload, _ in listener.heard if topic.endswith("/event")]
    kept = [event for event in twin.events() if event["seq"] >= told[0]["seq"]]
    assert [{name: event[name] for name in kept[0]} for event in told] == kept
    assert told[-1]["kind"] == "finished"
    late = Listener(broker, "hrs/v1/told/alive", "late")
    wait_until(lambda: late.heard)
    assert [payload for _, payload, _ in late.heard] == [b"offline"]  # kept for who comes later
    late.close()
    listener.close()


@pytest.mark.slow
def test_a_publisher_that_ends_goes_on_where_it_was(service, running, broker, tmp_path):
    listener, place = Listener(broker, "hrs/v1/goes-on/#"), tmp_path / "place.json"
    twin = service.start("S1", id="goes-on", speed=400, at_end="repeat", paused=True)
    first = Publishing(running.url, "goes-on", broker, place)
    wait_until(lambda: listener.heard)
    twin.change(paused=False)
    wait_until(lambda: len(samples(listener)) > 100)
    first.end()
    assert json.loads(place.read_text())["sample"] > 100
    wait_until(lambda: twin.state()["samples"] > 1200)
    second = Publishing(running.url, "goes-on", broker, place)
    twin.stop()
    second.thread.join(60)
    assert second.whole
    wait_until(lambda: listener.heard[-1][1] == b"offline")  # what comes last, after all that the broker has taken
    check_complete(listener, twin)
    twin.delete()
    service.start("S1", id="goes-on", paused=True, at_end="repeat").stop()
    assert Publisher(service.twin("goes-on"), Broker.parse(broker.url), place).run(threading.Event())
    place.write_text("{}")
    with pytest.raises(InputError, match="cannot be read"):
        Publisher(service.twin("goes-on"), Broker.parse(broker.url), place).run(threading.Event())
    listener.close()


@pytest.mark.slow
def test_500_samples_a_second_through_kills_of_the_broker_are_whole(service, running, broker):
    listener = Listener(broker, "hrs/v1/fast/#")
    twin = service.start("S3", id="fast", speed=500, at_end="repeat", paused=True)
    publishing = Publishing(running.url, "fast", broker)
    wait_until(lambda: listener.heard)
    began = time.monotonic()
    twin.change(paused=False)
    # Killed after it was ended in order, a broker hands on unmarked what it had stored then: the order is this.
    for wait_s, end in ((3.0, broker.kill), (4.0, broker.kill), (4.0, broker.stop)):
        time.sleep(wait_s)
        end()
        time.sleep(1.5)
        broker.start()
    time.sleep(6.0)
    twin.change(paused=True)
    spent = time.monotonic() - began
    total = twin.state()["samples"]
    assert total / spent > 400
    wait_until(lambda: len({document["seq"] for document in samples(listener, repeated=True)}) >= total, 60)
    twin.stop()
    publishing.thread.join(60)
    assert publishing.whole
    check_complete(listener, twin)
    again = len(samples(listener, repeated=True)) - len(samples(listener))
    assert again > 0  # the kills cost something, and it is marked
    listener.close()


@pytest.mark.slow
def test_a_service_that_is_killed_is_waited_for(tmp_path, broker):
    running = RunningService(tmp_path / "data", "--workers", "0", HRS_CHECKPOINT_S="2")
    with Service(url=running.url) as service:
        twin = service.start("S1", id="killed", speed=100, at_end="repeat", paused=True)
        listener = Listener(broker, "hrs/v1/killed/#")
        publishing = Publishing(running.url, "killed", broker)
        wait_until(lambda: listener.heard)
        twin.change(paused=False)
        wait_until(lambda: len(samples(listener)) > 150)
        running.kill()
        running.start()
        wait_until(lambda: samples(listener)[-1]["epoch"] == 2)
        time.sleep(1.0)
        twin.stop()
        publishing.thread.join(60)
        history = twin.history().numpy()
        newest = {document["seq"]: document for document in samples(listener)}
        assert sorted(newest) == list(range(len(history["time"])))
        told = [newest[seq]["values"]["pressure_high"] for seq in sorted(newest)]
        assert told == history["pressure_high"].tolist()  # a later epoch's sample replaces an earlier one's
    listener.close()
    running.stop()


def test_a_broker_that_refuses_or_is_away_is_told(service, tmp_path):
    if MOSQUITTO is None:
        pytest.skip("mosquitto is not installed")
    service.start("S1", id="refused", paused=True)
    strict = Mosquitto(tmp_path, "allow_anonymous false")
    with pytest.raises(BrokerError, match="the broker refuses: Not authorized"):
        Publisher(service.twin("refused"), Broker.parse(strict.url)).run(threading.Event())
    strict.stop()
    with pytest.raises(BrokerError, match=f"no broker answers at 127.0.0.1:{strict.port}"):
        Publisher(service.twin("refused"), Broker.parse(strict.url)).run(threading.Event())


@pytest.mark.parametrize(
    ("url", "options", "message"),
    [
        ("http://127.0.0.1", {}, "must be mqtt://"),
        ("mqtt://127.0.0.1:port", {}, "must be mqtt://"),
        ("mqtt://user:secret@127.0.0.1", {}, "must hold no password"),
        ("mqtt://station.example", {}, "must be mqtts:// to another machine, or --plaintext be given"),
        ("mqtt://127.0.0.1", {"password": "x"}, "must name a user"),
    ],
)
def test_an_address_that_is_wrong_is_refused(url, options, message):
    with pytest.raises(InputError, match=message) as caught:
        Broker.parse(url, **options)
    assert "secret" not in str(caught.value)


def test_addresses_have_usual_ports():
    assert Broker.parse("mqtts://ann@station.example")[:4] == ("station.example", 8883, True, "ann")
    assert Broker.parse("mqtt://[::1]:1884")[:3] == ("::1", 1884, False)
    assert Broker.parse("mqtt://station.example", plaintext=True).port == 1883
