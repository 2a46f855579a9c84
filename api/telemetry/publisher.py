"""Samples and events of twins, published; queries about them, declared."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import orjson
import zenoh

from api.telemetry.queries import QueryHandler, QueryHandlers, QueryWorker
from api.telemetry.session import PRIORITY
from api.telemetry.topics import ALARMS, ALIVE, COMMAND, EVENT, HISTORY, MEASUREMENT, SAMPLE, SIGNAL, key
from api.twins.messages import Event, Sample, signals
from api.twins.service import Twins

log = logging.getLogger(__name__)

LOOK_EVERY_S = 0.5
"""How often it is looked whether anybody subscribes to single signals [s]."""

_QUALITY: dict[str, Any] = {
    "encoding": zenoh.Encoding.APPLICATION_JSON,
    "congestion_control": zenoh.CongestionControl.DROP,  # a subscriber that stands still must not stop the twin
    "priority": PRIORITY,
    "express": True,
}

_TOGETHER: dict[str, Any] = {**_QUALITY, "express": False}
"""Of signals: one by one, those of a single sample would be more batches than fit into a subscriber's queue."""


_GONE = "not published: %s"
"""A session that has gone must not end a twin: it may outlive its telemetry when the service ends in a hurry."""


@dataclass
class _Channel:
    """The declarations of one twin."""

    sample: zenoh.Publisher
    event: zenoh.Publisher
    signals: zenoh.Publisher  # never put to: it tells whether anybody subscribes to a signal
    others: list[Any] = field(default_factory=list)
    looked: float = 0.0  # monotonic [s]
    wanted: bool = False

    def undeclare(self) -> None:
        """Take everything back."""
        for declared in (self.sample, self.event, self.signals, *self.others):
            declared.undeclare()


class Telemetry:
    """The observer that publishes a server's twins on a session, and answers queries about them."""

    def __init__(self, session: zenoh.Session, twins: Twins, on_dropped: Callable[[], None] = lambda: None) -> None:
        self._on_dropped = on_dropped
        self._lock = threading.Lock()  # of what is declared; samples and events are published without it
        self._channels: dict[str, _Channel | None] = {}  # None while there is no session to declare in
        self._answers = QueryHandlers(twins)
        self._of_all: list[Any] = []
        self._use(session)

    def _use(self, session: zenoh.Session) -> None:
        self._session = session
        # What was told can be asked for when a twin has ended, too.
        self._of_all = [
            self._answer(key("*", EVENT), self._answers.events),
            self._answer(key("*", HISTORY), self._answers.history),
        ]

    def rebind(self, reopen: Callable[[], zenoh.Session]) -> None:
        """Go on in another session; `reopen` ends the one there is. Where it raises, `move` may be called again."""
        with self._lock:
            self._channels = dict.fromkeys(self._channels)
            self._use(reopen())
            self._channels = {twin: self._declared(twin) for twin in self._channels}

    def close(self) -> None:
        """Take back what is declared, and stop answering."""
        for twin in list(self._channels):
            self.closed(twin)
        with self._lock:
            while self._of_all:
                self._of_all.pop().undeclare()
        self._answers.close()

    def opened(self, twin: str) -> None:
        """Declare a twin's keys."""
        with self._lock:
            self._channels[twin] = None if self._session.is_closed() else self._declared(twin)

    def _declared(self, twin: str) -> _Channel:
        declare = self._session.declare_publisher
        channel = _Channel(
            declare(key(twin, SAMPLE), **_QUALITY),
            declare(key(twin, EVENT), **_QUALITY),
            declare(key(twin, SIGNAL, "*"), **_QUALITY),
        )
        answers = self._answers
        channel.others.append(self._answer(key(twin, SAMPLE), lambda query: answers.sample(twin, query)))
        channel.others.append(self._answer(key(twin, SIGNAL, "*"), lambda query: answers.signals(twin, query)))
        channel.others.append(self._answer(key(twin, ALARMS), lambda query: answers.alarms(twin, query)))
        obey = self._answer(key(twin, COMMAND), lambda query: answers.command(twin, query), answers.commands)
        channel.others.append(obey)
        take = self._answer(
            key(twin, MEASUREMENT), lambda query: answers.measurement(twin, query), answers.measurements
        )  # fmt: skip
        channel.others.append(take)
        channel.others.append(self._session.liveliness().declare_token(key(twin, ALIVE)))
        return channel

    def _answer(self, name: str, answer: QueryHandler, line: QueryWorker | None = None) -> Any:
        line = line or self._answers.questions

        def hand_over(query: zenoh.Query) -> None:
            line.put(query, answer)

        return self._session.declare_queryable(name, hand_over)

    def sample(self, sample: Sample) -> None:
        """Publish a sample, and its signals one by one if anybody subscribes to any."""
        channel = self._channels.get(sample.twin)
        if channel is not None:
            try:
                self._put(channel, sample)
            except zenoh.ZError as error:
                self._on_dropped()
                log.debug(_GONE, error)

    def _put(self, channel: _Channel, sample: Sample) -> None:
        channel.sample.put(orjson.dumps(sample.document()))
        now = time.monotonic()
        if now - channel.looked >= LOOK_EVERY_S:
            channel.looked = now
            channel.wanted = _matches(channel.signals)
        if channel.wanted:
            for name, document in signals(sample):
                self._session.put(key(sample.twin, SIGNAL, name), orjson.dumps(document), **_TOGETHER)

    def event(self, event: Event) -> None:
        """Publish an event."""
        channel = self._channels.get(event.twin)
        if channel is not None:
            try:
                channel.event.put(orjson.dumps(event.document()))
            except zenoh.ZError as error:
                log.debug(_GONE, error)

    def subscribed(self) -> int:
        """How many twins anybody subscribes to the samples of."""
        return sum(_matches(channel.sample) for channel in list(self._channels.values()) if channel is not None)

    def closed(self, twin: str) -> None:
        """Take a twin's keys back."""
        with self._lock:
            channel = self._channels.pop(twin, None)
            if channel is not None:
                channel.undeclare()


def _matches(publisher: zenoh.Publisher) -> bool:
    """Whether anybody subscribes; eclipse-zenoh gives an object, which is always true, where its stubs say `bool`."""
    try:
        status = publisher.matching_status
    except zenoh.ZError:  # of a session that was closed meanwhile
        return False
    return bool(getattr(status, "matching", status))
