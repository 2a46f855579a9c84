"""A web page of somebody else's: served under other names, it tries every way a browser has of reaching the service."""

from __future__ import annotations

import threading
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

ATTACK = Path(__file__).with_name("foreign.js").read_text()
"""Sends every command, and asks for every address, each way; `REDIRECT` is where a redirect begins."""


class _Foreign(BaseHTTPRequestHandler):
    """A page with the script, frames of it without an origin, and redirects."""

    def _answer(self) -> None:
        self.rfile.read(int(self.headers.get("content-length", 0)))
        asked = urlsplit(self.path)
        if asked.path == "/redirect":
            self.send_response(307)
            self.send_header("Location", parse_qs(asked.query)["to"][0])
            self.send_header("Access-Control-Allow-Origin", "*")
            self.send_header("Content-Length", "0")
            self.end_headers()
            return
        script = ATTACK.replace("REDIRECT", f"http://{self.headers['host']}/redirect?to=")
        content = f"<!doctype html><title>elsewhere</title><body><script>{script}</script>".encode()
        if asked.path == "/sandboxed":
            content = b"<!doctype html><iframe name=inner sandbox='allow-scripts allow-forms' src='/'></iframe>"
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    do_GET = do_POST = _answer  # noqa: N815  # as the standard library calls them

    def log_message(self, *_about) -> None:
        pass


@contextmanager
def elsewhere():
    """Port of a server of a foreign page."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), _Foreign)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield server.server_port
    server.shutdown()
    thread.join()
    server.server_close()
