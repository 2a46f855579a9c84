"""Parts of the open service as arguments of routes, found by their types: a route names what it uses."""

from __future__ import annotations

import threading
from collections.abc import Awaitable, Callable, Mapping
from typing import Annotated, Any, TypeVar

from fastapi import Depends, FastAPI, Request

from api.http.threads import Threads
from api.settings import Settings
from api.store.jobs import JobRepository
from api.store.keys import KeyRepository
from api.store.size import StoreRoom

Part = TypeVar("Part")


class Shutdown(threading.Event):
    """Set when open streams must end."""


def provide(app: FastAPI, parts: Mapping[type[Any], Any]) -> None:
    """Let the routes of an application have these parts, by type."""
    app.state.parts = parts


def part_of(request: Request, kind: type[Part]) -> Part:
    """The part of that type of the service that a request came to."""
    found: Part = request.app.state.parts[kind]
    return found


def provided(kind: type[Part]) -> Callable[[Request], Awaitable[Part]]:
    """A dependency that is the part of that type; async, so that no thread is taken for it."""

    async def find(request: Request) -> Part:
        return part_of(request, kind)

    return find


SettingsDep = Annotated[Settings, Depends(provided(Settings))]
JobsDep = Annotated[JobRepository, Depends(provided(JobRepository))]
KeysDep = Annotated[KeyRepository, Depends(provided(KeyRepository))]
StoreRoomDep = Annotated[StoreRoom, Depends(provided(StoreRoom))]
ThreadsDep = Annotated[Threads, Depends(provided(Threads))]
ShutdownDep = Annotated[Shutdown, Depends(provided(Shutdown))]
