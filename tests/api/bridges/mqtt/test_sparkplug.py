"""A twin as an edge node of Sparkplug B, read by Google's Protocol Buffers with the message of the specification."""

from __future__ import annotations

import threading
import time

import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from api.bridges.mqtt.broker import Broker
from api.bridges.mqtt.payload import DOUBLE, INT64, Metric, encode
from api.bridges.mqtt.sparkplug import EdgeNode
from api.client import Service
from station import InputError
from tests.api.bridges.mqtt.conftest import Listener
from tests.api.conftest import RunningService
from tests.waiting import wait_until

_TYPES = descriptor_pb2.FieldDescriptorProto
FIELDS = {
    "Value": [("type", 1, "UINT32"), ("is_null", 2, "BOOL"), ("int_value", 3, "UINT32"), ("string_value", 8, "STRING")],
    "Set": [("keys", 1, "*STRING"), ("values", 2, "*Value")],
    "Metric": [
        ("name", 1, "STRING"), ("alias", 2, "UINT64"), ("timestamp", 3, "UINT64"), ("datatype", 4, "UINT32"),
        ("is_historical", 5, "BOOL"), ("is_null", 7, "BOOL"), ("properties", 9, "Set"), ("int_value", 10, "UINT32"),
        ("long_value", 11, "UINT64"), ("double_value", 13, "DOUBLE"), ("boolean_value", 14, "BOOL"),
        ("string_value", 15, "STRING"),
    ],
    "Payload": [("timestamp", 1, "UINT64"), ("metrics", 2, "*Metric"), ("seq", 3, "UINT64")],
}  # fmt: skip
"""Fields of the specification's messages that we tell."""


def _payload_class():
    file = descriptor_pb2.FileDescriptorProto(name="sparkplug.proto", package="spb", syntax="proto2")
    for name, fields in FIELDS.items():
        message = file.message_type.add(name=name)
        for field, number, kind in fields:
            label = _TYPES.LABEL_REPEATED if kind.startswith("*") else _TYPES.LABEL_OPTIONAL
            added = message.field.add(name=field, number=number, label=label)
            plain = kind.lstrip("*")
            if plain in FIELDS:
                added.type, added.type_name = _TYPES.TYPE_MESSAGE, f".spb.{plain}"
            else:
                added.type = getattr(_TYPES, f"TYPE_{plain}")
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName("spb.Payload"))


Payload = _payload_class()


def read(payload):
    return Payload.FromString(payload)


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    started = RunningService(tmp_path_factory.mktemp("sparkplug"), "--workers", "0")
    yield started
    started.stop()


def test_a_payload_is_what_another_encoder_writes():
    metrics = [
        Metric(1.5, DOUBLE, "pressure", 3, 1_700_000_000_123, historical=True, quality=192, unit="bar"),
        Metric(None, DOUBLE, alias=4, quality=0),
        Metric(-7, INT64, "count"),
    ]
    found = read(encode(metrics, timestamp=1_700_000_000_999, seq=255))
    assert (found.timestamp, found.seq, len(found.metrics)) == (1_700_000_000_999, 255, 3)
    first, second, third = found.metrics
    assert (first.name, first.alias, first.timestamp, first.double_value) == ("pressure", 3, 1_700_000_000_123, 1.5)
    assert (first.is_historical, first.datatype, list(first.properties.keys)) == (True, 10, ["Quality", "engUnit"])
    assert (first.properties.values[0].int_value, first.properties.values[1].string_value) == (192, "bar")
    assert (second.is_null, second.HasField("double_value"), second.properties.values[0].int_value) == (True, False, 0)
    assert third.long_value - 2**64 == -7
    assert not read(encode([], timestamp=1, seq=None)).HasField("seq")
    assert encode(metrics, timestamp=1_700_000_000_999, seq=255) == found.SerializeToString()


class Host:
    """A host application: names by alias from the last birth, sequences checked."""

    def __init__(self, listener) -> None:
        self.listener = listener

    def told(self):
        """Kinds and payloads."""
        return [(topic.split("/")[2], read(payload)) for topic, payload, _ in list(self.listener.heard)]

    def seconds(self):
        """Values by name of each second told as data, and which were historical; sequences have no hole."""
        found, names, expected = [], {}, None
        for kind, payload in self.told():
            if kind == "NBIRTH":
                names = {metric.alias: metric.name for metric in payload.metrics if metric.HasField("alias")}
                assert payload.seq == 0
                expected = 1
            elif kind == "NDATA":
                assert payload.seq == expected
                expected = (expected + 1) % 256
                values = {
                    names[metric.alias]: None if metric.is_null else metric.double_value for metric in payload.metrics
                }
                found.append((values, payload.metrics[0].is_historical))
        return found


def _births(host):
    return [payload for kind, payload in host.told() if kind == "NBIRTH"]


def _bdseq(payload):
    return next(metric.long_value for metric in payload.metrics if metric.name == "bdSeq")


@pytest.mark.slow
def test_a_twin_is_born_tells_its_seconds_and_dies(running, broker):
    with Service(url=running.url) as service:
        twin = service.start("S1", id="spb", speed=200, at_end="repeat", paused=True)
        listener = Listener(broker, "spBv1.0/plant/#")
        host, ending = Host(listener), threading.Event()
        node = EdgeNode(twin, Broker.parse(broker.url), "plant")
        thread = threading.Thread(target=node.run, args=(ending,))
        thread.start()
        wait_until(lambda: _births(host))
        twin.change(paused=False)
        wait_until(lambda: len(host.seconds()) > 300)
        listener.client.publish(
            "spBv1.0/plant/NCMD/spb", encode([Metric(1, 11, "Node Control/Rebirth")], timestamp=1, seq=None), 1
        )
        wait_until(lambda: len(_births(host)) == 2)
        broker.kill()
        time.sleep(1.0)
        broker.start()
        wait_until(lambda: len(_births(host)) == 3)
        wait_until(lambda: len(host.seconds()) > 900)
        twin.stop()
        thread.join(30)
        wait_until(lambda: host.told()[-1][0] == "NDEATH")
        assert [_bdseq(payload) for payload in _births(host)] == [0, 0, 1]
        assert _bdseq(host.told()[-1][1]) == 1
        units = {
            metric.name: metric.properties.values[1].string_value
            for metric in _births(host)[0].metrics
            if metric.HasField("alias")
        }
        history = twin.history()
        assert units == history.units
        columns = {name: column.tolist() for name, column in history.numpy().items()}
        told = {round(values["time"]): values for values, _ in host.seconds()}
        assert sorted(told) == list(range(len(history)))
        for seq, values in told.items():
            assert all(value is None or value == columns[name][seq] for name, value in values.items())
            assert values["pressure_high"] is not None
        assert any(historical for _, historical in host.seconds())  # what waited says so
        listener.close()


def test_a_group_that_cannot_stand_in_a_topic_is_refused():
    with pytest.raises(InputError, match="--sparkplug: must be a group without"):
        EdgeNode(None, Broker.parse("mqtt://127.0.0.1"), "a/b")
