"""Databases the tests of the service run on: SQLite, and PostgreSQL where a server can be found or started."""

from __future__ import annotations

import os
import secrets
import shutil
import signal
import socket
import subprocess
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest
import sqlalchemy as sa

from api.store.database import Database
from tests.api.measured import ORDER
from tests.api.reopened import opening
from tests.waiting import wait_until
from tests.warm import Copy, start_hrs

SERVER = os.environ.get("HRS_TEST_POSTGRES", "postgresql://postgres@127.0.0.1:5432/postgres")


def _answers(url: str) -> bool:
    engine = sa.create_engine(
        url.replace("postgresql://", "postgresql+psycopg://"), connect_args={"connect_timeout": 3}
    )
    try:
        with engine.connect():
            return True
    except sa.exc.OperationalError:
        return False
    finally:
        engine.dispose()


def program(name: str) -> str | None:
    """Where a program of PostgreSQL is."""
    places = sorted(Path("/usr/lib/postgresql").glob(f"*/bin/{name}"))
    return str(places[-1]) if places else shutil.which(name)


@pytest.fixture(scope="session")
def postgres_server(tmp_path_factory):
    """URL of a PostgreSQL server that may be written to: one that runs, or one started here."""
    if _answers(SERVER):
        yield SERVER
        return
    initdb, postgres = program("initdb"), program("postgres")
    if not initdb or not postgres or os.geteuid() == 0:
        pytest.skip("no PostgreSQL server answers at HRS_TEST_POSTGRES, and none can be started here")
    folder = tmp_path_factory.mktemp("postgres")
    subprocess.run([initdb, "-D", folder / "data", "-U", "postgres", "-A", "trust"], check=True, capture_output=True)
    command = [postgres, "-D", folder / "data", "-k", folder, "-c", "listen_addresses="]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    url = f"postgresql://postgres@/postgres?host={folder}"
    try:
        for _ in range(100):
            if _answers(url):
                break
            process.poll() is None or pytest.fail("PostgreSQL did not start")
        yield url
    finally:
        process.terminate()
        process.wait(10)


@contextmanager
def _empty_database(server):
    """URL of an empty PostgreSQL database. Its commits wait for no disk: a busy one would look like a silent server."""
    name = f"hrs_test_{secrets.token_hex(6)}"
    url = sa.make_url(server.replace("postgresql://", "postgresql+psycopg://"))
    engine = sa.create_engine(url, isolation_level="AUTOCOMMIT")
    with engine.connect() as connection:
        connection.execute(sa.text(f"CREATE DATABASE {name}"))
        connection.execute(sa.text(f"ALTER DATABASE {name} SET synchronous_commit = off"))
    yield url.set(database=name).render_as_string(hide_password=False)
    with engine.connect() as connection:
        connection.execute(sa.text(f"DROP DATABASE {name} WITH (FORCE)"))
    engine.dispose()


@pytest.fixture
def postgres_url(postgres_server):
    """URL of an empty PostgreSQL database."""
    with _empty_database(postgres_server) as url:
        yield url


@pytest.fixture(scope="module")
def module_postgres_url(postgres_server):
    """URL of an empty PostgreSQL database, for the tests of a file."""
    with _empty_database(postgres_server) as url:
        yield url


@pytest.fixture(params=["sqlite", "postgresql"])
def database_url(request, tmp_path):
    """URL of an empty database, as the setting `database` takes it."""
    if request.param == "sqlite":
        return f"sqlite:///{tmp_path / 'hrs.db'}"
    return request.getfixturevalue("postgres_url")


@pytest.fixture(params=["sqlite", pytest.param("postgresql", marks=pytest.mark.slow)])
def long_database_url(request, tmp_path):
    """As `database_url`, for tests that take half a minute on each: PostgreSQL with the slow ones."""
    if request.param == "sqlite":
        return f"sqlite:///{tmp_path / 'hrs.db'}"
    return request.getfixturevalue("postgres_url")


@pytest.fixture
def database(database_url):
    """An empty database with this version's tables."""
    yield from _migrated(database_url)


@pytest.fixture
def long_database(long_database_url):
    """As `database`, on PostgreSQL with the slow tests."""
    yield from _migrated(long_database_url)


def _migrated(url):
    opened = Database(url)
    opened.migrate()
    yield opened
    opened.close()


