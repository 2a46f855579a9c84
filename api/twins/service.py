"""The twins of a server: start, change, stop, remember; the one object REST, zenoh and the page ask."""

from __future__ import annotations

import logging
import secrets
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from concurrent.futures import TimeoutError as LateError
from typing import Any

import numpy as np
from pydantic import ValidationError

from api.controllers.service import check, check_scenario
from api.figures import Selection, selected
from api.paging import Page
from api.problems import conflict, not_found
from api.runs.schemas import moment
from api.settings import Settings
from api.store.database import StoreError
from api.store.records import Checkpoint, Full, KeptAnswer, NotYet, StoredTwin
from api.store.twins import TwinRepository
from api.twins.certified import with_certificate_checked
from api.twins.feed import CERTIFIED, COLUMNS, UNCERTIFIED, Listener, Sample
from api.twins.keeper import RETRY_S, Keeper
from api.twins.live import LiveTwin
from api.twins.schemas import (
    CHANGEABLE,
    COMMAND,
    ContinueCommand,
    ControllerCommand,
    PauseCommand,
    SpeedCommand,
    StopCommand,
    TwinChange,
    TwinRequest,
    TwinState,
    TwinStateName,
    VehicleCommand,
    VehicleRequest,
)
from api.twins.segments import columns_of, decode, stored_columns
from controllers import create_from
from station import Controller, InputError, Scenario, StationError

log = logging.getLogger(__name__)

REMOTE = "remote"
"""Name of the controller that asks whoever answers the twin's key `decide`."""

FAR = 2**62
"""Behind every sample."""

CheckState = Callable[[TwinState], None] | None
"""Raises unless a twin is in a state that the asker expects."""

STORED_S = 5.0
"""How long an answer waits for the store to have what it tells [s]."""

KeepAnswer = Callable[[TwinState], KeptAnswer] | None
"""Makes the answer that is kept under an idempotency key."""

ALIVE = (TwinStateName.RUNNING, TwinStateName.PAUSED)


