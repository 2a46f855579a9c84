"""Nodes of a plant's server: every change, in order, once, through kills of the server."""

from __future__ import annotations

import asyncio
import json
import threading

import numpy as np
import pytest

from api.bridges.opcua.endpoint import Endpoint, OpcUaError
from api.bridges.opcua.follow import Follower, nodes_of
from api.bridges.opcua.reader import NodeReader, Peer
from station import InputError
from station.measurement import TagMap
from tests.api.conftest import free_port
from tests.api.measured import BEGIN, NAMES, ORDER, TAGS, batches, followed, readings
from tests.api.test_measurements import _rows
from tests.waiting import wait_until

WITH_NODES = {"tags": [{**tag, "node": f"nsu=urn:plant;s={tag['column']}"} for tag in TAGS["tags"]]}


def peer_of(url):
    return Peer.of(Endpoint.parse("--from", url))


def random_values(nodes, ticks):
    rng = np.random.default_rng(29)
    return {f"N{node}": rng.uniform(0.0, 100.0, ticks).tolist() for node in range(nodes)}


class Reading:
    """A reader of a plant's nodes in a thread of its own."""

    def __init__(self, plant, names, *, timeout_s=10.0) -> None:
        self.heard = {name: [] for name in names}
        self.silences = 0
        self.ending = threading.Event()
        nodes = {name: f"ns=2;s={name}" for name in names}
        self.reader = NodeReader(peer_of(plant.url), nodes, self._take, self._silent, timeout_s)
        self.thread = threading.Thread(target=self._run)
        self.thread.start()

    def _run(self):
        with asyncio.Runner() as runner:
            runner.run(self.reader.run(self.ending))

    async def _take(self, found):
        for reading in found:
            self.heard[reading.tag].append(reading)

    async def _silent(self):
        self.silences += 1

    def end(self):
        self.ending.set()
        self.thread.join(30)
        assert not self.thread.is_alive()


def check_complete(plant, values, heard):
    """Every tick from the first that was heard to the last, once, in order, with its value."""
    for name, expected in values.items():
        ticks = [plant.tick(reading.time) for reading in heard[name]]
        assert ticks == list(range(ticks[0], len(expected))), name
        assert [reading.value for reading in heard[name]] == expected[ticks[0] :]


def follow_through_kills(plant, values, kills, away):
    """A plant whose server is killed at some ticks and started again `away` ticks later."""
    made = plant(values, every_s=0.1, step_s=0.1)
    reading = Reading(made, list(values))
    first = next(iter(values))
    for kill in kills:
        wait_until(lambda kill=kill: reading.heard[first] and made.tick(reading.heard[first][-1].time) >= kill)
        made.kill()
        threading.Event().wait(away * 0.1)
        made.start()
    last = len(values[first]) - 1
    wait_until(lambda: all(told and made.tick(told[-1].time) >= last for told in reading.heard.values()), 120)
    wait_until(lambda: reading.reader.connections == 1 + len(kills))  # where all was heard before the last kill
    reading.end()
    check_complete(made, values, reading.heard)
    return reading


@pytest.mark.slow
def test_every_change_is_seen_through_a_kill_of_the_server(plant):
    follow_through_kills(plant, random_values(60, 40), kills=[8], away=2)


@pytest.mark.full
def test_60_nodes_at_10_hz_through_kills_have_no_hole(plant):
    reading = follow_through_kills(plant, random_values(60, 300), kills=[60, 160], away=20)
    assert sum(map(len, reading.heard.values())) > 60 * 250


@pytest.mark.slow
def test_a_server_without_history_leaves_a_hole_and_goes_on(plant):
    values = random_values(2, 25)
    made = plant(values, every_s=0.1, step_s=0.1, history=False)
    reading = Reading(made, list(values), timeout_s=0.1)
    wait_until(lambda: reading.heard["N0"])
    made.kill()
    wait_until(lambda: reading.silences == 1)
    made.start()
    wait_until(lambda: reading.reader.connections == 2)
    wait_until(lambda: all(told[-1].value == values[name][-1] for name, told in reading.heard.items()))
    reading.end()
    assert reading.silences == 1
    ticks = [made.tick(told.time) for told in reading.heard["N1"]]
    assert ticks == sorted(set(ticks))


class Following:
    """A follower in a thread of its own, of the station of `tests.api.measured`."""

    def __init__(self, service, twin, url, place, *, timeout_s=10.0) -> None:
        self.ending = threading.Event()
        tags = TagMap.model_validate(WITH_NODES)
        self.follower = Follower(service, twin, peer_of(url), tags, "opcua", timeout_s, place)
        self.thread = threading.Thread(target=self.follower.run, args=(self.ending,))
        self.thread.start()

    def end(self):
        self.ending.set()
        self.thread.join(30)
        assert not self.thread.is_alive()


