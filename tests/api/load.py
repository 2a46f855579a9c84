"""Requests to a running service at a steady rate, however slowly it answers.

A client of few instructions: what it measures is the service's time, not its own.
"""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from itertools import cycle
from typing import Any
from urllib.parse import urlsplit


@dataclass(frozen=True)
class Ask:
    """A request, and a name for its kind."""

    what: str
    method: str
    path: str
    body: Any = None
    headers: Mapping[str, str] = field(default_factory=dict)

    def as_bytes(self, host: str) -> bytes:
        """As it goes over the line."""
        content = b"" if self.body is None else json.dumps(self.body, separators=(",", ":")).encode()
        kind = {"Content-Type": "application/json"} if content else {}
        headers = {"Host": host, "Connection": "close", "Content-Length": str(len(content)), **kind, **self.headers}
        lines = [f"{self.method} {self.path} HTTP/1.1", *(f"{name}: {value}" for name, value in headers.items())]
        return "\r\n".join(lines).encode() + b"\r\n\r\n" + content


@dataclass(frozen=True)
class Answered:
    """What came of a request."""

    what: str
    status: int  # 0 if the connection ended without an answer
    took_s: float
    headers: Mapping[str, str]  # names in lower case
    error: str = ""


async def load(url: str, asked: Sequence[Ask], seconds: float, per_s: float) -> list[Answered]:
    """Send these in turn for so long; all answers. No request waits for another's answer."""
    place = urlsplit(url).netloc
    host, _, port = place.partition(":")

    async def one(ask: Ask) -> Answered:
        began, sent = time.monotonic(), None
        try:
            reader, writer = await asyncio.open_connection(host, int(port))
            with closing(writer):
                writer.write(ask.as_bytes(place))
                sent = round(time.monotonic() - began, 3)
                head = await reader.readuntil(b"\r\n\r\n")
                await reader.read()
        except (OSError, asyncio.IncompleteReadError) as error:
            said = f"{error!r}; due at {began - start:.3f} s, sent {sent} s later"
            return Answered(ask.what, 0, time.monotonic() - began, {}, said)
        took = time.monotonic() - began
        status, *lines = head.decode("latin-1").strip().split("\r\n")
        headers = {name.lower(): value for name, _, value in (line.partition(": ") for line in lines)}
        return Answered(ask.what, int(status.split()[1]), took, headers)

    start, tasks = time.monotonic(), []
    for number, ask in enumerate(cycle(asked)):
        due = start + number / per_s
        if due > start + seconds:
            break
        await asyncio.sleep(max(0.0, due - time.monotonic()))
        tasks.append(asyncio.create_task(one(ask)))
    return await asyncio.gather(*tasks)
