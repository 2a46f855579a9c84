"""A service of its own for a measurement: `hrs serve` in a process, with a fresh database."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import httpx

from controllers.registry import compile_all


def free_port() -> int:
    """A port nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Service:
    """A running service; it can be killed and started again on the same database."""

    def __init__(self, data: str, *options: str) -> None:
        for name in compile_all():  # here: a service would beside its work, and refuse what needs them meanwhile
            sys.stderr.write(f"{name} is compiled\n")
        self.port = free_port()
        self.url = f"http://127.0.0.1:{self.port}"
        self.zenoh = f"tcp/127.0.0.1:{free_port()}"
        self._command = [
            str(Path(sys.executable).with_name("hrs")), "serve", "--port", str(self.port), "--data", data,
            "--zenoh-listen", self.zenoh, *options,
        ]  # fmt: skip
        self.process: subprocess.Popen[bytes]
        self._http = httpx.Client(base_url=self.url, timeout=30, trust_env=False)

    def start(self, asked: str = "/v1/twins") -> float:
        """Start it; seconds until this path is answered with success."""
        began = time.perf_counter()
        self.process = subprocess.Popen(self._command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        while True:
            try:
                if self._http.get(asked).is_success:
                    return time.perf_counter() - began
            except httpx.TransportError:
                if self.process.poll() is not None:
                    raise RuntimeError("the service did not start") from None
            time.sleep(0.01)

    def kill(self) -> None:
        """As a power cut would."""
        self.process.kill()
        self.process.wait()

    def stop(self) -> float:
        """Ask it to stop; seconds until it has."""
        began = time.perf_counter()
        self.process.terminate()
        self.process.wait(30)
        return time.perf_counter() - began

    def close(self) -> None:
        """Forget its connections."""
        self._http.close()

    def cpu(self) -> float:
        """CPU time the server itself has used, all threads [s]."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def request(self, method: str, path: str, document: Any = None) -> Any:
        """A request that must succeed."""
        answer = self._http.request(method, path, json=document)
        answer.raise_for_status()
        return answer.json() if answer.content else None


@contextmanager
def served(*options: str) -> Iterator[Service]:
    """A service on a fresh database, stopped at the end."""
    with TemporaryDirectory() as data:
        service = Service(data, *options)
        service.start()
        try:
            yield service
        finally:
            service.stop()
            service.close()