def station_values(seconds):
    """The readings of `tests.api.measured` by node; null where there is none."""
    _, _, value = readings(seconds)
    table = value.reshape(seconds, len(NAMES))
    return {
        name: [None if np.isnan(each) else each for each in table[:, column].tolist()]
        for column, name in enumerate(NAMES)
    }


def from_the_start(tmp_path):
    """A place before the first reading: the server's history is read from its begin."""
    place = tmp_path / "place.json"
    place.write_text(json.dumps({f"T.{name}": BEGIN - 1.0 for name in NAMES}))
    return place


def rows_as_followed(running, twin):
    import httpx

    with httpx.Client(base_url=running.url, trust_env=False) as http:
        return _rows(http, f"/v1/twins/{twin}")


@pytest.mark.slow
def test_readings_are_followed_as_those_that_are_sent(service, running, plant, tmp_path):
    seconds = 80
    made = plant(station_values(seconds), every_s=0.02, step_s=1.0, stamp=BEGIN + 0.1)
    twin = service.start(**{**ORDER, "id": "followed"})
    place = from_the_start(tmp_path)
    following = Following(service, "followed", made.url, place)
    wait_until(lambda: following.follower.counts.stored >= 20 * len(NAMES))
    following.end()  # and another goes on where it was
    again = Following(service, "followed", made.url, place)
    total = seconds * len(NAMES)
    wait_until(lambda: following.follower.counts.stored + again.follower.counts.stored >= total)
    again.end()
    assert following.follower.counts.stored + again.follower.counts.stored == total
    wait_until(lambda: twin.state()["samples"] >= seconds - 10)
    twin.stop()
    assert rows_as_followed(running, "followed").tobytes() == followed(batches(seconds), finish=True).tobytes()


@pytest.mark.slow
def test_a_server_that_is_away_has_bad_readings(service, plant, tmp_path):
    made = plant(station_values(10), every_s=0.02, step_s=1.0, stamp=BEGIN + 0.1)
    twin = service.start(**{**ORDER, "id": "silent"})
    following = Following(service, "silent", made.url, from_the_start(tmp_path), timeout_s=0.1)
    wait_until(lambda: following.follower.counts.stored == 10 * len(NAMES))
    made.kill()
    wait_until(lambda: following.follower.counts.silences == 1)
    wait_until(lambda: following.follower.counts.stored == 11 * len(NAMES))
    following.end()
    twin.stop()


@pytest.mark.slow
def test_what_cannot_be_followed_is_named(service, plant):
    service.start(**{**ORDER, "id": "wrong"})
    made = plant({"vehicle": [0.0]}, every_s=1.0, step_s=1.0)
    tags = TagMap.model_validate(WITH_NODES)
    with pytest.raises(OpcUaError, match=r"does not tell nsu=urn:plant;s=pressure_high of tag T.pressure_high"):
        Follower(service, "wrong", peer_of(made.url), tags, "opcua", 10.0).run(threading.Event())
    elsewhere = {"tags": [{**tag, "node": "nsu=urn:other;i=7"} if tag["column"] == "vehicle" else tag
                          for tag in TAGS["tags"]]}  # fmt: skip
    with pytest.raises(OpcUaError, match="has no namespace urn:other"):
        Follower(service, "wrong", peer_of(made.url), TagMap.model_validate(elsewhere), "opcua", 10.0).run(
            threading.Event()
        )
    nobody = f"opc.tcp://127.0.0.1:{free_port()}"
    with pytest.raises(OpcUaError, match=f"no server can be followed at {nobody}"):
        Follower(service, "wrong", peer_of(nobody), tags, "opcua", 10.0).run(threading.Event())


@pytest.mark.parametrize(
    ("node", "message"),
    [
        ("PT-101", r"tags\[0\].node: must be the id of a node"),
        ("ns=x;s=PT", r"tags\[0\].node: must be the id of a node"),
        ("ns=2;s=vehicle", r"must be no other tag's"),
        (None, "must give at least one tag a node"),
    ],
)
def test_nodes_that_are_wrong_are_refused(node, message):
    last = {"node": "ns=2;s=vehicle"} if node else {}
    tags = [{**tag, **last} if tag["column"] == "vehicle" else tag for tag in TAGS["tags"]]
    tags[0] = {**tags[0], "node": node}
    with pytest.raises(InputError, match=message):
        nodes_of(TagMap.model_validate({"tags": tags}))


def test_a_place_that_cannot_be_read_is_refused(service, tmp_path):
    place = tmp_path / "place.json"
    place.write_text("[]")
    with pytest.raises(InputError, match="cannot be read"):
        Follower(service, "any", peer_of("opc.tcp://127.0.0.1"), TagMap.model_validate(WITH_NODES), "a", 1.0, place)
