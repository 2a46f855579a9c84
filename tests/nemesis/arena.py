"""The processes that faults are injected into: the service with its workers, its store, a router, a subscriber."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack, closing, suppress
from pathlib import Path

import httpx

from tests.api.conftest import RunningService, free_port
from tests.nemesis.postgres import Postgres, children, limit_files

LEASE_S = 1.0
"""The shortest lease the settings allow [s]: a freeze is longer at once."""

PATIENCE_S = 120.0
"""So long a service may take to be there again before it counts as lost [s]; it takes some 3 s."""

ROOM_BYTES = 65_536
"""What SQLite's log may grow to on a full disk, and up to five times as much [bytes]: it does so within seconds.

Less is no store at all: its shared memory takes half of it.
"""

SQLITE, POSTGRESQL = "sqlite", "postgresql"


class LostError(AssertionError):
    """Something did not come back without help."""


def until(condition: Callable[[], object], what: str, patience_s: float = PATIENCE_S) -> None:
    """Wait for a condition; LostError if it never holds."""
    end = time.monotonic() + patience_s
    while not condition():
        if time.monotonic() > end:
            raise LostError(f"{what}: not within {patience_s:g} s")
        time.sleep(0.05)


class Module:
    """A module of this folder as a process; it says when it is ready, and ends when its input does."""

    def __init__(self, name: str, *arguments: object) -> None:
        self._command = [sys.executable, "-m", f"tests.nemesis.{name}", *map(str, arguments)]
        self.start()

    def start(self) -> None:
        """Start it and wait until it is ready."""
        self.process = subprocess.Popen(self._command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout.readline() == "ready\n"

    def kill(self) -> None:
        """As a power cut would."""
        self.process.kill()
        self.process.communicate()

    def stop(self) -> None:
        """Let it end."""
        self.process.communicate(timeout=PATIENCE_S)


class Arena:
    """Everything that runs, on one kind of store."""

    def __init__(self, folder: Path, store: str) -> None:
        self.folder = folder
        self.store = store
        self.said: list[str] = []
        self.heard = folder / "heard.jsonl"
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        settings = {"ZENOH_CONNECT": self.endpoint, "LEASE_S": LEASE_S, "CHECKPOINT_S": 0.5, "WORKERS": 2}
        with ExitStack() as started:
            self.postgres = started.enter_context(closing(Postgres())) if store == POSTGRESQL else None
            if self.postgres is not None:
                settings["DATABASE"] = self.postgres.url
            self.router = Module("router", self.endpoint)
            started.callback(self.router.kill)
            self.listener = Module("listener", self.endpoint, self.heard)
            started.callback(self.listener.kill)
            self.service = RunningService(folder, **{f"HRS_{name}": str(value) for name, value in settings.items()})
            started.callback(self.kill_all)
            self.close = started.pop_all().close  # ends everything, the last first

    @property
    def given_url(self) -> str:
        """The service's database as its settings take it."""
        return f"sqlite:///{self.folder / 'hrs.db'}" if self.postgres is None else self.postgres.url

    @property
    def database_url(self) -> str:
        """The service's database as SQLAlchemy writes it."""
        return self.given_url.replace("postgresql://", "postgresql+psycopg://")

    def forkserver(self) -> int | None:
        """The process whose children the workers are."""
        names = ("forkserver", "copy_on_request")  # the latter where the service is a copy (tests.warm)
        return next((pid for pid in children(self.service.process.pid) if any(n in _words(pid) for n in names)), None)

    def workers(self) -> list[int]:
        """The processes that compute."""
        parent = self.forkserver()
        return [] if parent is None else children(parent)

    def _session(self) -> list[int]:
        """Processes of the server's session, itself among them."""
        done = subprocess.run(
            ["/bin/ps", "-o", "pid=", "-s", str(self.service.process.pid)], capture_output=True, text=True, check=False
        )
        return [int(line) for line in done.stdout.split()]

    def limit_files(self, room: int) -> None:
        """Let no file of the store grow beyond `room` [bytes]; -1 for no limit."""
        if self.postgres is not None:
            self.postgres.limit_files(room)
        else:
            limit_files(self._session(), room)

    def room(self, choice: float) -> int:
        """How large a file of the store may become on a full disk [bytes]."""
        return int(ROOM_BYTES * (1 + 4 * choice)) if self.postgres is None else self.postgres.room()

    def start(self, room: int = -1) -> None:
        """Start the service, again and again as a supervisor does, until it stays; `room` as for `limit_files`."""
        wrapper: tuple[str, ...] = ()
        if room >= 0 and self.postgres is None:
            wrapper = ("prlimit", f"--fsize={room}:")
        elif room >= 0:
            self.limit_files(room)
        until(lambda: self.started(*wrapper), "the service does not start")

    def started(self, *wrapper: str) -> bool:
        """Whether the service stays when it is started."""
        self.said += self.service.said
        hanging = threading.Timer(PATIENCE_S, self._kill_session)
        hanging.start()
        try:
            self.service.start(*wrapper)
        except AssertionError:
            time.sleep(0.5)
            return False
        finally:
            hanging.cancel()
        return True

    def kill_all(self) -> None:
        """Kill the server with its workers, as a power cut would."""
        self._kill_session()
        self.service.kill()

    def _kill_session(self) -> None:
        with suppress(ProcessLookupError):
            os.killpg(self.service.process.pid, signal.SIGKILL)

    def stop_service(self) -> int:
        """Ask the service to end; its status."""
        self.service.stop()
        return self.service.process.returncode

    def ready(self) -> bool:
        """Whether the service says that it is."""
        with suppress(httpx.HTTPError):
            return httpx.get(f"{self.service.url}/readyz", timeout=5, trust_env=False).status_code == httpx.codes.OK
        return False


def _words(process: int) -> str:
    with suppress(OSError):
        return Path(f"/proc/{process}/cmdline").read_bytes().replace(b"\0", b" ").decode()
    return ""
