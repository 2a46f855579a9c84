"""Connections to PostgreSQL that give up: a server that is frozen keeps its sockets open and says nothing.

`statement_timeout`, `lock_timeout` and TCP's keepalives do not help there: the server would have to act, or its
machine to be gone. So whoever waits looks at the clock.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Generator
from contextlib import suppress
from typing import Any, TypeVar

import psycopg

from api.store.patience import current

INTERVAL_S = 0.1
"""How often a wait looks at the clock [s]."""

Answer = TypeVar("Answer")


class SilentError(psycopg.OperationalError):
    """The server has not answered in time."""

    def __init__(self) -> None:
        super().__init__("does not answer")


def _while_patient(steps: Generator[Any, Any, Answer]) -> Generator[Any, Any, Answer]:
    """The steps of psycopg's protocol, ended with `SilentError` when the wait of the transaction is over."""
    wait = current()
    try:
        wanted = next(steps)
        while True:
            ready = yield wanted
            if ready:
                wait.answered()
            elif wait.over:
                raise SilentError
            wanted = steps.send(ready)
    except StopIteration as done:
        answer: Answer = done.value
        return answer


class PatientConnection(psycopg.Connection[Any]):
    """Waits for the server as long as its caller may. A connection that waited in vain is closed for good."""

    @classmethod
    def _connect_gen(cls, *given: Any, **options: Any) -> Any:
        return _while_patient(super()._connect_gen(*given, **options))

    def wait(self, gen: Any, interval: float = INTERVAL_S, timeout: float | None = None) -> Any:
        """As psycopg's, at most as long as the transaction may wait."""
        try:
            return super().wait(_while_patient(gen), interval, timeout)
        except SilentError:
            self._hang_up()
            raise

    def _hang_up(self) -> None:
        """End the connection under the server's feet: it rolls back what it holds when it reads the end."""
        with suppress(OSError, psycopg.Error), socket.socket(fileno=os.dup(self.pgconn.socket)) as line:
            line.shutdown(socket.SHUT_RDWR)
        self.pgconn.finish()
