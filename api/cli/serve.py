"""`hrs serve`: the service under uvicorn, from the first message to the last."""

from __future__ import annotations

import errno
import gc
import logging
import math
import signal
import socket
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

import uvicorn
from fastapi import FastAPI

from api import logs
from api.cli.demonstration import Gateway, demonstrate, say
from api.server.app import create_app
from api.server.connections import Connections, Deadlines, connections_max, raise_file_limit
from api.server.ending import Ending
from api.server.services import Services
from api.settings import Settings
from controllers.registry import THESIS_CONTROLLERS, uncompiled
from station import InputError, StationError

log = logging.getLogger(__name__)

SWITCH_S = 0.0002
"""A thread that computes gives way so often [s]: uvloop takes the interpreter anew for each event, 2000 connections in
a row included, and waits as long each time while a body is validated or a table is made."""

BACKLOG = 256
"""Connections that wait to be accepted; all of them are in one turn of the event loop, some 0.1 s for so many."""


class Server(uvicorn.Server):
    """uvicorn that says when it listens, and ends open streams before it waits for them."""

    def __init__(self, config: uvicorn.Config, ready: Callable[[int], None], ending: Callable[[], None]) -> None:
        super().__init__(config)
        self._ready = ready
        self._end_streams = ending
        self._ending = Ending()

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Stop on SIGTERM and SIGINT, and end with status 0: being asked to stop is no failure."""
        before = {number: signal.signal(number, self.handle_exit) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Stop, in bounded time."""
        self._ending.begin()
        super().handle_exit(sig, frame)

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start, then call `ready(port)`."""
        await super().startup(sockets)
        if self.started and sockets:
            self._ready(sockets[0].getsockname()[1])

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End streams, then stop."""
        self._end_streams()
        await super().shutdown(sockets)
        self._ending.closed()


def _check_keys(settings: Settings, services: Services) -> None:
    asked = {"host": settings.keys_required, "zenoh_listen": settings.zenoh_keys_required}
    if any(asked.values()):
        services.database.migrate()
        if not services.keys.any_valid():
            message = "{} is reached from other machines: make a key first, `hrs keys create NAME`"
            problems = [(name, message.format(getattr(settings, name))) for name in asked if asked[name]]
            raise InputError("settings", problems)


def serve(settings: Settings) -> None:
    """Serve until SIGTERM or SIGINT.

    Raises
    ------
    InputError
        if the address cannot be listened on, or asks for keys and there are none.
    """
    logs.configure(settings.log_format)
    # FastAPI ignores pydantic's remark on a header's own name as it reads one; other threads set filters meanwhile.
    warnings.filterwarnings("ignore", message="The 'alias' attribute")
    app = create_app(settings)
    services: Services = app.state.services
    if settings.demo:
        services.twins.observers.append(Gateway(services.twins))
    _check_keys(settings, services)
    listening = _listen(settings)
    try:
        services.prepare()
    except StationError:
        listening.close()
        raise
    # Live twins share the interpreter with all that was imported, which no collection needs to visit again.
    gc.collect()
    gc.freeze()
    sys.setswitchinterval(SWITCH_S)
    files = raise_file_limit()
    connections = Connections(
        Deadlines.of(settings), connections_max(settings, files),
        lambda reason: services.metrics.connections_ended.labels(reason).inc(),
    )  # fmt: skip
    app.state.connections = connections
    config = uvicorn.Config(
        app, http=connections.protocol(), backlog=BACKLOG, timeout_keep_alive=math.ceil(settings.idle_max_s),
        lifespan="on", log_config=None, log_level="error", access_log=False, server_header=False,
        ws="none",
        timeout_graceful_shutdown=max(1, round(settings.stop_s)),
    )  # fmt: skip
    server = Server(config, lambda port: _announce(settings, app, port), services.end_streams)
    try:
        server.run(sockets=[listening])
    finally:
        listening.close()


def _listen(settings: Settings) -> socket.socket:
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((settings.host, settings.port))
        listening.listen(BACKLOG)
    except OSError as error:
        listening.close()
        used = "is in use: another service runs there, or choose another with --port"
        what = used if error.errno == errno.EADDRINUSE else f"cannot be listened on: {error.strerror}"
        raise InputError("settings", [("port", f"{settings.host}:{settings.port} {what}")]) from None
    return listening


def _announce(settings: Settings, app: FastAPI, port: int) -> None:
    """Say where everything is; start the demonstration."""
    url = settings.model_copy(update={"port": port, "url": None}).service_url
    places = {
        "page": f"{url}/", "API": f"{url}/v1", "documentation": f"{url}/docs",
        "telemetry": app.state.services.telemetry_endpoint, "data": app.state.services.database.described,
    }  # fmt: skip
    missing = uncompiled(first=THESIS_CONTROLLERS) if app.state.services.compiler.at_work() else []
    if settings.log_format == "json":
        ready = {**places, "compiling": missing, "keys_required": settings.keys_required}
        log.info("hrs-twin is ready", extra=ready)
    else:
        say("hrs-twin is ready")
        for what, where in places.items():
            say(f"  {what:<14} {where}")
        if missing:
            say(f"  compiling      {', '.join(missing)}; once for this version, each can be used when it is done")
        if settings.keys_required:
            say("  every request needs a key: Authorization: Bearer KEY")
        if settings.zenoh_keys_required:
            say("  every zenoh client needs a key's user and password: `hrs keys zenoh NAME`")
    if settings.demo:
        threading.Thread(target=demonstrate, args=(app.state.services,), name="demo", daemon=True).start()
