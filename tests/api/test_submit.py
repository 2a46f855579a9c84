"""`hrs submit` sends its request again where the answer was lost, and it is done once."""

from __future__ import annotations

import re
import socket
import threading

import httpx
import pytest

from api.client import Client, ServiceError, transport
from api.settings import Settings
from station import StationError
from tests.api.conftest import RunningService, free_port
from tests.warm import run_hrs


class Line:
    """A line between a client and a service: each connection is handed to the next of `handlers`, the last for good."""

    def __init__(self, *handlers) -> None:
        self.requests: list[bytes] = []
        self.url = f"http://127.0.0.1:{(port := free_port())}"
        self._handlers = list(handlers)
        self._listening = socket.create_server(("127.0.0.1", port))
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while self._handlers:
            try:
                connection, _ = self._listening.accept()
            except OSError:
                return
            handler = self._handlers.pop(0) if len(self._handlers) > 1 else self._handlers[0]
            with connection:
                self.requests.append(_request(connection))
                handler(connection, self.requests[-1])

    def close(self) -> None:
        self._listening.shutdown(socket.SHUT_RDWR)
        self._listening.close()
        self._thread.join(10)

    def keys(self) -> list[bytes]:
        return [re.search(rb"(?i)idempotency-key: (\S+)", request)[1] for request in self.requests]


def _request(connection) -> bytes:
    """A whole request."""
    data = b""
    while b"\r\n\r\n" not in data:
        data += connection.recv(65_536)
    length = int((re.search(rb"(?i)content-length: (\d+)", data) or (0, b"0"))[1])
    while len(data) < data.index(b"\r\n\r\n") + 4 + length:
        data += connection.recv(65_536)
    return data


def _answer(port: int, request: bytes) -> bytes:
    """What the service answers; it closes the connection behind it."""
    with socket.create_connection(("127.0.0.1", port), 10) as service:
        service.sendall(re.sub(rb"(?i)connection: keep-alive", b"Connection: close", request))
        return b"".join(iter(lambda: service.recv(65_536), b""))


def _says(status: str, *headers: str, body: str = "{}"):
    def handler(connection, _request):
        head = "\r\n".join((f"HTTP/1.1 {status}", f"Content-Length: {len(body)}", "Connection: close", *headers))
        connection.sendall(f"{head}\r\n\r\n{body}".encode())

    return handler


@pytest.fixture
def line(request):
    made = []

    def make(*handlers):
        made.append(Line(*handlers))
        return made[-1]

    yield make
    for each in made:
        each.close()


@pytest.mark.slow
def test_a_service_killed_between_request_and_answer_has_one_job(tmp_path, line):
    service = RunningService(tmp_path, "--workers", "0")

    def killed(_connection, request):
        assert b" 202 " in _answer(service.port, request).splitlines()[0]  # done, and nobody hears of it
        service.kill()
        service.start()

    between = line(killed, lambda connection, request: connection.sendall(_answer(service.port, request)))
    done = run_hrs("submit", "S1", "--url", between.url)
    stored = httpx.get(f"{service.url}/v1/runs", trust_env=False).json()["items"]
    service.stop()
    assert done.returncode == 0, done.stderr
    assert [job["id"] for job in stored] == [done.stdout.strip()]
    assert len(between.requests) == 2
    assert len(set(between.keys())) == 1
    assert "the same request again in 1 s" in done.stderr


def test_it_waits_where_the_service_says_when(line, capsys):
    refused = '{"type": "urn:x", "title": "Being compiled", "status": 503, "detail": "minlp1"}'
    between = line(
        _says("503 Service Unavailable", "Retry-After: 0", body=refused),
        _says("409 Conflict", "Retry-After: 0", body=refused),
        _says("202 Accepted", body='{"id": "run-1"}'),
    )
    with Client(Settings(url=between.url)) as client:
        assert client.post("/v1/runs", {}) == {"id": "run-1"}
    assert len(set(between.keys())) == 1
    assert capsys.readouterr().err.splitlines() == ["Being compiled: minlp1: the same request again in 0 s"] * 2


@pytest.mark.parametrize("status", ["503 Service Unavailable", "409 Conflict"])
def test_what_names_no_time_is_refused_at_once(line, status):
    between = line(_says(status, body='{"title": "No", "detail": "never"}'))
    with Client(Settings(url=between.url)) as client, pytest.raises(StationError, match="No: never"):
        client.post("/v1/runs", {})
    assert len(between.requests) == 1


def test_it_gives_up(line, monkeypatch, capsys):
    monkeypatch.setattr(transport, "PATIENCE_S", -1.0)
    between = line(lambda connection, request: None)
    with Client(Settings(url=between.url)) as client, pytest.raises(ServiceError, match="no service answers"):
        client.get("/v1/runs")
    assert len(between.requests) == 1
    assert capsys.readouterr().err == ""


def test_a_service_that_was_never_there_is_not_waited_for():
    with Client(Settings(url=f"http://127.0.0.1:{free_port()}")) as client, pytest.raises(ServiceError):
        client.post("/v1/runs", {})
