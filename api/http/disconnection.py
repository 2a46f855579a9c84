"""Whether the client of a request still waits, so that work for one that has gone ends."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import contextmanager
from typing import Annotated

from fastapi import Depends, Request


class Disconnection:
    """The end of a client's connection, once it happens; may be asked from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._calls: list[Callable[[], None]] = []
        self._happened = False

    @contextmanager
    def calls(self, end: Callable[[], None]) -> Iterator[None]:
        """`end` is called if the client goes while the block runs, or has gone before."""
        with self._lock:
            gone = self._happened
            self._calls.append(end)
        if gone:
            end()
        try:
            yield
        finally:
            with self._lock:
                self._calls.remove(end)

    def happen(self) -> None:
        """The client has gone."""
        with self._lock:
            self._happened = True
            calls = list(self._calls)
        for end in calls:
            end()


async def _watched(request: Request) -> AsyncIterator[Disconnection]:
    """The disconnection of this request, whose body has been read."""
    found = Disconnection()

    async def watch() -> None:
        while (await request.receive())["type"] != "http.disconnect":
            pass
        found.happen()

    watching = asyncio.create_task(watch())
    try:
        yield found
    finally:
        watching.cancel()


Disconnected = Annotated[Disconnection, Depends(_watched)]
"""Type of a route's argument that wants to know when its client goes."""
