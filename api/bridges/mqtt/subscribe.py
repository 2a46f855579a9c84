"""Measurements from a broker, stored for a measured twin before the broker may forget them."""

from __future__ import annotations

import logging
import queue
import threading
import time
from dataclasses import dataclass
from typing import Any, NamedTuple

import orjson
from paho.mqtt.client import Client as MqttClient
from paho.mqtt.client import MQTTMessage

from api.bridges.measurements import ROWS_MAX, MeasurementSender
from api.bridges.mqtt.broker import CONNECT_S, Broker, BrokerError, client_of, connect, disconnect
from api.bridges.mqtt.outbox import QOS
from api.client import Client
from station import InputError

log = logging.getLogger(__name__)

GATHER_S = 0.02
"""Messages that come within this are one batch; longer, and a broker that has 20 unacknowledged ones waits [s]."""

LOOK_S = 0.2
"""How often it is looked whether to end [s]."""


TOPIC_BYTES_MAX = 65_535
"""Of a topic or filter, by the standard."""


@dataclass
class Counts:
    """Messages and readings since the start."""

    messages: int = 0
    stored: int = 0  # readings
    again: int = 0  # messages that the broker flags as sent before
    refused: int = 0  # messages that are no readings of the twin


class _Received(NamedTuple):
    """A message that is not acknowledged yet."""

    mid: int
    connection: int  # over which it came: its number
    topic: str
    payload: bytes
    again: bool  # flagged as a duplicate by the broker
    time: float  # of its arrival, Unix time [s]


def check_filter(topic: str) -> None:
    """Raise InputError for a filter that MQTT has not: `#` ends one, and it and `+` are levels of their own."""
    levels = topic.split("/")
    wild = [level for level in levels if set(level) & set("#+")]
    whole = all(level in ("#", "+") for level in wild) and "#" not in levels[:-1]
    if not topic or not whole or "\0" in topic or len(topic.encode(errors="replace")) > TOPIC_BYTES_MAX:
        message = f"must be a filter of MQTT, as plant/+ or plant/#; given {topic!r:.100}"
        raise InputError("mqtt", [("--topic", message)])


def rows_of(topic: str, payload: bytes, received: float) -> list[dict[str, Any]]:
    """Readings of a message, as `POST /v1/twins/{id}/measurements` takes them.

    It is a JSON object with `tag`, `time`, `value` and `quality`, a list of such, an object that has the list as
    `samples`, or a value alone. Without `tag` it is the topic's last level, without `time` that of its arrival.

    Raises
    ------
    ValueError
        if it is something else.
    """
    found = orjson.loads(payload)
    if isinstance(found, dict) and isinstance(found.get("samples"), list):
        found = found["samples"]
    rows = found if isinstance(found, list) else [found]
    usual = {"tag": topic.rpartition("/")[2], "time": received}
    complete = []
    for row in rows:
        if isinstance(row, dict):
            complete.append({**usual, **row})
        elif row is None or isinstance(row, bool | int | float):
            complete.append({**usual, "value": row})
        else:
            raise ValueError(f"a reading must be an object or a number; given {row!r:.50}")
    return complete


class Subscriber:
    """Stores what a broker sends under a topic as readings of a measured twin.

    A message is acknowledged when the service has stored it, so that a broker that keeps sessions loses none while the
    service or this program is away. One that comes again because its acknowledgement was lost is stored again; whoever
    follows the readings takes each tag and time once.

    Parameters
    ----------
    client
        Of the service.
    twin
        Id of the twin.
    broker
        That is listened to.
    topic
        Filter of its topics.
    source
        Under which name the service counts batches; also names the session at the broker.

    Raises
    ------
    InputError
        if the topic is no filter of MQTT.
    StationError
        if there is no such measured twin, or the service does not answer.
    """

    def __init__(self, client: Client, twin: str, broker: Broker, topic: str, source: str) -> None:
        check_filter(topic)
        self._sender = MeasurementSender(client, twin, source)
        self._topic, self._broker = topic, broker
        self._received: queue.SimpleQueue[_Received] = queue.SimpleQueue()
        self._ready = threading.Event()
        self._refusal = ""
        self._connection = 0
        self.counts = Counts()
        self._client: MqttClient = client_of(broker, f"hrs-{source}", manual_ack=True)
        self._client.on_connect = self._on_connect
        self._client.on_subscribe = self._on_subscribe
        self._client.on_message = self._on_message

    def _on_connect(self, client: MqttClient, _data: Any, _flags: Any, reason: Any, _properties: Any) -> None:
        if reason.is_failure:
            self._refusal = str(reason)
            self._ready.set()
        else:
            self._connection += 1
            client.subscribe(self._topic, QOS)  # a broker that was killed may have lost the session

    def _on_subscribe(self, _client: Any, _data: Any, _mid: int, reasons: Any, _properties: Any) -> None:
        if any(reason.is_failure for reason in reasons):
            self._refusal = f"it does not give {self._topic!r}"
        self._ready.set()

    def _on_message(self, _client: Any, _data: Any, message: MQTTMessage) -> None:
        told = _Received(message.mid, self._connection, message.topic, bytes(message.payload), message.dup, time.time())
        self._received.put(told)

    def run(self, ending: threading.Event) -> None:
        """Store what comes, until `ending` is set.

        Raises
        ------
        StationError
            if the service or the broker refuses, or cannot be reached at first.
        """
        connect(self._client, self._broker)
        try:
            if not self._ready.wait(CONNECT_S) or self._refusal:
                raise BrokerError(f"the broker refuses: {self._refusal or f'no answer within {CONNECT_S:g} s'}")
            while not ending.is_set():
                messages = self._gathered()
                if messages:
                    self._store(messages)
        finally:
            disconnect(self._client)

    def _gathered(self) -> list[_Received]:
        """Messages that come together; none where none comes."""
        found: list[_Received] = []
        try:
            while len(found) < ROWS_MAX:
                found.append(self._received.get(timeout=GATHER_S if found else LOOK_S))
        except queue.Empty:
            pass
        return found

    def _store(self, messages: list[_Received]) -> None:
        """Store messages together, or one by one where some are refused or are too many, and acknowledge them."""
        found = [(message, rows) for message in messages if (rows := self._rows(message))]
        together = [row for _, rows in found for row in rows]
        if 0 < len(together) <= ROWS_MAX:
            try:
                self._send(together)
            except InputError:
                self._store_each(found)
        else:
            self._store_each(found)
        for message in messages:
            if message.connection == self._connection:  # over a later one its number may be another message's
                self._client.ack(message.mid, QOS)
        self.counts.messages += len(messages)
        self.counts.again += sum(message.again for message in messages)

    def _store_each(self, batch: list[tuple[_Received, list[dict[str, Any]]]]) -> None:
        """Store messages one by one, and refuse those that are no readings."""
        for message, rows in batch:
            try:
                self._send(rows)
            except InputError as error:
                self._refuse(message, str(error).replace("\n", " "))

    def _send(self, rows: list[dict[str, Any]]) -> None:
        self._sender.send(rows)
        self.counts.stored += len(rows)

    def _rows(self, message: _Received) -> list[dict[str, Any]]:
        """The readings of a message; none of one that holds something else."""
        try:
            return rows_of(message.topic, message.payload, message.time)
        except ValueError as error:
            self._refuse(message, str(error))
            return []

    def _refuse(self, message: _Received, why: str) -> None:
        self.counts.refused += 1
        log.warning("a message under %s is refused: %s", message.topic, why)
