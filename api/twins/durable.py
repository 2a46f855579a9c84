"""How live twins are commanded: their own thread obeys, and who asked is answered when it is stored."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as LateError
from typing import Any

from api.http.problems import conflict
from api.settings import Settings
from api.store.database import StoreError
from api.store.patience import LEAST_S, REQUEST_S, left_s
from api.store.records import NotDurableYet, StoredResponse
from api.store.twins import TwinRepository
from api.twins.checkpointer import Checkpointer
from api.twins.live import LiveTwin
from api.twins.queries import TwinQueries
from api.twins.schemas import ALIVE
from api.twins.shown import state_of
from api.twins.state_schemas import TwinState

CheckState = Callable[[TwinState], None] | None
"""Raises unless a twin is in a state that the asker expects."""

STORED_S = REQUEST_S
"""Longest wait of an answer until the store has what it states [s]."""

KeepAnswer = Callable[[TwinState], StoredResponse] | None
"""Makes the answer that is kept under an idempotency key."""


class DurableCommands(TwinQueries):
    """What every command to a live twin needs."""

    def __init__(self, store: TwinRepository, settings: Settings) -> None:
        super().__init__(store)
        self._settings = settings
        self._checkpointer = Checkpointer(store)
        self._lock = threading.RLock()
        self.on_removed: Callable[[str], None] = lambda _: None  # hears the id of a twin that has been forgotten

    def _checked(self, twin: LiveTwin, check_state: CheckState) -> Callable[[], None]:
        """The check of a twin's state as its own thread does it: without the store."""
        if check_state is None:
            return _nothing
        stored = self._stored(twin.id)
        return lambda: check_state(state_of(stored, twin, None))

    def _alive(self, twin_id: str) -> LiveTwin:
        twin = self._live.get(twin_id)
        if twin is None or twin.state not in ALIVE:
            raise conflict(f"twin {twin_id!r} is {self._ended(twin_id).state}")
        return twin

    def _ended(self, twin_id: str) -> TwinState:
        """A twin that does not live here; a StoreError where it should, and waits for the store to go on."""
        state = self.state(twin_id)
        if state.state in ALIVE and twin_id in self._elsewhere:
            raise conflict(f"twin {twin_id!r} runs elsewhere now")
        if state.state in ALIVE:
            raise StoreError(f"twin {twin_id!r} waits for the database")
        return state

    def _wait_for(self, stored: Future[None]) -> None:
        """Wait until a command is stored: a service that is killed before it is would forget it."""
        try:
            stored.result(LEAST_S if self._store.silent else min(STORED_S, left_s()))
        except LateError:
            raise NotDurableYet(stored) from None


def _nothing() -> None:
    """Nobody wants to know."""


def ask(twin: LiveTwin, command: Callable[[], Any]) -> Any:
    """What a command returns that the twin's own thread obeys; a conflict where it is busy."""
    try:
        return twin.ask(command)
    except LateError:
        raise conflict(f"twin {twin.id!r} is busy: it has not answered within 5 s") from None
