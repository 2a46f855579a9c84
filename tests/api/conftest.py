"""Databases the tests of the service run on: SQLite, and PostgreSQL where a server can be found or started."""

from __future__ import annotations

import os
import secrets
import shutil
import subprocess
from pathlib import Path

import pytest
import sqlalchemy as sa

from api.store.database import Database

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


def _program(name: str) -> str | None:
    places = sorted(Path("/usr/lib/postgresql").glob(f"*/bin/{name}"))
    return str(places[-1]) if places else shutil.which(name)


@pytest.fixture(scope="session")
def postgres_server(tmp_path_factory):
    """URL of a PostgreSQL server that may be written to: one that runs, or one started here."""
    if _answers(SERVER):
        yield SERVER
        return
    initdb, postgres = _program("initdb"), _program("postgres")
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


@pytest.fixture(params=["sqlite", "postgresql"])
def database_url(request, tmp_path):
    """URL of an empty database, as the setting `database` takes it."""
    if request.param == "sqlite":
        yield f"sqlite:///{tmp_path / 'hrs.db'}"
        return
    server = request.getfixturevalue("postgres_server")
    name = f"hrs_test_{secrets.token_hex(6)}"
    url = sa.make_url(server.replace("postgresql://", "postgresql+psycopg://"))
    engine = sa.create_engine(url, isolation_level="AUTOCOMMIT")
    with engine.connect() as connection:
        connection.execute(sa.text(f"CREATE DATABASE {name}"))
    yield url.set(database=name).render_as_string(hide_password=False)
    with engine.connect() as connection:
        connection.execute(sa.text(f"DROP DATABASE {name} WITH (FORCE)"))
    engine.dispose()


@pytest.fixture
def database(database_url):
    """An empty database with this version's tables."""
    opened = Database(database_url)
    opened.migrate()
    yield opened
    opened.close()
