"""The service's zenoh session, which is replaced when the keys change that clients log in with."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence

import zenoh

from api.settings import Settings
from api.store.database import StoreError
from api.store.records import Key
from api.telemetry.access import Login, logins, read_secret
from api.telemetry.session import connected, open_session
from station import InputError

log = logging.getLogger(__name__)

KEYS_EVERY_S = 2.0
"""How often it is looked whether keys were made or revoked [s]."""

Rebind = Callable[[Callable[[], zenoh.Session]], None]
"""Given a function that ends the session there is and opens the next, calls it and goes on with what it returns."""


class SessionManager:
    """Holds the session and replaces it.

    zenoh reads users and rules when a session is opened. A key that is made or revoked therefore closes the session
    and opens the next within `KEYS_EVERY_S`: every client is cut off, and eclipse-zenoh connects again by itself where
    its key still holds.
    """

    def __init__(self, settings: Settings, keys: Callable[[], Sequence[Key]]) -> None:
        self._settings = settings
        self._keys = keys
        self._session: zenoh.Session | None = None
        self._admitted: list[Login] = []
        self._ending = threading.Event()
        self._watcher: threading.Thread | None = None

    def open(self) -> None:
        """Open the session, unless it is open. Raises InputError where that cannot be."""
        if self._session is None:
            self._admitted = self._valid()
            self._session = open_session(self._settings, self._admitted)

    @property
    def session(self) -> zenoh.Session:
        """The session; a closed one is replaced, so it should not be kept."""
        if self._session is None:
            raise RuntimeError("the session was never opened")
        return self._session

    def fails(self) -> str:
        """The fault of the session; empty if there is none."""
        good = self._session is not None and connected(self._session, self._settings)
        return "" if good else "session is closed, or its router is gone"

    def watch(self, rebind: Rebind) -> None:
        """Look after the keys from now on, where any are asked for."""
        if self._settings.zenoh_keys_required:
            self._watcher = threading.Thread(target=self._watch, args=(rebind,), name="zenoh-session", daemon=True)
            self._watcher.start()

    def stop_watching(self) -> None:
        """Let the session be what it is: who moves with it is about to go."""
        self._ending.set()
        if self._watcher is not None:
            self._watcher.join()

    def close(self) -> None:
        """Close the session: one that stays open keeps the process."""
        self.stop_watching()
        if self._session is not None:
            self._session.close()

    def _watch(self, rebind: Rebind) -> None:
        while not self._ending.wait(KEYS_EVERY_S):
            try:
                self.look(rebind)
            except (StoreError, InputError) as error:  # whoever was let in stays in until that can be told
                log.warning("zenoh: %s", error)

    def look(self, rebind: Rebind) -> None:
        """Open the session anew if other keys are valid now, or if it could not be opened before."""
        valid = self._valid()
        if valid == self._admitted and not self.session.is_closed():
            return
        log.info("zenoh: keys have changed; the router is opened anew, for %d of them", len(valid))

        def reopen() -> zenoh.Session:
            self.session.close()
            self._session = open_session(self._settings, valid)
            self._admitted = valid
            return self._session

        rebind(reopen)

    def _valid(self) -> list[Login]:
        return logins(self._keys(), read_secret(self._settings)) if self._settings.zenoh_keys_required else []
