"""A PostgreSQL server of the nemesis's own, which may be restarted, crashed and filled."""

from __future__ import annotations

import os
import pwd
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from tests.api.conftest import program

ACCOUNT = "postgres"
"""Who runs it where the tests run as root, which PostgreSQL refuses to."""

WAL_BYTES = 1_048_576
"""Size of a file of its log [bytes]; data files may be limited to no less without stopping the server altogether."""


class Postgres:
    """Server in a folder of its own, on a socket there."""

    def __init__(self) -> None:
        self._as = ("runuser", "-u", ACCOUNT, "--") if os.geteuid() == 0 else ()
        self._folder = Path(tempfile.mkdtemp(prefix="hrs-nemesis-pg-"))
        if self._as:
            account = pwd.getpwnam(ACCOUNT)
            os.chown(self._folder, account.pw_uid, account.pw_gid)
        self._data = self._folder / "data"
        self.url = f"postgresql://postgres@/postgres?host={self._folder}"
        self._call("initdb", "-D", self._data, "-U", "postgres", "-A", "trust", "--wal-segsize=1")
        self.start()

    def _call(self, name: str, *arguments: object) -> None:
        command = [*self._as, program(name), *map(str, arguments)]
        # Into a file: a pipe would stay open in the server that pg_ctl leaves behind.
        with tempfile.TemporaryFile() as said:
            done = subprocess.run(command, stdin=subprocess.DEVNULL, stdout=said, stderr=said, cwd="/", check=False)
            said.seek(0)
            assert done.returncode == 0, said.read().decode()

    def start(self) -> None:
        """Start it and wait until it answers."""
        options = f"-k {self._folder} -c listen_addresses='' -c max_connections=60"
        self._call("pg_ctl", "start", "-D", self._data, "-w", "-t", 60, "-o", options, "-l", self._folder / "log")

    def stop(self, mode: str) -> None:
        """Stop it: `fast` closes every connection, `immediate` is a crash that the next start recovers from."""
        self._call("pg_ctl", "stop", "-D", self._data, "-w", "-t", 60, "-m", mode)

    def processes(self) -> list[int]:
        """The server's processes, the first of them before those that it has started."""
        first = int((self._data / "postmaster.pid").read_text().split()[0])
        return [first, *children(first)]

    @contextmanager
    def frozen(self) -> Iterator[None]:
        """Stand still while the block runs: its sockets stay open, and nothing answers."""
        frozen: list[int] = []
        for _ in range(3):  # it may just have started another
            frozen += [process for process in self.processes() if process not in frozen]
            signalled(frozen, signal.SIGSTOP)
        try:
            yield
        finally:
            signalled(frozen, signal.SIGCONT)

    def limit_files(self, room: int) -> None:
        """As for `limit_files`, of the server and its processes."""
        limit_files(self.processes(), room, self._as)

    def room(self) -> int:
        """Size of the largest data file [bytes], and no less than what its log needs."""
        sizes = (path.stat().st_size for path in self._data.glob("base/*/*") if path.is_file())
        return max(WAL_BYTES, *sizes)

    def close(self) -> None:
        """Stop it for good."""
        try:
            self.stop("immediate")
        finally:
            shutil.rmtree(self._folder)


def signalled(processes: Iterable[int], number: signal.Signals) -> None:
    """Send a signal to those that are still there."""
    for process in processes:
        with suppress(ProcessLookupError):
            os.kill(process, number)


def children(process: int) -> list[int]:
    """Processes that a process has started."""
    with suppress(OSError):
        return list(map(int, Path(f"/proc/{process}/task/{process}/children").read_text().split()))
    return []


def limit_files(processes: Iterable[int], room: int, account: Sequence[str] = ()) -> None:
    """Let no file of these processes grow beyond `room` [bytes], -1 for no limit; those that are gone are left out."""
    limit = f"--fsize={room if room >= 0 else 'unlimited'}:"
    for process in processes:
        subprocess.run([*account, "prlimit", "--pid", str(process), limit], check=False, capture_output=True, cwd="/")


def missing() -> str:
    """Why no PostgreSQL server can be started here; empty if one can."""
    if program("initdb") is None or program("pg_ctl") is None:
        return "PostgreSQL is not installed"
    if os.geteuid() != 0:
        return ""
    try:
        pwd.getpwnam(ACCOUNT)
    except KeyError:
        return f"root cannot run PostgreSQL, and there is no account {ACCOUNT}"
    return "" if shutil.which("runuser") else "root cannot run PostgreSQL without runuser"
