"""Commands to a twin from a broker, where a user has switched them on: what zenoh's key `command` takes, over MQTT."""

from __future__ import annotations

import logging
import queue
import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import Any

import orjson
from paho.mqtt.client import MQTTMessage
from pydantic import ValidationError

from api.client import Twin
from api.twins.command_schemas import (
    COMMAND,
    AlarmCommand,
    ContinueCommand,
    ControllerCommand,
    PauseCommand,
    SpeedCommand,
    StopCommand,
    VehicleCommand,
)
from api.twins.messages import VERSION
from station import InputError, StationError

log = logging.getLogger(__name__)

WAITING_MAX = 100
"""Commands that may wait; more are refused."""

PAYLOAD_MAX = 64_000
"""Largest command, as over zenoh [bytes]."""

ID_MAX = 128
"""Longest id that a sender may give a command [characters]."""

REMEMBERED_MAX = 1000
"""Answers that are kept by id: a command that comes again is answered and not done again."""

LOOK_S = 0.2
"""How often it is looked whether to end [s]."""


def check_allowed(twin: Twin) -> None:
    """Raise ServiceError unless the key in use may operate twins.

    It is asked by a change that no twin takes: refused as forbidden, or, behind that, for what it is.
    """
    try:
        twin.change(speed=0)
    except InputError:
        return


def obey(twin: Twin, document: Any) -> dict[str, Any]:
    """Do what a command's document says; the twin's state then.

    Raises
    ------
    StationError
        if it is no command, or the service refuses.
    """
    try:
        given = COMMAND.validate_python(document)
    except ValidationError as error:
        raise InputError.of("command", error) from None
    match given:
        case PauseCommand():
            return twin.change(paused=True)
        case ContinueCommand():
            return twin.change(paused=False)
        case SpeedCommand():
            return twin.change(speed=given.speed)
        case ControllerCommand():
            return twin.change(controller=given.controller)
        case VehicleCommand():
            return twin.add_vehicle(**given.model_dump(exclude_none=True, exclude={"command"}))
        case AlarmCommand():
            twin.act_on_alarm(given.alarm, **given.do.model_dump(mode="json", exclude_none=True))
            return twin.state()
        case StopCommand():
            return twin.stop()


class CommandWorker:
    """Does the commands that come, one after another on a thread of its own, and answers each.

    Parameters
    ----------
    twin
        That is operated, by a client whose key may `operate`.
    answer
        Sends a document to where commands are answered.
    """

    def __init__(self, twin: Twin, answer: Callable[[dict[str, Any]], None]) -> None:
        self._twin, self._answer = twin, answer
        self._waiting: queue.Queue[bytes] = queue.Queue(WAITING_MAX)
        self._answered: OrderedDict[str, dict[str, Any]] = OrderedDict()
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="commands", daemon=True)

    def start(self) -> None:
        """Begin to do what comes."""
        self._thread.start()

    def close(self) -> None:
        """Do nothing more: who still waits gets no answer."""
        self._ending.set()
        self._thread.join()

    def on_message(self, _client: Any, _data: Any, message: MQTTMessage) -> None:
        """Take a message; called on the client's thread."""
        if message.retain:  # it was meant for whoever was there when it was sent
            log.warning("a command that the broker has retained is not obeyed")
            return
        try:
            self._waiting.put_nowait(bytes(message.payload))
        except queue.Full:
            log.warning("a command is not obeyed: %d are waiting", WAITING_MAX)

    def _run(self) -> None:
        while not self._ending.is_set():
            try:
                payload = self._waiting.get(timeout=LOOK_S)
            except queue.Empty:
                continue
            self._answer(self._obeyed(payload))

    def _obeyed(self, payload: bytes) -> dict[str, Any]:
        """The answer to a command, which is done now unless one with its id was."""
        name: str | None = None
        try:
            document, name = _read(payload)
            if name is not None and name in self._answered:
                return {**self._answered[name], "repeated": True}
            answer = self._document(name, done=True, state=obey(self._twin, document))
        except StationError as error:
            answer = self._document(name, done=False, error=str(error))
        if name is not None:
            self._answered[name] = answer
            if len(self._answered) > REMEMBERED_MAX:
                self._answered.popitem(last=False)
        return answer

    def _document(self, name: str | None, **more: Any) -> dict[str, Any]:
        return {"version": VERSION, "twin": self._twin.id, "id": name, "repeated": False, **more}


def _read(payload: bytes) -> tuple[Any, str | None]:
    """A command without its id, and the id.

    Raises
    ------
    InputError
        if it is too long, no JSON, or its id is none.
    """
    if len(payload) > PAYLOAD_MAX:
        raise InputError("command", [("", f"must not exceed {PAYLOAD_MAX} bytes; given {len(payload)}")])
    try:
        document = orjson.loads(payload)
    except orjson.JSONDecodeError as error:
        raise InputError("command", [("", f"is not JSON: {error}")]) from None
    name = document.pop("id", None) if isinstance(document, dict) else None
    if name is not None and not (isinstance(name, str) and 0 < len(name) <= ID_MAX):
        raise InputError("command", [("id", f"must be a text of 1 to {ID_MAX} characters; given {name!r:.50}")])
    return document, name
