"""Commands to a live twin: other threads give them, its own obeys them between two seconds."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

from station import InputError


class CommandQueue:
    """Commands to a twin, in order; each is answered, also one that came too late."""

    def __init__(self, twin_id: str) -> None:
        self._twin_id = twin_id
        self._commands: queue.SimpleQueue[tuple[Callable[[], Any], Future[Any]]] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._closed = False  # no command is obeyed any more

    def ask(self, command: Callable[[], Any], patience_s: float) -> Any:
        """Have `command` run; what it returns or raises.

        Raises
        ------
        InputError
            if the twin has ended.
        TimeoutError
            if it has not answered within `patience_s`.
        """
        reply: Future[Any] = Future()
        with self._lock:
            if self._closed:
                raise self._over()
            self._commands.put((command, reply))
        return reply.result(patience_s)

    def tell(self, command: Callable[[], Any]) -> None:
        """Have `command` run, if the twin has not ended; nobody waits for an answer."""
        self._commands.put((command, Future()))

    def obey(self, patience_s: float) -> bool:
        """Do what the next command says, waiting for one at most so long; False if none came. In the twin's thread."""
        try:
            command, reply = self._commands.get(timeout=patience_s) if patience_s > 0 else self._commands.get_nowait()
        except queue.Empty:
            return False
        try:
            reply.set_result(command())
        except Exception as error:  # noqa: BLE001  # it is the sender's
            reply.set_exception(error)
        return True

    @property
    def empty(self) -> bool:
        """Whether no command waits."""
        return self._commands.empty()

    def close(self) -> None:
        """Refuse the commands that came too late, so that nobody waits for them, and those to come."""
        with self._lock:
            self._closed = True
        while not self._commands.empty():
            _, reply = self._commands.get()
            reply.set_exception(self._over())

    def _over(self) -> InputError:
        return InputError("twin", [("", f"{self._twin_id!r} has ended")])
