"""A request goes to the application when its body has come, or 16 kB of it: half a request costs it nothing."""

from __future__ import annotations

import asyncio
import socket
from contextlib import asynccontextmanager

import uvicorn

from api.server.connections import HELD_MAX, Connections, Deadlines
from api.settings import Settings
from tests.waiting import awaited

HEAD = "POST {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: {size}\r\n"


class Application:
    """Tells which requests it was given and how long their bodies were."""

    def __init__(self):
        self.begun: list[str] = []
        self.read: list[int] = []

    async def __call__(self, scope, receive, send):
        self.begun.append(scope["path"])
        size, more = 0, True
        while more:
            message = await receive()
            if message["type"] == "http.disconnect":
                return
            size, more = size + len(message["body"]), message["more_body"]
        self.read.append(size)
        await send({"type": "http.response.start", "status": 204, "headers": []})
        await send({"type": "http.response.body", "body": b""})


@asynccontextmanager
async def _served():
    """An application, and how to connect to it."""
    application = Application()
    connections = Connections(Deadlines.of(Settings(database_url="sqlite://")), 100, lambda _reason: None)
    config = uvicorn.Config(application, http=connections.protocol(), lifespan="off", log_level="error")
    server = uvicorn.Server(config)
    with socket.create_server(("127.0.0.1", 0)) as listening:
        serving = asyncio.create_task(server.serve([listening]))
        reader, writer = await asyncio.open_connection(*listening.getsockname())
        try:
            yield application, reader, writer
        finally:
            writer.close()
            server.should_exit = True
            await serving


async def _sent(writer, text):
    writer.write(text if isinstance(text, bytes) else text.encode())
    await writer.drain()
    await asyncio.sleep(0.1)


def test_half_a_request_is_not_begun():
    async def run():
        async with _served() as (application, reader, writer):
            await _sent(writer, HEAD.format(path="/a", size=9) + "\r\n{")
            assert application.begun == []
            await _sent(writer, "12345678" + HEAD.format(path="/b", size=3) + "\r\n123")
            assert application.begun == ["/a", "/b"]
            assert application.read == [9, 3]
            assert (await reader.read(10_000)).count(b"HTTP/1.1 204") == 2

    awaited(run())


def test_a_long_body_is_read_while_it_comes():
    size = 3 * HELD_MAX

    async def run():
        async with _served() as (application, reader, writer):
            await _sent(writer, HEAD.format(path="/long", size=size) + "\r\n")
            await _sent(writer, b"x" * HELD_MAX)
            assert application.begun == []
            await _sent(writer, b"x")
            assert application.begun == ["/long"]
            await _sent(writer, b"x" * (2 * HELD_MAX - 1))
            assert application.read == [size]
            assert b"204" in await reader.readline()

    awaited(run())


def test_who_waits_to_be_let_on_is_let_on():
    async def run():
        async with _served() as (application, reader, writer):
            await _sent(writer, HEAD.format(path="/a", size=1) + "Expect: 100-continue\r\n\r\n")
            assert application.begun == ["/a"]
            assert b"100 Continue" in await reader.readline()
            await _sent(writer, "1")
            assert application.read == [1]

    awaited(run())
