"""A live twin as an edge node of Sparkplug B: birth, data with sequence, quality and history, death, rebirth."""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections import deque
from typing import Any

from paho.mqtt.client import Client, MQTTMessage

from api.bridges.mqtt.broker import CONNECT_S, Broker, BrokerError, client_of, connect, disconnect
from api.bridges.mqtt.commands import check_allowed
from api.bridges.mqtt.history import History
from api.bridges.mqtt.outbox import AGAIN_S, QOS
from api.bridges.mqtt.payload import BAD, BOOLEAN, DOUBLE, GOOD, INT64, STRING, Metric, decode, encode
from api.bridges.mqtt.publish import POLL_S
from api.client import Twin
from station import InputError, StationError

log = logging.getLogger(__name__)

NAMESPACE = "spBv1.0"

REBIRTH = "Node Control/Rebirth"
BIRTHS = "bdSeq"

COMMANDS = {"Command/Paused": ("paused", BOOLEAN), "Command/Speed": ("speed", DOUBLE),
            "Command/Controller": ("controller", STRING)}  # fmt: skip
"""Metrics that a host may write, each with what it changes of a twin and its data type."""

WAITING_MAX = 100
"""Commands that may wait; more are not obeyed."""

_UNKNOWN_TIME = 1e9
"""A `source_time` below this is no Unix time [s]."""

_SEQUENCES = 256


