"""The claim of one server on a SQLite file: another server on it is refused, and a file that has gone is noticed."""

from __future__ import annotations

import fcntl
import hashlib
import os
from contextlib import suppress
from pathlib import Path

from station import InputError


class Claim:
    """Held from `take` to `release`, or until the process ends.

    Parameters
    ----------
    file
        The database.
    instance
        Name of the server: servers of different names share a database.
    """

    def __init__(self, file: Path, instance: str) -> None:
        self._database = file
        self._file = file.with_name(f"{file.name}-{hashlib.sha256(instance.encode()).hexdigest()[:8]}.lock")
        self._held: int | None = None
        self._identity: tuple[int, int] | None = None

    def take(self) -> None:
        """Claim the file; again, it changes nothing.

        Raises
        ------
        InputError
            if another server holds it.
        """
        if self._held is not None:
            return
        held = os.open(self._file, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(held)
            wrong = f"{self._database} is in use by another service; stop it, or choose another folder"
            raise InputError("settings", [("data", wrong)]) from None
        self._held, self._identity = held, _identity(self._database)

    @property
    def lost(self) -> bool:
        """Whether the file that was claimed is no longer at its place."""
        return self._held is not None and _identity(self._database) != self._identity

    def release(self) -> None:
        """Let another server have it."""
        if self._held is not None:
            os.close(self._held)
            self._held = None


def _identity(file: Path) -> tuple[int, int] | None:
    """Device and inode of a file; None where there is none."""
    with suppress(OSError):
        found = file.stat()
        return found.st_dev, found.st_ino
    return None
