"""`hrs` as a process of its own that has imported already: a copy of one that has.

A start of the service costs some three seconds of a core, nearly all of them imports. One process imports once and
forks on request; a copy has its own session, environment, folder and outputs, and ends as `hrs` does. What is proved of
starting itself starts `hrs` anew: tests give a wrapper or `PYTHON...` and `NUMBA_...` variables, or call `HRS`.
"""

from __future__ import annotations

import atexit
import contextlib
import fcntl
import gc
import json
import os
import select
import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path

HRS = Path(sys.executable).with_name("hrs")
ROOT = Path(__file__).resolve().parent.parent

ENDS_S = 180.0
"""A command that has not ended by then hangs, however loaded the machine is [s]."""

READ_AT_START = ("PYTHON", "NUMBA_", "XDG_", "LD_", "OPENBLAS_", "OMP_", "MALLOC_")
"""Beginnings of variables that are read while modules are imported."""


class Copy:
    """A process forked from the one that has imported: what `subprocess.Popen` is to one that was executed."""

    def __init__(self, link: socket.socket, stdout, stderr) -> None:
        self._link = link
        self._file = link.makefile("r")
        self._lock = threading.Lock()
        self.pid = int(self._file.readline())
        self.returncode: int | None = None
        self.stdin, self.stdout, self.stderr = None, stdout, stderr

    def poll(self) -> int | None:
        """Its exit status, or None while it runs."""
        with self._lock:
            if self.returncode is None and select.select([self._link], [], [], 0)[0]:
                self._end()
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Wait until it has ended; subprocess.TimeoutExpired if that takes longer."""
        if self.returncode is None:
            ended = select.select([self._link], [], [], timeout)[0]
            if not ended:
                raise subprocess.TimeoutExpired(["hrs"], timeout or 0)
            self.poll()
        return self.returncode

    def _end(self) -> None:
        self.returncode = os.waitstatus_to_exitcode(int(self._file.readline()))
        self._file.close()
        self._link.close()

    def send_signal(self, number: int) -> None:
        """Send a signal, unless it has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def terminate(self) -> None:
        """SIGTERM."""
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """SIGKILL."""
        self.send_signal(signal.SIGKILL)

    def communicate(self, timeout: float | None = None) -> tuple[str, str]:
        """All it prints until it has ended."""
        said = {}

        def read(name: str) -> None:
            with getattr(self, name) as stream:
                said[name] = stream.read()

        readers = [threading.Thread(target=read, args=(name,)) for name in ("stdout", "stderr") if getattr(self, name)]
        for reader in readers:
            reader.start()
        self.wait(timeout)
        for reader in readers:
            reader.join(timeout)
        return said.get("stdout", ""), said.get("stderr", "")


class _Parent:
    """The process that has imported; there is one for a process of tests, from the first request on."""

    def __init__(self) -> None:
        self._ours, theirs = socket.socketpair()
        command = [sys.executable, "-c", f"from tests.warm import copy_on_request; copy_on_request({theirs.fileno()})"]
        self._process = subprocess.Popen(command, pass_fds=[theirs.fileno()], cwd=ROOT, stdin=subprocess.DEVNULL)
        theirs.close()
        self._lock = threading.Lock()
        atexit.register(self._ours.close)

    def copy(self, arguments: list[str], environment: dict[str, str], folder: Path, *, stderr_apart: bool) -> Copy:
        link, theirs = socket.socketpair()
        out, out_end = os.pipe()
        errors, errors_end = os.pipe() if stderr_apart else (None, os.dup(out_end))
        message = json.dumps({"arguments": arguments, "environment": environment, "folder": str(folder)}).encode()
        with self._lock:
            ends = [theirs.fileno(), out_end, errors_end]
            socket.send_fds(self._ours, [len(message).to_bytes(4, "big")], ends)
            self._ours.sendall(message)
        theirs.close()
        os.close(out_end)
        os.close(errors_end)
        read = None if errors is None else os.fdopen(errors, encoding="utf-8")
        return Copy(link, os.fdopen(out, encoding="utf-8"), read)


_parents: list[_Parent] = []


def start_hrs(
    *arguments: object, wrapper: tuple[str, ...] = (), cwd: Path | None = None, stderr_apart: bool = False,
    **variables: str,
) -> subprocess.Popen[str] | Copy:  # fmt: skip
    """`hrs` with these arguments, whose output can be read; in a session of its own.

    It is executed anew where a program that becomes it is given as `wrapper`, or a variable that is read at start.
    """
    given = {**os.environ, **variables}
    words = [os.fsdecode(argument) if isinstance(argument, bytes) else str(argument) for argument in arguments]
    if wrapper or not hasattr(os, "pidfd_open") or any(name.startswith(READ_AT_START) for name in variables):
        return subprocess.Popen(
            [*wrapper, HRS, *words], text=True, env=given, cwd=cwd, start_new_session=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE if stderr_apart else subprocess.STDOUT,
        )  # fmt: skip
    if not _parents:
        _parents.append(_Parent())
    return _parents[0].copy(words, given, cwd or Path.cwd(), stderr_apart=stderr_apart)


