"""The twins of a server: start, resume, end; the one object REST, zenoh and the page ask."""

from __future__ import annotations

import logging
import secrets
import threading
import time
from collections.abc import Callable
from typing import Any

from pydantic import ValidationError

from api.controllers.service import check_scenario
from api.settings import Settings
from api.store.database import StoreError
from api.store.patience import REQUEST_S, patient
from api.store.records import CapacityError, Checkpoint, StoredTwin
from api.store.twins import TwinRepository
from api.twins.certified import Belongs, check_here, with_certificate_checked
from api.twins.checkpointer import RETRY_S
from api.twins.commands import REMOTE
from api.twins.durable import KeepAnswer
from api.twins.live import LiveTwin
from api.twins.measured import MeasuredTwin, new_run
from api.twins.messages import TwinObserver
from api.twins.replay import ReplayTwin
from api.twins.schemas import ALIVE, CHANGEABLE, Source, TwinRequest, TwinStateName
from api.twins.shadow_commands import TwinShadows
from api.twins.shown import state_of
from api.twins.simulated import SimulatedTwin
from api.twins.state_schemas import TwinState
from controllers import create_from
from station import Controller, InputError, StationError

log = logging.getLogger(__name__)


class Twins(TwinShadows):
    """Live twins and those that have ended, by id."""

    def __init__(
        self, store: TwinRepository, settings: Settings, check_room: Callable[[], None] = lambda: None
    ) -> None:  # fmt: skip
        super().__init__(store, settings)
        self._check_room = check_room  # raises where the store takes no new twin
        self._closed = False
        self._again = threading.Timer(0, lambda: None)  # looks for twins that should live and do not
        self.observers: list[TwinObserver] = []
        self.create_remote: Callable[[str], Controller] | None = None
        self.on_late: Callable[[], None] = lambda: None

    def start(
        self, request: TwinRequest, keep: KeepAnswer = None, belongs: Belongs = check_here,
        snapshot: bytes | None = None,
    ) -> TwinState:  # fmt: skip
        """Start a twin; where it stands as it begins.

        What `keep` makes of that is kept in the transaction that stores the twin; `belongs` checks its certificate.
        A simulated one may begin with a `snapshot` instead of its scenario's first second.

        Raises
        ------
        InputError, Conflict, Full, StoreFull
            if the request is wrong, the id is taken, there are as many twins as the settings allow, or no room.
        """
        if request.source is not Source.REPLAY:
            check_scenario(request.scenario, self._settings)
        if request.source is Source.MEASURED:
            new_run(request)
        elif request.source is Source.SIMULATED:
            self._check_controller(request.controller, [request.scenario])
        request = with_certificate_checked(request, belongs)
        self._check_room()
        twin_id = request.id or f"twin-{secrets.token_hex(4)}"
        with self._lock:
            alive = sum(twin.state in ALIVE for twin in self._live.values())
            if alive >= self._settings.twins_max:
                raise CapacityError(f"{alive} twins are live; the limit is twins_max = {self._settings.twins_max}")
            self._live = {name: twin for name, twin in self._live.items() if not twin.settled}
            request = request.model_copy(update={"id": twin_id})
            answer = None if keep is None else keep(self._begun(twin_id, request))
            try:
                added = self._store.add(twin_id, request.model_dump(mode="json"), answer, snapshot)
            except StoreError:  # it may be stored all the same
                self._resume_later()
                raise
            self._live[twin_id] = twin = self._make(added, request)
            try:
                if isinstance(twin, SimulatedTwin) and snapshot is not None:
                    twin.start_from(snapshot)
                else:
                    twin.start()
            except Exception:  # a controller that does not start: the id stays free
                del self._live[twin_id]
                self._store.remove(twin_id, answer)
                raise
        return self.state(twin_id)

    def _begun(self, twin_id: str, request: TwinRequest) -> TwinState:
        now = time.time()
        stored = StoredTwin(twin_id, request.model_dump(mode="json"), "running", 1, 0, 0, now, now)
        return state_of(stored, None, None)

    def resume_all(self) -> None:
        """Go on with every twin that should live and does not, as at a start; one that cannot is `failed`.

        What a store in trouble does not give is looked for again, in the background, until it does.
        """
        try:
            for found in self._store.all():
                with self._lock, patient(REQUEST_S):  # requests may wait for the lock
                    if found.state in ALIVE and found.id not in self._live and not self._closed:
                        self._resume(found.id)
        except StoreError as error:
            log.warning("twins wait for the store: %s", error)
            self._resume_later()

    def _resume_later(self) -> None:
        with self._lock:
            waits = self._again.is_alive() and self._again is not threading.current_thread()
            if not self._closed and not waits:
                self._again = threading.Timer(RETRY_S, self.resume_all)
                self._again.daemon = True
                self._again.start()

    def _resume(self, twin_id: str) -> None:
        epoch, snapshot = self._store.open(twin_id)
        stored = self._stored(twin_id)  # read behind `open`: from then on nobody else writes it
        try:
            self._go_on(stored, snapshot)
        except StoreError:
            raise
        except Exception as error:
            with self._lock:
                self._live.pop(twin_id, None)
            if isinstance(error, StationError | ValidationError):
                log.warning("twin %s cannot be resumed: %s", twin_id, error)
            else:
                log.exception("twin %s cannot be resumed", twin_id)
            changes = {name: stored.settings[name] for name in CHANGEABLE if name in stored.settings}
            failed = Checkpoint(TwinStateName.FAILED, changes, snapshot or b"", stored.samples, 0, None)
            self._store.save(twin_id, epoch, failed)

    def _go_on(self, stored: StoredTwin, snapshot: bytes | None) -> None:
        request = TwinRequest.model_validate(stored.settings)
        twin = self._make(stored, request)
        with self._lock:
            self._elsewhere.discard(stored.id)
            self._live[stored.id] = twin
        if snapshot is None:
            twin.start()
        else:
            twin.resume(snapshot)

    def _make(self, stored: StoredTwin, request: TwinRequest) -> LiveTwin:
        kept: dict[str, Any] = {
            "checkpointer": self._checkpointer, "observers": self.observers,
            "checkpoint_s": self._settings.checkpoint_s, "on_superseded": self._leave,
        }  # fmt: skip
        if request.source is Source.MEASURED:
            return MeasuredTwin(stored, request, log_of=self._store.measurements, **kept)
        kept["on_late"] = self.on_late
        if request.source is Source.REPLAY:
            return ReplayTwin(stored, request, twins=self, **kept)
        return SimulatedTwin(stored, request, create_controller=self._create, **kept)

    def _leave(self, twin: LiveTwin) -> None:
        """Another server has taken this one over: what is known of it here counts no more."""
        if self._live.get(twin.id) is twin:
            del self._live[twin.id]
        self._elsewhere.add(twin.id)

    def _create(self, controller: str, twin_id: str) -> Controller:
        if controller == REMOTE:
            if self.create_remote is None:
                raise InputError("twin", [("controller", "remote needs telemetry, which is not open")])
            return self.create_remote(twin_id)
        actor: Controller = create_from(controller)
        return actor

    def close(self, patience_s: float = 3.0) -> None:
        """Store where every twin stands, and end their threads; `resume_all` goes on from there."""
        with self._lock:
            self._closed = True
            twins = list(self._live.values())
        self._again.cancel()
        for twin in twins:
            twin.close()
        until = time.monotonic() + patience_s
        for twin in twins:
            twin.join(max(0.0, until - time.monotonic()))
        self._checkpointer.close()