class Twins:
    """Live twins and those that have ended, by id."""

    def __init__(self, store: TwinRepository, settings: Settings) -> None:
        self._store = store
        self._settings = settings
        self._keeper = Keeper(store)
        self._live: dict[str, LiveTwin] = {}
        self._lock = threading.RLock()
        self._closed = False
        self._again = threading.Timer(0, _nothing)  # looks for twins that should live and do not
        self.listeners: list[Listener] = []
        self.create_remote: Callable[[str], Controller] | None = None
        self.on_late: Callable[[], None] = _nothing

    # Starting and ending.

    def start(self, request: TwinRequest, keep: KeepAnswer = None) -> TwinState:
        """Start a twin; where it stands as it begins.

        What `keep` makes of that is kept in the transaction that stores the twin.

        Raises
        ------
        InputError, Conflict, Full
            if the request is wrong, the id is taken, or there are as many twins as the settings allow.
        """
        check_scenario(request.scenario, self._settings)
        self._check_controller(request.controller, [request.scenario])
        request = with_certificate_checked(request)
        twin_id = request.id or f"twin-{secrets.token_hex(4)}"
        with self._lock:
            alive = sum(twin.state in ALIVE for twin in self._live.values())
            if alive >= self._settings.twins_max:
                raise Full(f"{alive} twins are live; the limit is twins_max = {self._settings.twins_max}")
            self._live = {name: twin for name, twin in self._live.items() if not twin.settled}
            request = request.model_copy(update={"id": twin_id})
            answer = None if keep is None else keep(self._begun(twin_id, request))
            try:
                added = self._store.add(twin_id, request.model_dump(mode="json"), answer)
            except StoreError:  # it may be stored all the same
                self._resume_later()
                raise
            self._live[twin_id] = twin = self._make(twin_id, request, added.epoch)
            try:
                twin.start()
            except Exception:  # a controller that does not start: the id stays free
                del self._live[twin_id]
                self._store.remove(twin_id, answer)
                raise
        return self.state(twin_id)

    def _begun(self, twin_id: str, request: TwinRequest) -> TwinState:
        now = time.time()
        stored = StoredTwin(twin_id, request.model_dump(mode="json"), "running", 1, 0, 0, now, now)
        return self._state(stored, None, None)

    def resume_all(self) -> None:
        """Go on with every twin that should live and does not, as at a start; one that cannot is `failed`.

        What a store in trouble does not give is looked for again, in the background, until it does.
        """
        try:
            for found in self._store.all():
                with self._lock:
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
            self._go_on(stored, epoch, snapshot)
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

    def _go_on(self, stored: StoredTwin, epoch: int, snapshot: bytes | None) -> None:
        request = TwinRequest.model_validate(stored.settings)
        twin = self._make(stored.id, request, epoch, stored.events)
        with self._lock:
            self._live[stored.id] = twin
        if snapshot is None:
            twin.start()
        else:
            twin.resume(snapshot)

    def _make(self, twin_id: str, request: TwinRequest, epoch: int, events: int = 0) -> LiveTwin:
        return LiveTwin(
            twin_id, request, epoch, keeper=self._keeper, listeners=self.listeners,
            create_controller=self._create, checkpoint_s=self._settings.checkpoint_s, on_late=self.on_late,
            events=events,
        )  # fmt: skip

    def _create(self, controller: str, twin_id: str) -> Controller:
        if controller == REMOTE:
            if self.create_remote is None:
                raise InputError("twin", [("controller", "remote needs telemetry, which is not open")])
            return self.create_remote(twin_id)
        actor: Controller = create_from(controller)
        return actor

    def _check_controller(self, controller: str, scenarios: Sequence[Scenario]) -> None:
        if controller != REMOTE:
            check(controller, scenarios, self._settings)

    def close(self, patience_s: float = 1.5) -> None:
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
        self._keeper.close()

    # Commands.

    def change(self, twin_id: str, change: TwinChange, check_state: CheckState = None) -> TwinState:
        """Change speed, controller or pause of a live twin; all or nothing of it.

        `check_state` may raise what refuses the change; nobody else's comes between.
        """
        twin = self._alive(twin_id)
        if change.controller is not None:
            self._check_controller(change.controller, [twin.request.scenario])
        checked = self._checked(twin, check_state)

        def apply() -> None:
            checked()
            if change.controller is not None:
                twin.set_controller(change.controller)
            if change.speed is not None:
                twin.set_speed(change.speed)
            if change.paused is not None:
                (twin.pause if change.paused else twin.go_on)()

        _ask(twin, apply)
        return self.state(twin_id)

    def _checked(self, twin: LiveTwin, check_state: CheckState) -> Callable[[], None]:
        """The check of a twin's state as its own thread does it: without the store."""
        if check_state is None:
            return _nothing
        stored = self._stored(twin.id)
        return lambda: check_state(self._state(stored, twin, None))

    def add_vehicle(self, twin_id: str, vehicle: VehicleRequest, keep: KeepAnswer = None) -> TwinState:
        """Let a vehicle arrive at a live twin.

        What `keep` makes of where it stands then is kept with the checkpoint that holds the vehicle, and waited for.

        Raises
        ------
        NotYet
            if that is not stored within 5 s.
        """
        twin = self._alive(twin_id)
        if keep is None:
            _ask(twin, lambda: twin.add_vehicle(vehicle.figures()))
            return self.state(twin_id)
        stored, before = self._stored(twin_id), self.current(twin_id)

        def add() -> tuple[TwinState, Future[None]]:
            twin.add_vehicle(vehicle.figures())
            state = self._state(stored, twin, twin.current or before)
            return state, twin.store_with(keep(state))

        state, kept = _ask(twin, add)
        try:
            kept.result(STORED_S)
        except LateError:
            raise NotYet(kept) from None
        return state

    def stop(self, twin_id: str, check_state: CheckState = None) -> TwinState:
        """End a live twin for good; what it told stays. One that has ended stays as it is.

        Raises
        ------
        StoreError
            if that is not stored within 5 s: a service that is killed before it is would go on with the twin.
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
        if twin is not None and not twin.end_stored.wait(STORED_S):
            raise StoreError(f"twin {twin_id!r} has ended, but that is not stored yet")
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
        self._keeper.forget(twin_id)  # or it would be written to the next twin of that id
        with self._lock:
            self._live.pop(twin_id, None)
            self._store.remove(twin_id)

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
            raise InputError.of("command", error) from None
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
            raise conflict(f"twin {twin_id!r} is {self.state(twin_id).state}")
        return twin

    # Reading.

    def known(self, twin_id: str) -> bool:
        """Whether this server has, or had, a twin of that id."""
        return twin_id in self._live or self._store.get(twin_id) is not None

    def live(self, twin_id: str) -> LiveTwin | None:
        """The twin, if it runs or stands still here."""
        twin = self._live.get(twin_id)
        return twin if twin is not None and twin.state in ALIVE else None

    def ids(self) -> list[str]:
        """Ids of the twins that are live here."""
        return [twin.id for twin in list(self._live.values()) if twin.state in ALIVE]

    def states(self) -> dict[str, int]:
        """How many twins are in each state."""
        stored = self._store.states() | {twin.id: str(twin.state) for twin in list(self._live.values())}
        return {name: list(stored.values()).count(name) for name in TwinStateName}

    def list(self) -> Sequence[TwinState]:
        """Every twin, the oldest first; those that have ended without their last sample."""
        return [self._shown(stored, whole=False) for stored in self._store.all()]

    def page(self, page: Page) -> tuple[Sequence[TwinState], str | None]:
        """The twins of a page, as in `list`, and the cursor behind them."""
        found, cursor = page.turn(
            self._store.page(page.behind(float, str), page.limit + 1), lambda stored: (stored.created, stored.id)
        )
        return [self._shown(stored, whole=False) for stored in found], cursor

    def state(self, twin_id: str) -> TwinState:
        """A twin and where it stands; a problem if there is none."""
        return self._shown(self._stored(twin_id), whole=True)

    def scenario(self, twin_id: str) -> Scenario:
        """The scenario a twin runs, with every parameter of its station."""
        return Scenario.model_validate(self._stored(twin_id).settings["scenario"])

    def _stored(self, twin_id: str) -> StoredTwin:
        stored = self._store.get(twin_id)
        if stored is None:
            raise not_found("twin", twin_id)
        return stored

    def _shown(self, stored: StoredTwin, *, whole: bool) -> TwinState:
        live = self._live.get(stored.id)
        current = self.current(stored.id) if live or (whole and stored.samples) else None
        return self._state(stored, live, current)

    @staticmethod
    def _state(stored: StoredTwin, live: LiveTwin | None, current: Sample | None) -> TwinState:
        settings = stored.settings
        if live:
            settings = {**settings, **live.request.model_dump(include=CHANGEABLE)}
        created = moment(stored.created)
        return TwinState(
            id=stored.id,
            state=live.state if live else TwinStateName(stored.state),
            scenario=settings["scenario"]["name"],
            station=settings["scenario"]["station"]["name"],
            service=CERTIFIED if settings.get("certificate") else UNCERTIFIED,
            **{name: settings[name] for name in ("controller", "speed", "at_end", "replication", "seed")},
            epoch=live.epoch if live else stored.epoch,
            samples=max(stored.samples, current.seq + 1 if current else 0),
            events=max(stored.events, live.told.events if live else 0),
            created=created.isoformat() if created else "",
            values=current.document()["values"] if current else None,
            ticks_late=live.ticks_late if live else 0,
            lateness_max_s=live.lateness_max_s if live else 0.0,
        )

    def current(self, twin_id: str) -> Sample | None:
        """The newest sample; of a twin that is not live here, the last one stored."""
        live = self._live.get(twin_id)
        if live is not None and live.current is not None:
            return live.current
        stored = self._stored(twin_id)
        found = self.history(twin_id, max(0, stored.samples - 1), 1)
        return found[0] if found else None

    def history(self, twin_id: str, first: int, limit: int) -> Sequence[Sample]:
        """At most `limit` samples from number `first` on; old ones may be gone by the settings' retention.

        Their `sent` is None.
        """
        live = self._live.get(twin_id)
        memory_first, memory = live.told.rows_from(first) if live else (FAR, [])
        self._stored(twin_id)
        end = first + limit
        rows = {
            number: Sample(twin_id, epoch, number, None, row)
            for segment_first, epoch, blob in self._segments(twin_id, first, min(end, memory_first) - 1)
            for number, row in enumerate(decode(blob), segment_first)
            if first <= number < min(end, memory_first)
        }
        for number, row in enumerate(memory[: max(0, end - memory_first)], memory_first):
            rows[number] = Sample(twin_id, live.epoch if live else 0, number, None, row)
        return [rows[number] for number in sorted(rows)]

    def samples(self, twin_id: str) -> int:
        """How many samples a twin has told."""
        live = self._live.get(twin_id)
        return live.told.rows if live else self._stored(twin_id).samples

    def epochs(self, twin_id: str) -> dict[int, int]:
        """First sample of each epoch: what an earlier epoch told from there on does not count."""
        live = self._live.get(twin_id)
        return self._store.epochs(twin_id) | ({live.epoch: live.first} if live else {})

    def _segments(self, twin_id: str, first: int, last: int) -> Sequence[tuple[int, int, bytes]]:
        return self._store.segments(twin_id, first, last) if last >= first else ()

    def columns(self, twin_id: str, chosen: Selection) -> dict[str, np.ndarray]:
        """The part of a twin's history that was chosen, as columns; a second is a row, row k begins at k s."""
        self._stored(twin_id)
        unknown = [name for name in chosen.columns if name not in COLUMNS]
        if unknown:
            raise InputError(
                "query", [("columns", f"no column is called {unknown[0]!r:.60}; there are {', '.join(COLUMNS)}")]
            )
        first, last = int(chosen.start), FAR if np.isinf(chosen.end) else int(chosen.end)
        live = self._live.get(twin_id)
        memory_first, memory = live.told.rows_from(first) if live else (FAR, [])
        wanted = list(dict.fromkeys(("time", *chosen.columns))) if chosen.columns else list(COLUMNS)
        parts = []
        for segment_first, _, blob in self._segments(twin_id, first, min(last, memory_first - 1)):
            part = stored_columns(blob, wanted)
            parts.append({name: part[name][: max(0, memory_first - segment_first)] for name in wanted})
        parts.append(columns_of(memory[: max(0, last + 1 - memory_first)], wanted))
        return selected({name: np.concatenate([part[name] for part in parts]) for name in wanted}, chosen)

    def events(self, twin_id: str, after: int, limit: int) -> Sequence[dict[str, Any]]:
        """Documents of at most `limit` events behind number `after`."""
        live = self._live.get(twin_id)
        memory = [event.document() for event in live.told.events_in_memory()] if live else []
        self._stored(twin_id)
        stored = self._store.events(twin_id, after, limit)
        known = {event["seq"] for event in stored}
        more = [event for event in memory if event["seq"] > after and event["seq"] not in known]
        return [*stored, *more][:limit]


def _nothing() -> None:
    """Nobody wants to know."""


def _ask(twin: LiveTwin, command: Callable[[], Any]) -> Any:
    try:
        return twin.ask(command)
    except LateError:
        raise conflict(f"twin {twin.id!r} is busy: it has not answered within 5 s") from None
