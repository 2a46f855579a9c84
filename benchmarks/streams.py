"""Many readers of an event stream in one process: `python -m benchmarks.streams URL COUNT`.

Says `ready` when each has heard something, waits for a line on stdin, then prints number and lateness [s] of every
sample that each has heard. It reads bytes off sockets and looks into a message only as far as it must: the readers' own
work is not the service's lateness.
"""

from __future__ import annotations

import asyncio
import json
import sys
import time
from urllib.parse import urlsplit

SAMPLE = b"event: sample\ndata: "


async def listen(url: str, heard: list[tuple[int, float]], ending: asyncio.Event) -> None:
    """Note every sample of a stream from now on."""
    parts = urlsplit(url)
    reader, writer = await asyncio.open_connection(parts.hostname, parts.port)
    writer.write(f"GET {parts.path} HTTP/1.1\r\nHost: {parts.netloc}\r\n\r\n".encode())
    rest = b""
    while not ending.is_set() and (part := await reader.read(1 << 16)):
        now = time.time()
        *messages, rest = (rest + part).split(b"\n\n")
        for message in messages:
            begin = message.find(SAMPLE)
            if begin >= 0:
                found = json.loads(message[begin + len(SAMPLE) : message.index(b"\n", begin + len(SAMPLE))])
                heard.append((found["seq"], now - found["sent"]))
    writer.close()


async def main(url: str, count: int) -> None:
    """Listen until told to stop."""
    heard: list[list[tuple[int, float]]] = [[] for _ in range(count)]
    ending = asyncio.Event()
    readers = [asyncio.create_task(listen(url, one, ending)) for one in heard]
    while not all(heard):
        await asyncio.sleep(0.05)
    for one in heard:
        one.clear()
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    await asyncio.to_thread(sys.stdin.readline)
    ending.set()
    await asyncio.wait_for(asyncio.gather(*readers), 10)
    json.dump(heard, sys.stdout)


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1], int(sys.argv[2])))
