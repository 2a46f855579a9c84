"""A twin as a server has it: what its stream tells is held in its nodes, what is older is read when it is asked for."""

from __future__ import annotations

import asyncio
import logging
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from asyncua import Node, Server, ua

from api.bridges.opcua.alarms import AlarmEvents
from api.bridges.opcua.clock import TwinClock
from api.bridges.opcua.nodes import ENDED, SILENT, TwinNodes
from api.client import AGAIN_S, Message, Twin
from api.twins.messages import EventKind, sample_columns
from station import StationError

log = logging.getLogger(__name__)

_STATE, _ENDED, _ALARMS = "state", "ended", "alarms"
"""Messages besides those of the stream: the twin's own document, that it tells nothing more, and where alarms stand."""


class ServedTwin:
    """One twin at a server.

    Parameters
    ----------
    twin
        To be served.

    Raises
    ------
    StationError
        if there is no such twin, or the service does not answer.
    """

    def __init__(self, twin: Twin) -> None:
        self.twin = twin
        state = twin.state()
        self._units = sample_columns(state["layout"])
        self.clock = TwinClock.of(state["created"], state["values"])
        self.newest = state["samples"] - 1
        self.is_reachable = True
        self._told: asyncio.Queue[Message] = asyncio.Queue()
        self.nodes: TwinNodes
        self._alarms: AlarmEvents

    async def make(self, server: Server, namespace: int) -> None:
        """Make its nodes."""
        self.nodes = TwinNodes(server, namespace, self.twin.id, self._units)
        made: Node = await self.nodes.make()
        await made.set_event_notifier([ua.EventNotifier.SubscribeToEvents])
        self._alarms = AlarmEvents(server, made)

    def listen(self, ending: threading.Event) -> threading.Thread:
        """A thread that reads the twin's stream until `ending` is set, for the loop that runs now."""
        loop = asyncio.get_running_loop()

        def tell(message: Message) -> None:
            with suppress(RuntimeError):  # the loop is closed: the server has ended
                loop.call_soon_threadsafe(self._told.put_nowait, message)

        thread = threading.Thread(target=self._read, args=(tell, ending), name=f"stream {self.twin.id}", daemon=True)
        thread.start()
        return thread

    def _read(self, tell: Callable[[Message], None], ending: threading.Event) -> None:
        while not ending.is_set():
            try:
                if self._read_stream(tell, ending):
                    return
            except StationError as error:
                tell(Message("broken", {"detail": str(error)}))
            ending.wait(AGAIN_S)

    def _read_stream(self, tell: Callable[[Message], None], ending: threading.Event) -> bool:
        """Hand on what the stream tells; whether that was all. After a break the twin of that id may be another one."""
        is_known = False
        for message in self.twin.messages(heartbeats=True):
            if ending.is_set():
                return True
            if message.kind != "broken" and not is_known:
                tell(Message(_STATE, self.twin.state()))
                tell(Message(_ALARMS, self.twin.alarms()))
            is_known = message.kind != "broken"
            tell(message)
        tell(Message(_STATE, self.twin.state()))
        tell(Message(_ENDED, {}))
        return True

    async def follow(self) -> None:
        """Hold what is told, for ever."""
        while True:
            message = await self._told.get()
            try:
                await self._take(message)
            except Exception:  # the next message is told all the same
                log.exception("a message of twin %s could not be told: %s", self.twin.id, message.kind)

    async def _take(self, message: Message) -> None:
        document = message.document
        if message.kind == "sample":
            self.newest = document["seq"]
            await self.nodes.sample(document["values"], self.clock)
        elif message.kind == "heartbeat":
            await self.nodes.state(document["state"])
        elif message.kind == "event" and document["kind"] == EventKind.ALARM:
            await self._alarms.tell(document["details"], self.clock.moment(document["time"]))
        elif message.kind == _STATE:
            await self._begin(document)
        elif message.kind == _ALARMS:
            for alarm in document["items"]:
                await self._alarms.tell(alarm, self.clock.moment(alarm["raised_s"] or 0.0))
        elif message.kind == "broken":
            self.is_reachable = False
            await self.nodes.doubt(SILENT)
        elif message.kind == _ENDED:
            await self.nodes.doubt(ENDED)

    async def _begin(self, state: dict[str, Any]) -> None:
        """Take the twin as the service has it."""
        self.is_reachable = True
        self.clock = TwinClock.of(state["created"], state["values"])
        self.newest = state["samples"] - 1
        await self.nodes.state(state["state"])
        if state["values"] is not None:
            await self.nodes.sample(state["values"], self.clock)
