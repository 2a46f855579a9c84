"""Messages on their way to a broker: what it has acknowledged, what not, and what is told again after a break."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

import orjson
from paho.mqtt.client import Client
from paho.mqtt.enums import MQTTErrorCode

from api.bridges.mqtt.broker import CONNECT_S, IN_FLIGHT_MAX, BrokerError, disconnect

QOS = 1
"""At least once: a message counts as sent when the broker has acknowledged it."""

AGAIN_S = 5.0
"""What was acknowledged so shortly before a connection broke is told again: a broker that was killed may have lost
what it had taken [s]."""

RECENT_MAX = 10_000
"""Of these at most so many: a subscriber that was away long is told faster than a twin runs."""

WAIT_S = 0.1
"""How often a full outbox looks whether it shall end [s]."""

PAUSE_S = 1.0
"""Between attempts to reach a broker that is away [s]."""


class _Sent(NamedTuple):
    """A message, and the place after it that is reached once all up to it are acknowledged."""

    topic: str
    document: dict[str, Any]
    place: Any


class Outbox:
    """Sends documents with QoS 1, at most IN_FLIGHT_MAX unacknowledged ones.

    Each document is given `repeated`: whether it may have come before. When a connection breaks a new one is made, and
    what was not acknowledged is sent again, marked: the client library would send it again as it was, and no broker
    hands on its flag.

    Parameters
    ----------
    make
        Makes a client of the broker, not connected yet.
    connect_to
        Connects it.
    connected
        Called at each connection with the client: to announce who is there.
    """

    def __init__(
        self, make: Callable[[], Client], connect_to: Callable[[Client], None], connected: Callable[[Client], None]
    ) -> None:  # fmt: skip
        self._make, self._connect_to, self._connected = make, connect_to, connected
        self._changed = threading.Condition()
        self._client: Client | None = None
        self._pending: dict[int, _Sent] = {}  # by message id, in the order they were sent
        self._early: set[int] = set()  # acknowledged before `publish` had said their id
        self._recent: deque[tuple[float, _Sent]] = deque(maxlen=RECENT_MAX)
        self._place: Any = None
        self._state = ""  # of the connection: "", "there", "broken", or why the broker refuses

    def open(self) -> None:
        """Connect for the first time.

        Raises
        ------
        BrokerError
            if nobody answers there, or the broker refuses.
        """
        client = self._client = self._make()
        self._state = ""
        self._pending, self._early = {}, set()
        client.on_connect, client.on_disconnect = self._on_connect, self._on_disconnect
        client.on_publish = self._on_publish
        self._connect_to(client)
        with self._changed:
            self._changed.wait_for(lambda: self._state, CONNECT_S)
            if self._state != "there":
                raise BrokerError(f"the broker refuses: {self._state or f'no answer within {CONNECT_S:g} s'}")
        self._connected(client)

    def with_client(self, act: Callable[[Client], None]) -> None:
        """Do something with the client, where there is a connection."""
        if self._client is not None and self._state == "there":
            act(self._client)

    def close(self) -> None:
        """Leave the broker."""
        if self._client is not None:
            disconnect(self._client)

    def _on_connect(self, client: Client, _data: Any, _flags: Any, reason: Any, _properties: Any) -> None:
        with self._changed:
            if client is self._client:
                self._state = str(reason) if reason.is_failure else "there"
                self._changed.notify_all()

    def _on_disconnect(self, client: Client, *_: Any) -> None:
        with self._changed:
            if client is self._client and self._state == "there":
                self._state = "broken"
                self._changed.notify_all()

    def _on_publish(self, client: Client, _data: Any, mid: int, _reason: Any, _properties: Any) -> None:
        with self._changed:
            if client is not self._client:
                return
            if mid in self._pending:
                self._take(mid)
            else:
                self._early.add(mid)
            self._changed.notify_all()

    def _take(self, mid: int) -> None:
        """Note that the broker has a message."""
        first = next(iter(self._pending)) == mid
        sent = self._pending.pop(mid)
        now = time.monotonic()
        self._recent.append((now, sent))
        while self._recent[0][0] < now - AGAIN_S:
            self._recent.popleft()
        if first and sent.place is not None:
            self._place = sent.place

    @property
    def place(self) -> Any:
        """The place up to which all has been acknowledged; None: none yet."""
        with self._changed:
            return self._place

    def send(self, topic: str, document: dict[str, Any], place: Any, ending: threading.Event) -> None:
        """Send a document as soon as there is room. `place` is reached when it, and all before it, are acknowledged.

        Nothing is sent once `ending` is set.

        Raises
        ------
        BrokerError
            if the broker does not take it.
        """
        with self._changed:
            while self._state == "there" and len(self._pending) >= IN_FLIGHT_MAX and not ending.is_set():
                self._changed.wait(WAIT_S)
        self.mend(ending)
        if not ending.is_set():
            self._send(_Sent(topic, document, place), repeated=False)

    def mend(self, ending: threading.Event) -> None:
        """Make a connection that is broken anew, until there is one or `ending` is set, and tell again what is due."""
        while self._state != "there" and not ending.is_set():
            with self._changed:
                unsent = list(self._pending.values())
                recent = [sent._replace(place=None) for _, sent in self._recent]
            self.close()
            try:
                self.open()
            except BrokerError:
                self._pending = dict(enumerate(unsent))  # of no client: to be sent by the next
                ending.wait(PAUSE_S)
                continue
            for sent in (*recent, *unsent):
                self._send(sent, repeated=True)

    def _send(self, sent: _Sent, *, repeated: bool) -> None:
        if self._client is None:
            raise AssertionError("open() comes first")
        info = self._client.publish(sent.topic, orjson.dumps({**sent.document, "repeated": repeated}), QOS)
        if info.rc not in {MQTTErrorCode.MQTT_ERR_SUCCESS, MQTTErrorCode.MQTT_ERR_NO_CONN}:
            raise BrokerError(f"a message to {sent.topic} cannot be sent: {info.rc!r}")
        with self._changed:
            self._pending[info.mid] = sent
            if info.mid in self._early:
                self._take(info.mid)
            self._early.clear()  # of messages that are not ours, whose ids come again

    def flush(self, seconds: float, ending: threading.Event) -> bool:
        """Wait until everything is acknowledged; False if that takes longer."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self.mend(ending)
            with self._changed:
                if self._changed.wait_for(lambda: not self._pending or self._state != "there", WAIT_S) and (
                    not self._pending
                ):
                    return True
            if ending.is_set() and self._state != "there":
                break
        return not self._pending