class EdgeNode:
    """A twin as the edge node `spBv1.0/{group}/.../{twin}`, its columns as metrics.

    Data go with QoS 0, as Sparkplug asks: after a connection broke, the seconds of the 5 s before are told again. They
    and all that had to wait are flagged `is_historical`; a birth tells the newest second.

    Parameters
    ----------
    twin
        To be followed, from its newest second on.
    broker
        That is told.
    group
        Group id: no `/`, `+` or `#`.
    commands
        Whether hosts may pause the twin and change its speed and controller; the client's key must have the scope
        `operate` for that.

    Raises
    ------
    InputError
        if the group's id cannot stand in a topic.
    StationError
        if commands are to be obeyed and the key may not operate twins.
    """

    def __init__(self, twin: Twin, broker: Broker, group: str, *, commands: bool = False) -> None:
        if not group or set(group) & set("/+#"):
            raise InputError(
                "mqtt", [("--sparkplug", f"must be a group without '/', '+' and '#'; given {group!r:.50}")]
            )
        if commands:
            check_allowed(twin)
        self._twin, self._broker, self._group, self._obeys = twin, broker, group, commands
        self._waiting: queue.Queue[list[Metric]] = queue.Queue(WAITING_MAX)
        self._aliases: dict[int | None, str] = {}  # of the metrics that a host may write
        self._changed = threading.Condition()
        self._births, self._is_used, self._seq = -1, True, 0
        self._connected, self._is_born, self._is_broken, self._refusal = False, False, False, ""
        self._told_at_birth = -1  # second that the last birth has told
        self._sent: deque[tuple[float, int]] = deque()  # when, which second
        self._client: Client = client_of(broker, f"hrs-sparkplug-{group}-{twin.id}", keeps_session=False)
        self._client.on_pre_connect = self._on_pre_connect
        self._client.on_connect = self._on_connect
        self._client.on_disconnect = self._on_disconnect
        self._client.on_message = self._on_message

    def _topic(self, kind: str) -> str:
        return f"{NAMESPACE}/{self._group}/{kind}/{self._twin.id}"

    def _on_pre_connect(self, client: Client, _data: Any) -> None:
        """Give the broker the death that it tells when this connection breaks."""
        if self._is_used:  # an attempt that reached no broker has told no death
            self._births, self._is_used = (self._births + 1) % _SEQUENCES, False
        client.will_set(self._topic("NDEATH"), self._death(), QOS)

    def _death(self) -> bytes:
        return encode([Metric(self._births, INT64, BIRTHS)], timestamp=_now(), seq=None)

    def _on_connect(self, client: Client, _data: Any, _flags: Any, reason: Any, _properties: Any) -> None:
        with self._changed:
            self._refusal = str(reason) if reason.is_failure else ""
            self._connected, self._is_born, self._is_used = not reason.is_failure, False, True
            self._changed.notify_all()
        if not reason.is_failure:
            client.subscribe(self._topic("NCMD"), QOS)

    def _on_disconnect(self, *_: Any) -> None:
        with self._changed:
            self._connected = self._is_born = False
            self._is_broken = True

    def _on_message(self, _client: Any, _data: Any, message: MQTTMessage) -> None:
        """A command to the node: to be born again, or metrics that a host writes."""
        try:
            metrics = decode(bytes(message.payload))
        except ValueError as error:
            log.warning("a command that is no payload of Sparkplug B is not obeyed: %s", error)
            return
        if any(metric.name == REBIRTH and metric.value is True for metric in metrics):
            with self._changed:
                self._is_born = False
        if not self._obeys or message.retain:  # a retained one was meant for who was there when it was sent
            return
        try:
            self._waiting.put_nowait(metrics)
        except queue.Full:
            log.warning("a command is not obeyed: %d are waiting", WAITING_MAX)

    def run(self, ending: threading.Event) -> None:
        """Tell until the twin has ended, or until `ending` is set.

        Raises
        ------
        StationError
            if the service or the broker refuses, or cannot be reached at first.
        """
        history = History(self._twin)
        units = history.columns()
        connect(self._client, self._broker)
        try:
            with self._changed:
                self._changed.wait_for(lambda: self._connected or self._refusal, CONNECT_S)
                if not self._connected:
                    raise BrokerError(f"the broker refuses: {self._refusal or f'no answer within {CONNECT_S:g} s'}")
            while not ending.is_set():
                self._obey()
                over, told = history.is_over(), self._tell(history, units)
                if over and not told and self._is_born:
                    break
                if not told:
                    ending.wait(POLL_S)
            self._client.publish(self._topic("NDEATH"), self._death(), QOS).wait_for_publish(1.0)
        finally:
            disconnect(self._client)

    def _tell(self, history: History, units: dict[str, str]) -> int:
        """Send the seconds that there are, after a birth where one is due; how many. Without a connection none."""
        if self._connected and not self._is_born:
            self._be_born(history, units)
        for _event in history.events():  # which move the seconds back where the service has begun anew
            pass
        count = 0
        for second in history.seconds():
            if not self._is_born:  # the connection broke, or a rebirth is asked for: this second waits
                history.place = history.place._replace(sample=second.seq)
                break
            self._seq = (self._seq + 1) % _SEQUENCES
            metrics = _metrics(
                second.values, units, _moment(second.values), historical=second.seq <= self._told_at_birth
            )
            self._client.publish(self._topic("NDATA"), encode(metrics, timestamp=_now(), seq=self._seq), 0)
            self._note(second.seq)
            count += 1
        return count

    def _obey(self) -> None:
        """Write the metrics that hosts have written, and tell what they are then."""
        while not self._waiting.empty():
            changes: dict[str, Any] = {}
            for metric in self._waiting.get():
                name = metric.name or self._aliases.get(metric.alias, "")
                if name in COMMANDS and metric.value is not None:
                    changes[COMMANDS[name][0]] = metric.value
            if not changes:
                continue
            try:
                self._twin.change(**changes)
            except StationError as error:
                log.warning("a command is refused: %s", str(error).replace("\n", " "))
            if self._is_born:
                self._seq = (self._seq + 1) % _SEQUENCES
                metrics = self._writable(self._twin.state())
                self._client.publish(self._topic("NDATA"), encode(metrics, timestamp=_now(), seq=self._seq), 0)

    def _writable(self, state: dict[str, Any], *, birth: bool = False) -> list[Metric]:
        """The metrics that a host may write, as they are in a twin's state; at birth with their names.

        A speed that is no number, `max`, is told as null.
        """
        speed = state["speed"] if isinstance(state["speed"], int | float) else None
        values = {"paused": state["state"] == "paused", "speed": speed, "controller": state["controller"]}
        aliases = {name: alias for alias, name in self._aliases.items()}
        return [
            Metric(values[field], datatype, name if birth else None, aliases[name], _now())
            for name, (field, datatype) in COMMANDS.items()
        ]

    def _note(self, seq: int) -> None:
        """Remember for a while that a second was sent."""
        now = time.monotonic()
        self._sent.append((now, seq))
        while self._sent[0][0] < now - AGAIN_S:
            self._sent.popleft()

    def _be_born(self, history: History, units: dict[str, str]) -> None:
        """Tell the newest second as a birth; the seconds that a broken connection may have lost come after it."""
        with self._changed:
            broken, self._is_broken, self._is_born = self._is_broken, False, True
        state = self._twin.state()
        values = state["values"] or {}
        told = {name: values.get(name) for name in units}
        self._told_at_birth, self._seq = state["samples"] - 1, 0
        metrics = _metrics(told, units, _moment(told), historical=False, birth=True)
        metrics += [Metric(self._births, INT64, BIRTHS), Metric(value=False, datatype=BOOLEAN, name=REBIRTH)]
        if self._obeys:
            self._aliases = {len(units) + place: name for place, name in enumerate(COMMANDS)}
            metrics += self._writable(state, birth=True)
        self._client.publish(self._topic("NBIRTH"), encode(metrics, timestamp=_now(), seq=0), 0)
        since = time.monotonic() - AGAIN_S
        recent = [seq for sent, seq in self._sent if sent >= since] if broken else []
        if recent:
            history.place = history.place._replace(sample=min(*recent, history.place.sample))


def _metrics(
    values: dict[str, Any], units: dict[str, str], stamp: int, *, historical: bool, birth: bool = False
) -> list[Metric]:  # fmt: skip
    """The metrics of a second: an alias for each column, and at birth its name and unit."""
    return [
        Metric(
            value, DOUBLE, name if birth else None, alias, stamp, historical, BAD if value is None else GOOD,
            units[name] if birth else None,
        )
        for alias, (name, value) in enumerate(values.items())
    ]  # fmt: skip


def _now() -> int:
    return round(1000 * time.time())


def _moment(values: dict[str, Any]) -> int:
    """When a second was: its measurements' time where they have one, else now [ms]."""
    source = values.get("source_time")
    return round(1000 * source) if source is not None and source > _UNKNOWN_TIME else _now()