def run_hrs(*arguments: object, cwd: Path | None = None, timeout: float = ENDS_S, **variables: str):
    """`hrs` with these arguments, waited for; killed, and subprocess.TimeoutExpired, after `timeout` [s]."""
    process = start_hrs(*arguments, cwd=cwd, stderr_apart=True, **variables)
    try:
        out, errors = process.communicate(timeout)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        raise
    return subprocess.CompletedProcess(["hrs", *map(str, arguments)], process.returncode, out, errors)


def copy_on_request(requests: int) -> None:
    """Import what `hrs` does, then fork for each request until the other end of `requests` is closed."""
    _import()
    gc.collect()
    gc.freeze()  # no collection of a copy writes to what it shares with the others
    asked = socket.socket(fileno=requests)
    running: dict[int, tuple[int, socket.socket]] = {}
    waiting = select.poll()
    waiting.register(asked, select.POLLIN)
    while True:
        for ready, _ in waiting.poll():
            if ready != asked.fileno():
                child, link = running.pop(ready)
                waiting.unregister(ready)
                os.close(ready)
                with contextlib.suppress(OSError):  # whoever asked for it has gone
                    link.sendall(f"{os.waitpid(child, 0)[1]}\n".encode())
                link.close()
                continue
            size, ends, *_ = socket.recv_fds(asked, 4, 3)
            if not size:
                return
            message = json.loads(_received(asked, int.from_bytes(size, "big")))
            child = os.fork()
            if child == 0:
                for inherited in (asked, *(link for _, link in running.values())):
                    inherited.close()
                for pidfd in running:
                    os.close(pidfd)
                _become_hrs(message, ends)
                return
            link = socket.socket(fileno=ends[0])
            for end in ends[1:]:
                os.close(end)
            pidfd = os.pidfd_open(child)
            running[pidfd] = child, link
            waiting.register(pidfd, select.POLLIN)
            link.sendall(f"{child}\n".encode())


def _import() -> None:
    import alembic.command
    import psycopg
    import zenoh

    import api.cli.serve
    import api.client
    import api.controllers.service
    import api.store.database
    import controllers.registry

    for name in controllers.registry.controllers():
        api.controllers.service.about(name)
        controllers.registry.is_ready(name)
    del alembic, psycopg, zenoh


def _received(asked: socket.socket, size: int) -> bytes:
    message = b""
    while len(message) < size:
        message += asked.recv(size - len(message))
    return message


def _become_hrs(message: dict, ends: list[int]) -> None:
    from api.cli.main import main

    os.setsid()
    os.chdir(message["folder"])
    os.environ.clear()
    os.environ.update(message["environment"])
    link, out, errors = ends
    os.dup2(out, 1)
    os.dup2(errors, 2)
    for end in {link, out, errors} - {1, 2}:
        os.close(end)
    sys.argv = [str(HRS), *message["arguments"]]
    if sys.argv[1:2] == ["serve"]:
        _keep_a_fork_server()
    main()


def _keep_a_fork_server() -> None:
    """Let the fork server that workers come from be a copy, too, made before there are threads."""
    from multiprocessing import util

    ours, theirs = socket.socketpair()
    waiting = os.fork()
    if waiting == 0:
        ours.close()
        _become_fork_server(theirs)
    theirs.close()
    execute = util.spawnv_passfds

    def spawn(path, args, passfds):
        if "multiprocessing.forkserver" not in str(args[-1]) or ours.fileno() < 0:
            return execute(path, args, passfds)
        socket.send_fds(ours, [json.dumps([args[-1], passfds]).encode()], passfds)
        ours.close()
        return waiting

    util.spawnv_passfds = spawn


def _become_fork_server(asked: socket.socket) -> None:
    """Do what the fork server's command does, with the descriptors by the numbers that it has there."""
    said, given, *_ = socket.recv_fds(asked, 1 << 16, 2)
    if not said:
        os._exit(0)
    command, numbers = json.loads(said)
    above = [fcntl.fcntl(descriptor, fcntl.F_DUPFD_CLOEXEC, max(numbers) + 1) for descriptor in given]
    for descriptor in given:
        os.close(descriptor)
    asked.close()
    for descriptor, number in zip(above, numbers, strict=True):
        os.dup2(descriptor, number, inheritable=False)
        os.close(descriptor)
    exec(command, {})  # noqa: S102  # what Python would be executed with
    os._exit(0)
