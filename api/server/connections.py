"""Connections of the HTTP server: deadlines for what a client sends and takes, and room for those that come."""

from __future__ import annotations

import asyncio
import resource
from collections.abc import Callable
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol, RequestResponseCycle

from api.http.problems import MEDIA_TYPE, ProblemError
from api.settings import Settings

SWEEP_S = 0.5
"""How often deadlines are looked at [s]."""

STOOD_STILL_S = 2 * SWEEP_S
"""What passes beyond this between two looks, the process or the machine stood still for; nobody is late by it [s]."""

ENDED_AT_ONCE = 32
"""Connections that are ended without a pause: some milliseconds."""

FILES_RESERVED = 384
"""Files for everything but clients: the store, workers, zenoh, and the files a request opens."""

FILES_MAX = 65_536
"""The limit of open files is raised to the hard one, but no further: some libraries touch every number below it."""

CONNECTIONS_MAX = 10_000
"""Connections at once, where files allow more."""

HEADERS_MAX = 100
"""Header fields of a request; browsers send some 20."""

PIPELINED_MAX = 16
"""Requests that a client may send before the first is answered."""

HELD_MAX = 16_384
"""So much of a body is waited for before the application gets its request; 164 MB of `CONNECTIONS_MAX` [bytes]."""


def raise_file_limit() -> int:
    """Raise the soft limit of open files to the hard one; the limit that holds then."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = FILES_MAX if hard == resource.RLIM_INFINITY else min(hard, FILES_MAX)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
        return wanted
    return FILES_MAX if soft == resource.RLIM_INFINITY else soft


def connections_max(settings: Settings, files: int) -> int:
    """How many connections may be open where so many files may be."""
    room = max(files - FILES_RESERVED, files // 4)
    return min(room, settings.connections_max or CONNECTIONS_MAX)


@dataclass(frozen=True, slots=True)
class Deadlines:
    """The deadlines of a client."""

    head_s: float  # from the first byte of a request, or the connection, to the end of its headers
    head_bytes: int
    body_bytes_per_s: float  # on average, beyond the first `head_s`
    idle_s: float  # between requests
    unread_s: float  # without taking a byte of its answer

    @classmethod
    def of(cls, settings: Settings) -> Deadlines:
        """As the settings have them."""
        return cls(
            settings.headers_max_s, settings.headers_bytes_max, settings.body_rate_min, settings.idle_max_s,
            settings.unread_max_s,
        )  # fmt: skip


class Connections:
    """The open connections of a server.

    Those that wait for their client stand in the order in which it was heard last; apart those of clients that have
    been answered, and of strangers, which may never want to be.
    """

    def __init__(self, deadlines: Deadlines, most: int, on_end: Callable[[str], None]) -> None:
        self.deadlines = deadlines
        self.most = most
        self._on_end = on_end
        self._open: set[Connection] = set()
        self._known: dict[Connection, None] = {}
        self._strangers: dict[Connection, None] = {}
        self._sweeping: asyncio.TimerHandle | None = None
        self._swept = 0.0  # when, by the clock of the event loop
        self._swept_at = 0.0  # the same by our own

    def __len__(self) -> int:
        return len(self._open)

    def protocol(self) -> type[Connection]:
        """The protocol class of a server whose connections these are."""
        return type("BoundConnection", (Connection,), {"registry": self})

    def added(self, connection: Connection) -> None:
        """A client has connected: where there are too many, the one that was silent longest goes, or this one.

        Of strangers, where they have more than half of the room: a flood of them ends nobody who has been answered,
        and those who have been leave room for others.
        """
        if len(self._open) >= self.most:
            many = self._strangers if len(self._strangers) > self.most // 2 or not self._known else self._known
            silent = next(iter(many), connection)
            self.end(silent, "room")
            self.removed(silent)
            if silent is connection:
                return
        self._open.add(connection)
        self.heard(connection)
        if self._sweeping is None:
            self._swept = connection.loop.time()
            self._sweeping = connection.loop.call_later(SWEEP_S, self._sweep, connection.loop)

    def time(self, loop: asyncio.AbstractEventLoop) -> float:
        """Clock of the deadlines, which stands still while the process does [s]."""
        return self._swept_at + min(loop.time() - self._swept, STOOD_STILL_S)

    def heard(self, connection: Connection) -> None:
        """A client has sent something, or its answer is complete."""
        self._forget(connection)
        if connection in self._open and connection.waits_for_client:
            (self._known if connection.answered else self._strangers)[connection] = None

    def removed(self, connection: Connection) -> None:
        """A connection has ended."""
        self._open.discard(connection)
        self._forget(connection)

    def _forget(self, connection: Connection) -> None:
        self._known.pop(connection, None)
        self._strangers.pop(connection, None)

    def end(self, connection: Connection, reason: str) -> None:
        """Close a connection for a reason that is counted."""
        self._on_end(reason)
        connection.end(reason)

    def _sweep(self, loop: asyncio.AbstractEventLoop) -> None:
        pause, self._sweeping = SWEEP_S, None
        try:
            now = self.time(loop)
            self._swept, self._swept_at = loop.time(), now
            overdue = [(each, reason) for each in self._open if (reason := each.overdue(now)) is not None]
            for connection, reason in overdue[:ENDED_AT_ONCE]:
                self.end(connection, reason)
            if len(overdue) > ENDED_AT_ONCE:
                pause = SWEEP_S / 20
        finally:  # one connection that fails must not end the deadlines of all
            if self._open:
                self._sweeping = loop.call_later(pause, self._sweep, loop)


class Connection(HttpToolsProtocol):
    """uvicorn's protocol over httptools, with limits that neither of them has."""

    registry: Connections

    def __init__(self, *given: Any, **named: Any) -> None:
        super().__init__(*given, **named)
        self.answered = False  # whether a request was, at least
        self._since = 0.0  # when this request, or the wait for it, began
        self._in_head = True
        self._head_bytes = 0  # of complete fields
        self._raw_bytes = 0  # of pieces that completed no headers
        self._heads = 0  # headers that were received whole
        self._body_bytes = 0
        self._body_s = 0.0  # time in which the body could be sent
        self._looked = 0.0
        self._unsent = 0
        self._taken = 0.0  # when the client last took something of its answer
        self._refusal: HTTPStatus | None = None
        self._running: RequestResponseCycle | None = None  # of several pipelined ones, that which is answered now
        self._held: tuple[RequestResponseCycle, Any] | None = None  # begins with its body, and who answers it

    @property
    def waits_for_client(self) -> bool:
        """Whether a request, or the rest of one, is waited for."""
        cycle = self.cycle
        return cycle is None or cycle.response_complete or cycle.more_body

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """A client has connected."""
        super().connection_made(transport)
        self.registry.added(self)
        self._since = self._looked = self._taken = self.registry.time(self.loop)

    def connection_lost(self, exc: Exception | None) -> None:
        """It is gone."""
        self.registry.removed(self)
        self._disconnect()
        super().connection_lost(exc)

    def _start_asgi_task(self, cycle: RequestResponseCycle, app: Any) -> None:
        """Hand a request to the application when its body has come, or `HELD_MAX` of it: half of one costs nothing."""
        self._running = cycle
        if cycle.more_body and not cycle.waiting_for_100_continue and len(cycle.body) <= HELD_MAX:
            self._held = (cycle, app)
        else:
            super()._start_asgi_task(cycle, app)

    def _release(self) -> None:
        """Start what was held for its body."""
        if self._held is not None:
            held, self._held = self._held, None
            super()._start_asgi_task(*held)

    def _disconnect(self) -> None:
        """Let what is being answered end: its transport takes nothing more."""
        for cycle in (self._running, self.cycle):
            if cycle is not None and not cycle.response_complete:
                cycle.disconnected = True
                cycle.message_event.set()
        self.pipeline.clear()
        self.flow.resume_writing()

    def data_received(self, data: bytes) -> None:
        """It has sent something."""
        heads = self._heads if self._in_head else None
        super().data_received(data)
        if self.transport.is_closing():
            return
        if heads == self._heads:  # still the same headers: a field that is not complete is known here alone
            self._raw_bytes += len(data)
            if self._raw_bytes > self.registry.deadlines.head_bytes:
                self._refuse(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE)
        self.registry.heard(self)

    def on_message_begin(self) -> None:
        """The first byte of a request."""
        if len(self.pipeline) >= PIPELINED_MAX:
            raise _TooMuchError
        super().on_message_begin()
        self._in_head, self._head_bytes, self._since = True, 0, self.registry.time(self.loop)

    def on_url(self, url: bytes) -> None:
        """A part of its address."""
        self._count(len(url))
        super().on_url(url)

    def on_header(self, name: bytes, value: bytes) -> None:
        """A header field, or a trailer."""
        self._count(len(name) + len(value) + 4)
        if len(self.headers) >= HEADERS_MAX:
            self._refusal = HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE
            raise _TooMuchError
        super().on_header(name, value)

    def _count(self, size: int) -> None:
        self._head_bytes += size
        if self._head_bytes > self.registry.deadlines.head_bytes:
            self._refusal = HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE
            raise _TooMuchError

    def on_headers_complete(self) -> None:
        """The end of its headers."""
        self._in_head, self._raw_bytes = False, 0
        self._heads += 1
        self._body_bytes, self._body_s = 0, 0.0
        self._since = self._looked = self._taken = self.registry.time(self.loop)
        super().on_headers_complete()

    def on_body(self, body: bytes) -> None:
        """A part of its body."""
        self._body_bytes += len(body)
        super().on_body(body)
        if self._held is not None and len(self._held[0].body) > HELD_MAX:
            self._release()

    def on_message_complete(self) -> None:
        """The end of its body, or of its headers where it has none."""
        super().on_message_complete()
        self._release()

    def on_response_complete(self) -> None:
        """Its answer was sent."""
        super().on_response_complete()
        self.answered = True
        if not self._in_head:
            self._since = self.registry.time(self.loop)
        self.registry.heard(self)

    def overdue(self, now: float) -> str | None:
        """Which deadline has passed, if one has."""
        limits, cycle = self.registry.deadlines, self.cycle
        elapsed, self._looked = now - self._looked, now
        if self._unread_s(now) > limits.unread_s:
            return "unread"
        if self.transport.is_closing():
            return None
        if cycle is None or cycle.response_complete:
            if self._in_head:
                return "headers" if now - self._since > limits.head_s else None
            return "idle" if now - self._since > limits.idle_s else None
        if cycle.more_body:
            if not self.flow.read_paused:
                self._body_s += elapsed
            if self._body_bytes < limits.body_bytes_per_s * (self._body_s - limits.head_s):
                return "body"
        return None

    def _unread_s(self, now: float) -> float:
        """How long the client has taken nothing of what is there for it [s]."""
        unsent = self.transport.get_write_buffer_size()
        if unsent == 0 or unsent < self._unsent:
            self._taken = now
        self._unsent = unsent
        return now - self._taken

    def end(self, reason: str) -> None:
        """Close; a client that is in the middle of a request learns why."""
        self._disconnect()
        if reason in {"unread", "room"} or self.transport.is_closing() or self._unsent:
            self.transport.abort()
        elif reason == "idle" or self._head_bytes + self._raw_bytes == 0:
            self.transport.close()
        else:
            self._refuse(HTTPStatus.REQUEST_TIMEOUT)

    def _refuse(self, status: HTTPStatus) -> None:
        self._refusal = status
        self.send_400_response("")

    def send_400_response(self, _msg: str) -> None:
        """Refuse what cannot be answered by the application, and close."""
        running = self._running
        self._disconnect()
        if running is not None and running.response_started and not running.response_complete:
            self.transport.close()  # in the middle of another answer
            return
        status = self._refusal or HTTPStatus.BAD_REQUEST
        kind, title, detail = _REFUSALS[status]
        content = ProblemError(status, kind, title, detail.format(limits=self.registry.deadlines)).document()
        head = (
            f"HTTP/1.1 {status.value} {status.phrase}\r\ncontent-type: {MEDIA_TYPE}\r\n"
            f"content-length: {len(content)}\r\nconnection: close\r\n\r\n"
        )
        self.transport.write(head.encode() + content)
        self.transport.close()

    def _unsupported_upgrade_warning(self) -> None:
        """No line in the log for what any client can send."""


class _TooMuchError(Exception):
    """Ends the parsing of what a client sends; httptools makes a parser's error of it."""


_HEADERS_LATE = "headers must come within {limits.head_s:g} s (setting headers_max_s)"

_REFUSALS = {
    HTTPStatus.BAD_REQUEST: ("malformed", "Malformed request", "this is no HTTP"),
    HTTPStatus.REQUEST_TIMEOUT: (
        "timeout", "Request takes too long",
        _HEADERS_LATE + ", a body by {limits.body_bytes_per_s:g} bytes/s (setting body_rate_min)",
    ),
    HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE: (
        "headers-too-large", "Headers too large",
        "at most {limits.head_bytes} bytes (setting headers_bytes_max) in " + f"{HEADERS_MAX} fields",
    ),
}  # fmt: skip
"""Kind, title and detail of what is refused here."""
