"""`hrs` in this process: another one takes seconds to start, and that one does is shown by the tests that start it."""

from __future__ import annotations

import contextlib
import subprocess
from pathlib import Path

from typer.testing import CliRunner

from api.cli.main import app
from station import StationError
from theory import TheoryError


def hrs(*arguments: object, cwd: Path | None = None, **variables: str) -> subprocess.CompletedProcess[str]:
    """What `hrs` with these arguments ends with and prints, as `api.cli.main.main` would."""
    with contextlib.chdir(cwd) if cwd else contextlib.nullcontext():
        done = CliRunner().invoke(app, [*map(str, arguments)], env=variables)
    status, said = done.exit_code, done.stderr
    if isinstance(done.exception, StationError | TheoryError):
        status, said = 2, f"{said}error: {done.exception}\n"
    elif done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return subprocess.CompletedProcess(["hrs", *arguments], status, done.stdout, said)
