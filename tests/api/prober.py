"""Asks /livez over a kept connection and over new ones until its input ends, then prints what it waited: JSON [s]."""

from __future__ import annotations

import json
import select
import socket
import sys
import time

ASKED = b"GET /livez HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"


def _ask(connection: socket.socket) -> None:
    connection.sendall(ASKED)
    said = b""
    while not said.endswith(b"}"):
        piece = connection.recv(4096)
        if not piece:
            raise ConnectionError(said)
        said += piece
    if b" 200 " not in said[:20]:
        raise ConnectionError(said)


def main(port: int) -> None:
    """Probe that port."""
    waits: dict[str, list[float]] = {"kept": [], "new": []}
    failed: list[str] = []
    kept = socket.create_connection(("127.0.0.1", port), 30)
    while not select.select([sys.stdin], [], [], 0.01)[0]:
        for kind, waited in waits.items():
            began = time.perf_counter()
            try:
                if kind == "new":
                    with socket.create_connection(("127.0.0.1", port), 30) as made:
                        _ask(made)
                else:
                    _ask(kept)
            except OSError as error:
                failed.append(f"{kind}: {error!r:.200}")
                if kind == "kept":
                    kept = socket.create_connection(("127.0.0.1", port), 30)
            waited.append(time.perf_counter() - began)
    print(json.dumps({**waits, "failed": failed}))


if __name__ == "__main__":
    main(int(sys.argv[1]))
