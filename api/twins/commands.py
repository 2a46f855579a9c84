"""Commands to live twins: another speed or controller, a vehicle, to stop; and to delete one that has ended."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from concurrent.futures import TimeoutError as LateError
from typing import Any

from pydantic import ValidationError

from api.controllers.service import check
from api.http.problems import conflict, input_error
from api.settings import Settings
from api.store.database import StoreError
from api.store.patience import LEAST_S, REQUEST_S, left_s
from api.store.records import NotDurableYet, StoredResponse
from api.store.twins import TwinRepository
from api.twins.checkpointer import Checkpointer
from api.twins.live import LiveTwin
from api.twins.queries import TwinQueries
from api.twins.schemas import (
    ALIVE,
    COMMAND,
    Command,
    ContinueCommand,
    ControllerCommand,
    PauseCommand,
    SpeedCommand,
    StopCommand,
    TwinChange,
    TwinState,
    VehicleCommand,
    VehicleRequest,
)
from station import Scenario

REMOTE = "remote"
"""Name of the controller that asks whoever answers the twin's key `decide`."""

CheckState = Callable[[TwinState], None] | None
"""Raises unless a twin is in a state that the asker expects."""

STORED_S = REQUEST_S
"""Longest wait of an answer until the store has what it states [s]."""

KeepAnswer = Callable[[TwinState], StoredResponse] | None
"""Makes the answer that is kept under an idempotency key."""


class TwinCommands(TwinQueries):
    """Commands to live twins; each is done by the twin's own thread, between two seconds, and answered when stored."""

    def __init__(self, store: TwinRepository, settings: Settings) -> None:
        super().__init__(store)
        self._settings = settings
        self._checkpointer = Checkpointer(store)
        self._lock = threading.RLock()

    def change(self, twin_id: str, change: TwinChange, check_state: CheckState = None) -> TwinState:
        """Change speed, controller or pause of a live twin; all or nothing of it.

        `check_state` may raise what refuses the change; nobody else's comes between.

        Raises
        ------
        NotYet
            if that is not stored within 2 s.
        """
        twin = self._alive(twin_id)
        if change.controller is not None:
            self._check_controller(change.controller, [twin.request.scenario])
        checked = self._checked(twin, check_state)

        def apply() -> Future[None]:
            checked()
            if change.controller is not None:
                twin.set_controller(change.controller)
            if change.speed is not None:
                twin.set_speed(change.speed)
            if change.paused is not None:
                (twin.pause if change.paused else twin.continue_)()
            return twin.store_with()

        self._wait_for(_ask(twin, apply))
        return self.state(twin_id)

    def _checked(self, twin: LiveTwin, check_state: CheckState) -> Callable[[], None]:
        """The check of a twin's state as its own thread does it: without the store."""
        if check_state is None:
            return _nothing
        stored = self._stored(twin.id)
        return lambda: check_state(self._state(stored, twin, None))

    def add_vehicle(self, twin_id: str, vehicle: VehicleRequest, keep: KeepAnswer = None) -> TwinState:
        """Let a vehicle arrive at a live twin.

        What `keep` makes of where it stands then is kept with the checkpoint that holds the vehicle.

        Raises
        ------
        NotYet
            if that is not stored within 2 s.
        """
        twin = self._alive(twin_id)
        stored = self._stored(twin_id)

        def add() -> tuple[TwinState, Future[None]]:
            twin.add_vehicle(vehicle.figures())
            state = self._state(stored, twin, twin.last)
            return state, twin.store_with(None if keep is None else keep(state))

        state, kept = _ask(twin, add)
        self._wait_for(kept)
        return state

    def stop(self, twin_id: str, check_state: CheckState = None) -> TwinState:
        """End a live twin for good; what it told stays. One that has ended stays as it is.

        Raises
        ------
        NotYet
            if that is not stored within 2 s: a service that is killed before it is would go on with the twin.
        StoreError
            if the twin waits for the store to go on: it would, behind the answer.
        """
        twin = self._live.get(twin_id)
        if twin is not None and twin.state in ALIVE:
            checked, live = self._checked(twin, check_state), twin

            def stop() -> None:
                checked()
                live.stop()

            _ask(twin, stop)
            twin.join(5.0)
        elif check_state is not None:
            check_state(self.state(twin_id))
        if twin is None:
            return self._ended(twin_id)
        self._wait_for(twin.end_stored)
        return self.state(twin_id)

    def remove(self, twin_id: str, check_state: CheckState = None) -> None:
        """Forget a twin that has ended."""
        state = self.state(twin_id)
        if check_state is not None:
            check_state(state)
        if state.state in ALIVE:
            raise conflict(f"twin {twin_id!r} is live; stop it first")
        twin = self._live.get(twin_id)
        if twin is not None:
            twin.join(5.0)
            if twin.alive:
                raise conflict(f"twin {twin_id!r} is still ending")
        with self._lock:
            self._store.remove(twin_id)  # before what is known of its end, or that is lost where the store refuses
            self._checkpointer.forget(twin_id)  # or it would be written to the next twin of that id
            self._live.pop(twin_id, None)

    def command(self, twin_id: str, document: Any) -> TwinState:
        """Do what a command's document says.

        Raises
        ------
        InputError
            if it is no command of `api.twins.schemas.COMMAND`.
        """
        try:
            given = COMMAND.validate_python(document)
        except ValidationError as error:
            raise input_error("command", error, Command) from None
        match given:
            case PauseCommand():
                return self.change(twin_id, TwinChange(paused=True))
            case ContinueCommand():
                return self.change(twin_id, TwinChange(paused=False))
            case SpeedCommand():
                return self.change(twin_id, TwinChange(speed=given.speed))
            case ControllerCommand():
                return self.change(twin_id, TwinChange(controller=given.controller))
            case VehicleCommand():
                return self.add_vehicle(twin_id, given)
            case StopCommand():
                return self.stop(twin_id)

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

    def _check_controller(self, controller: str, scenarios: Sequence[Scenario]) -> None:
        if controller != REMOTE:
            check(controller, scenarios, self._settings)


def _nothing() -> None:
    """Nobody wants to know."""


def _ask(twin: LiveTwin, command: Callable[[], Any]) -> Any:
    try:
        return twin.ask(command)
    except LateError:
        raise conflict(f"twin {twin.id!r} is busy: it has not answered within 5 s") from None