@pytest.fixture
def opened(tmp_path):
    """Opens the twins of one server again and again, on SQLite."""
    store = Database(f"sqlite:///{tmp_path / 'hrs.db'}")
    store.migrate()
    with opening(store, checkpoint_s=0.1) as make:
        yield make
    store.close()


PORTS = range(12_000, 32_000)
"""Below those that connections are given, so that none takes a port between its choice and its use."""


CHOSEN: set[int] = set()
"""Ports that this process has given away: one may be chosen some time before it is listened on."""


def free_port() -> int:
    """A port nobody listens on, and that no other process of these tests chooses, nor this one again."""
    workers = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
    while True:
        port = secrets.choice(PORTS[worker::workers])
        if port in CHOSEN:
            continue
        with socket.socket() as probe:
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
        CHOSEN.add(port)
        return port


class RunningService:
    """`hrs serve` in a process of its own."""

    def __init__(self, data: Path, *options: str, prefix: tuple[str, ...] = (), **variables: str) -> None:
        self.zenoh = f"tcp/127.0.0.1:{free_port()}"
        self.port = free_port()
        self.database = variables.get("HRS_DATABASE", f"sqlite:///{data / 'hrs.db'}")
        self._arguments = ["serve", "--port", self.port, "--data", data, "--zenoh-listen", self.zenoh, *options]
        self._variables = variables
        self.url = f"http://127.0.0.1:{self.port}"
        self.process: subprocess.Popen[str] | Copy
        self.start(*prefix)

    def start(self, *wrapper: str) -> None:
        """Start it, by a program that becomes it if one is given, and wait until it says that it is ready."""
        self.process = start_hrs(*self._arguments, wrapper=wrapper, **self._variables)
        self.said: list[str] = []
        for line in self.process.stdout:
            self.said.append(line)
            if line.startswith("  data") or '"message": "hrs-twin is ready"' in line:
                break
        else:
            self.process.stdout.close()
            self.process.wait(20)
            raise AssertionError("".join(self.said))
        self._listener = threading.Thread(target=self._listen, args=(self.process.stdout,), daemon=True)
        self._listener.start()

    def _listen(self, stream) -> None:
        with stream:
            self.said.extend(stream)

    def kill(self) -> None:
        """As a power cut would."""
        self.process.kill()
        self.process.wait(10)
        self._listener.join(10)

    def stop(self, *, group: bool = False) -> float:
        """Ask it to stop, or all processes of its group as a terminal or a supervisor may; how long it took [s]."""
        began = time.monotonic()
        (os.killpg if group else os.kill)(self.process.pid, signal.SIGTERM)
        self.process.wait(20)
        took = time.monotonic() - began
        self._listener.join(10)
        return took

    def group(self) -> list[str]:
        """Processes of its session that are still there."""
        done = subprocess.run(
            ["/bin/ps", "-o", "pid=,stat=,args=", "-s", str(self.process.pid)],
            capture_output=True,
            text=True,
            check=False,
        )
        return [line for line in done.stdout.splitlines() if " Z" not in line]


@pytest.fixture(scope="module")
def service(tmp_path_factory, request):
    """A running service with an embedded database, for the tests of a file; `WORKERS = 0` there if it runs no jobs."""
    workers = getattr(request.module, "WORKERS", None)
    options = () if workers is None else ("--workers", str(workers))  # their imports take a core two seconds
    running = RunningService(tmp_path_factory.mktemp("service"), *options)
    yield running
    running.stop()


@pytest.fixture(scope="module")
def http(service):
    """HTTP to the running service."""
    with httpx.Client(base_url=service.url, timeout=30, trust_env=False) as client:
        yield client


def ended(http, path, seconds=60.0):
    """Poll a job until it has ended."""
    until = time.monotonic() + seconds
    while (job := http.get(path).json())["finished"] is None:
        assert time.monotonic() < until, job
        time.sleep(0.05)
    return job


@pytest.fixture
def measured_twin(http):
    """The id of a twin that follows measurements and has had none; it is forgotten behind the test."""
    twin_id = f"m{secrets.randbelow(10**9)}"
    assert http.post("/v1/twins", json={**ORDER, "id": twin_id}).status_code == 201
    yield twin_id
    http.post(f"/v1/twins/{twin_id}/stop")  # 503 where a busy machine has not stored it yet: it ends soon
    wait_until(lambda: http.delete(f"/v1/twins/{twin_id}").status_code == 204)
