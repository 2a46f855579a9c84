"""Who may use a server of twins: everybody on loopback, elsewhere who has a key of the service."""

from __future__ import annotations

import hashlib
import time
from typing import Any

import httpx
from asyncua.crypto.permission_rules import User, UserRole
from asyncua.server.user_managers import UserManager

from station import StationError

_READER = User(role=UserRole.User)
"""May read, browse and subscribe; nobody may write, since no node lets a reader."""

VALID_S = 60.0
"""So long a key that the service has accepted is not asked about again, and one that is revoked still works [s]."""

ANSWER_S = 2.0
"""A service that has not said so soon whether a key is valid refuses [s]; the server waits in the meantime."""

KEYS_MAX = 1000
"""Keys that are remembered."""


class Readers(UserManager):  # type: ignore[misc]  # asyncua is Any here
    """Lets everybody read: programs of this machine."""

    def get_user(self, *_: Any, **__: Any) -> User | None:
        """A reader, whoever it is."""
        return _READER


class KeyHolders(UserManager):  # type: ignore[misc]  # likewise
    """Lets those read whose password is a key of the service; their name is not looked at.

    Parameters
    ----------
    url
        Of the service.

    Raises
    ------
    StationError
        if the service asks nobody for a key, so that it cannot say whose is valid.
    """

    def __init__(self, url: str) -> None:
        self._url = url
        self._until: dict[bytes, float] = {}  # by digest of a key
        try:
            if self._answer("") == httpx.codes.OK:
                raise StationError(f"the service at {url} asks nobody for a key: nobody could be refused")
        except httpx.HTTPError as error:
            raise StationError(f"no service answers at {url} ({error})") from None

    def _answer(self, key: str) -> int:
        """The status with which the service answers to a key."""
        headers = {"Authorization": f"Bearer {key}"} if key else {}
        path = f"{self._url.rstrip('/')}/v1/twins"
        return httpx.get(path, params={"limit": 1}, headers=headers, timeout=ANSWER_S, trust_env=False).status_code

    def get_user(
        self, _server: Any, username: str | None = None, password: str | None = None, certificate: Any = None,
    ) -> User | None:  # fmt: skip
        """A reader; None where the password is no key."""
        del username, certificate
        if not password or not password.isascii() or not password.isprintable():
            return None
        digest, now = hashlib.sha256(password.encode()).digest(), time.monotonic()
        if self._until.get(digest, 0.0) > now:
            return _READER
        try:
            valid = self._answer(password) == httpx.codes.OK
        except httpx.HTTPError:
            return None
        if not valid:
            return None
        if len(self._until) >= KEYS_MAX:
            self._until.clear()
        self._until[digest] = now + VALID_S
        return _READER
