"""A live twin's seconds and events on a broker as JSON, complete and in order.

Whoever was away, service, broker or this program, goes on where the broker has acknowledged the last message.
"""

from __future__ import annotations

import logging
import threading
from pathlib import Path
from typing import Any

import orjson
from paho.mqtt.client import Client

from api.bridges.mqtt.broker import Broker, client_of, connect
from api.bridges.mqtt.commands import CommandWorker, check_allowed
from api.bridges.mqtt.history import History, Second
from api.bridges.mqtt.outbox import QOS, Outbox
from api.client import Twin
from api.telemetry.topics import ALIVE, COMMAND, EVENT, SAMPLE, key
from api.twins.messages import VERSION

log = logging.getLogger(__name__)

POLL_S = 0.5
"""How often the service is asked what there is to tell [s]."""

ANSWER = "answer"
"""Last level of the topic on which commands are answered."""

FLUSH_S = 30.0
"""How long the last messages may take to be acknowledged [s]."""


class Publisher:
    """Tells what a twin tells to a broker, under the keys that it has on zenoh.

    Parameters
    ----------
    twin
        To be followed.
    broker
        That is told.
    file
        Keeps how far the broker has acknowledged; left out: each start begins with the newest second and the next
        event.
    commands
        Whether commands from the broker are obeyed; the client's key must have the scope `operate` for them.

    Raises
    ------
    StationError
        if commands are to be obeyed and the key may not operate twins.
    """

    def __init__(self, twin: Twin, broker: Broker, file: Path | None = None, *, commands: bool = False) -> None:
        self._twin, self._broker, self._file = twin, broker, file
        self._outbox = Outbox(self._made, lambda client: connect(client, broker), self._greet)
        self._commands = CommandWorker(twin, self._reply) if commands else None
        if commands:
            check_allowed(twin)

    def _made(self) -> Client:
        client = client_of(self._broker, f"hrs-publish-{self._twin.id}", keeps_session=False, reconnects=False)
        client.will_set(self._topic(ALIVE), b"offline", QOS, retain=True)
        if self._commands is not None:
            client.on_message, client.on_subscribe = self._commands.on_message, _warn_refused
        return client

    def _greet(self, client: Client) -> None:
        """Say who is there; commands are asked for first, so that who hears it may send some."""
        if self._commands is not None:
            client.subscribe(self._topic(COMMAND), QOS)
        self._announce(client)

    def _reply(self, document: dict[str, Any]) -> None:
        """Answer a command, where there is a connection."""
        content = orjson.dumps(document)

        def publish(client: Client) -> None:
            client.publish(f"{self._topic(COMMAND)}/{ANSWER}", content, QOS)

        self._outbox.with_client(publish)

    def _topic(self, kind: str) -> str:
        return key(self._twin.id, kind)

    def _announce(self, client: Client, state: bytes = b"online") -> None:
        client.publish(self._topic(ALIVE), state, QOS, retain=True).wait_for_publish(1.0)

    def run(self, ending: threading.Event) -> bool:
        """Tell until the twin has ended, or until `ending` is set; whether all was acknowledged.

        Raises
        ------
        StationError
            if the service or the broker refuses, or cannot be reached at first.
        """
        history = History(self._twin, self._file)
        if self._commands is not None:
            self._commands.start()
        try:
            self._outbox.open()
            while not ending.is_set():
                over, told = history.is_over(), self._tell(history, ending)
                history.keep(self._outbox.place)
                if over and not told:
                    break
                if not told:
                    self._outbox.mend(ending)
                    ending.wait(POLL_S)
            whole = self._outbox.flush(FLUSH_S, ending)
            history.keep(self._outbox.place)
            self._outbox.with_client(lambda client: self._announce(client, b"offline"))
        finally:
            if self._commands is not None:
                self._commands.close()
            self._outbox.close()
        return whole

    def _tell(self, history: History, ending: threading.Event) -> int:
        """Send what there is to tell; how many messages."""
        count = 0
        for event in history.events():
            self._outbox.send(self._topic(EVENT), event, history.place, ending)
            count += 1
        for second in history.seconds():
            self._outbox.send(self._topic(SAMPLE), self._document(second), history.place, ending)
            count += 1
        return count

    def _document(self, second: Second) -> dict[str, Any]:
        """A second as telemetry has it."""
        return {
            "version": VERSION, "twin": self._twin.id, "epoch": second.epoch, "seq": second.seq,
            "values": second.values,
        }  # fmt: skip


def _warn_refused(_client: Client, _data: Any, _mid: int, reasons: Any, _properties: Any) -> None:
    """Say that a broker does not let commands come."""
    if any(reason.is_failure for reason in reasons):
        log.warning("the broker gives no commands: it refuses the subscription to them")
