"""One live twin: a thread that steps its run on the clock, tells what happens, and does what commands say."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from typing import Any

import numpy as np

from api.packing import Basis
from api.store.records import StoredResponse, StoredTwin
from api.twins.checkpointer import Checkpointer
from api.twins.checkpoints import Checkpoints
from api.twins.command_queue import CommandQueue
from api.twins.controller_slot import ControllerSlot
from api.twins.days import Days, document
from api.twins.event_detection import EventDetector
from api.twins.journal import TwinJournal
from api.twins.messages import CERTIFIED, UNCERTIFIED, Event, EventKind, Sample, TwinObserver
from api.twins.schemas import ALIVE, CHANGEABLE, MAX, Speed, TwinRequest, TwinStateName
from controllers.registry import FALLBACK
from station import Controller, InputError
from station.live import LiveRun, Second

log = logging.getLogger(__name__)

REBASE_S = 1.0
"""A twin that is later than this gives up catching up and goes on from now [s]."""

LATE_S = 0.1
"""A tick later than this counts as late [s]."""


class LiveTwin:
    """A twin that runs in this process.

    Only its thread touches the run; others read `current`, its `journal`, or send commands.
    """

    def __init__(
        self, stored: StoredTwin, request: TwinRequest, *, checkpointer: Checkpointer,
        observers: Iterable[TwinObserver], create_controller: Callable[[str, str], Controller], checkpoint_s: float,
        on_late: Callable[[], None] = lambda: None, on_superseded: Callable[[LiveTwin], None] = lambda _: None,
    ) -> None:  # fmt: skip
        twin_id, events = stored.id, stored.events
        self.id = twin_id
        self.stored = stored  # as it was when this epoch began
        self.request = request
        self.epoch = stored.epoch
        self.state = TwinStateName.PAUSED if request.paused else TwinStateName.RUNNING
        self.current: Sample | None = None
        self.ticks_late = 0
        self.lateness_max_s = 0.0
        self._on_late = on_late
        self._observers = tuple(observers)
        self._slot = ControllerSlot(
            lambda controller: create_controller(controller, twin_id), request.scenario.known_station
        )
        self._run = LiveRun(request.scenario, request.at_end, request.replication, request.seed)
        self._plant = request.scenario.station.plant
        self._detector = EventDetector(self._plant)
        self.days = Days(request.scenario)
        self._commands = CommandQueue(twin_id)
        self.first, self.first_event = 0, events  # of this epoch
        self.journal = TwinJournal(events, Basis.of(request.scenario.station), self._plant)
        self._on_superseded = on_superseded
        self._checkpoints = Checkpoints(twin_id, self.epoch, checkpointer, self.journal, checkpoint_s, self._superseded)
        self._stopping = False
        self._thread = threading.Thread(target=self._main, name=f"twin-{twin_id}", daemon=True)

    # Starting.

    def start(self) -> None:
        """Begin at the first second."""
        self._slot.take(self.request.controller, self.request.speed)
        about = {"scenario": self.request.scenario.name, "controller": self.request.controller}
        self._begin(EventKind.STARTED, {**about, "speed": self.request.speed, "service": self.certification})

    @property
    def certification(self) -> str:
        """Whether a verified certificate belongs to the controller that decides now."""
        return CERTIFIED if self.request.certificate is not None else UNCERTIFIED

    def resume(self, snapshot: bytes) -> None:
        """Go on from the last stored state; logic takes the seat of a controller that no longer starts.

        Raises
        ------
        InputError
            if the snapshot cannot be read.
        """
        memories = self._run.restore(snapshot)
        try:
            self._slot.take(self.request.controller, self.request.speed)
        except Exception as error:  # noqa: BLE001  # whatever a plug-in raises, the station goes on
            log.warning("twin %s: controller %s does not start: %r", self.id, self.request.controller, error)
            self._change(controller=FALLBACK, certificate=None)
            self._slot.take(FALLBACK, self.request.speed)
            memory = f"{FALLBACK} in its place: {error or repr(error)}"
        else:
            memory = "restored" if self._slot.remember(memories) else "anew"
        self._go_on_behind(memories)
        details = {"from_seq": self.first, "controller": self.request.controller, "memory": memory}
        details["service"] = self.certification
        self._begin(EventKind.RESUMED, details)

    def _go_on_behind(self, memories: dict[str, np.ndarray]) -> None:
        """Tell nothing anew that was told before the snapshot, and give no event a number given before."""
        self.first = self._run.seq
        self.days.resume(memories, self.first)
        self.journal.resume(memories, self.first)
        if self.journal.last_row:
            self._detector.resume(self.journal.last_row)
        self.first_event = self.journal.events

    def _begin(self, kind: EventKind, details: dict[str, Any]) -> None:
        if self._run.over:
            self.state, self._stopping = TwinStateName.FINISHED, True
        for observer in self._observers:
            observer.opened(self.id)
        self._tell(self._run.time, kind, details)
        self._thread.start()

    # The thread.

    def _main(self) -> None:
        due = time.monotonic()
        try:
            while not self._stopping:
                wait = self._wait(due)
                if self._commands.obey(self._checkpoints.period_s if wait is None else wait):
                    due = time.monotonic() if wait is None else due
                elif wait is not None:
                    due = self._tick(due)
                if self._checkpoints.due:
                    self._store()
        except Exception:
            log.exception("twin %s has stopped", self.id)
            self.state = TwinStateName.FAILED
        finally:
            self._end()

    def _wait(self, due: float) -> float | None:
        """Seconds until the next tick; None while there is none to come."""
        if self.state is not TwinStateName.RUNNING:
            return None
        return 0.0 if self.request.speed == MAX else max(0.0, due - time.monotonic())

    def _tick(self, due: float) -> float:
        """Simulate a second that was due; when the next one is [s, monotonic]."""
        now = time.monotonic()
        self._second()
        if self.request.speed == MAX:
            while self._checkpoints.behind and self._commands.empty:
                time.sleep(0.001)
            return now
        late = now - due
        self.lateness_max_s = max(self.lateness_max_s, late)
        if late > LATE_S:
            self.ticks_late += 1
            self._on_late()
        return now if late > REBASE_S else due + 1.0 / float(self.request.speed)

    def _second(self) -> None:
        second = self._run.step(self._slot.state)
        sent = round(time.time(), 3)  # as it is stored
        sample = Sample(self.id, self.epoch, second.seq, sent, second.row, self.certification, self._plant)
        self.journal.add(second.row, sent)
        self.current = sample
        for observer in self._observers:
            observer.sample(sample)
        for told in self._detector.watch(second):
            self._tell(*told)
        day = self.days.add(second, self._wait_of(second))
        if day is not None:
            self._tell(day["to_s"], EventKind.DAY_END, document(day))
        if second.over:
            self.state = TwinStateName.FINISHED
            self._tell(self._run.time, EventKind.FINISHED, {"samples": self._run.seq})
            self._stopping = True

    def _wait_of(self, second: Second) -> float | None:
        """How long the vehicle has waited that was connected in a second [s]; None if none was."""
        if second.connected < 0:
            return None
        known = second.figures if second.left == second.connected else self._run.vehicle(second.connected)
        return known["connected"] - known["arrival"]

    def _tell(self, simulated: float, kind: EventKind, details: dict[str, Any]) -> None:
        plain = {
            name: None if isinstance(value, float) and not math.isfinite(value) else value
            for name, value in details.items()
        }
        event = Event(self.id, self.epoch, self.journal.events, time.time(), simulated, kind, plain)
        self.journal.add_event(event)
        for observer in self._observers:
            observer.event(event)

    # What is kept.

    def _store(self) -> None:
        """Hand a checkpoint to the checkpointer."""
        memories = {**self._slot.memories(), **self.days.memories(), **self.journal.memories()}
        changes = self.request.model_dump(include=CHANGEABLE)
        self._checkpoints.store(self.state, changes, self._run.snapshot(**memories))

    def store_with(self, answer: StoredResponse | None = None) -> Future[None]:
        """Store now, and with it the answer to a command; in the twin's thread. Done when it is stored."""
        stored = self._checkpoints.awaited(answer)
        self._store()
        return stored

    @property
    def end_stored(self) -> Future[None]:
        """Done when it is stored that the twin has ended for good, or nobody will store it."""
        return self._checkpoints.end_stored

    def _superseded(self) -> None:
        self._on_superseded(self)
        self.close()

    def _end(self) -> None:
        self._slot.close()
        if self.here:
            self._store()
        self._commands.close()
        for observer in self._observers:
            observer.closed(self.id)

    @property
    def last(self) -> Sample | None:
        """The newest sample; before the first of this epoch the last of the ones before."""
        row = self.journal.last_row
        if self.current is not None or not row:
            return self.current
        return Sample(self.id, self.epoch, self.first - 1, None, row, plant=self._plant)

    @property
    def here(self) -> bool:
        """Whether what this process knows of it counts: no other server has taken it over."""
        return not self._checkpoints.superseded

    @property
    def settled(self) -> bool:
        """Whether it has ended and all it told is stored."""
        return (self.journal.stored or not self.here) and not self._thread.is_alive()

    # Commands, from other threads.

    def ask(self, command: Callable[[], Any], patience_s: float = 5.0) -> Any:
        """Run `command` in the twin's thread between two seconds; what it returns or raises.

        Raises
        ------
        InputError
            if the twin has ended.
        TimeoutError
            if it has not answered within `patience_s`.
        """
        return self._commands.ask(command, patience_s)

    def pause(self) -> None:
        """Stand still until `go_on`. In the twin's thread, like every command below."""
        self._check_alive()
        if self.state is TwinStateName.RUNNING:
            self._change(paused=True)
            self.state = TwinStateName.PAUSED
            self._tell(self._run.time, EventKind.PAUSED, {})

    def continue_(self) -> None:
        """Run again."""
        self._check_alive()
        if self.state is TwinStateName.PAUSED:
            self._change(paused=False)
            self.state = TwinStateName.RUNNING
            self._tell(self._run.time, EventKind.CONTINUED, {})

    def set_speed(self, speed: Speed) -> None:
        """Run at another speed, with its deadline."""
        self._check_alive()
        self._change(speed=speed)
        self._slot.set_deadline(speed)
        self._tell(self._run.time, EventKind.SPEED_CHANGED, {"speed": speed})

    def set_controller(self, controller: str) -> None:
        """Let another controller decide from the next second on."""
        self._check_alive()
        self._slot.take(controller, self.request.speed)
        self._change(controller=controller, certificate=None)
        details = {"controller": controller, "service": self.certification}
        self._tell(self._run.time, EventKind.CONTROLLER_CHANGED, details)

    def add_vehicle(self, figures: dict[str, float]) -> int:
        """Let a vehicle arrive with the next second; its number."""
        self._check_alive()
        number = self._run.add_vehicle(**figures)
        self._tell(self._run.time, EventKind.VEHICLE_ADDED, {"vehicle": number, **figures})
        return number

    def stop(self) -> None:
        """End for good."""
        if self.state is not TwinStateName.FINISHED:
            self.state = TwinStateName.STOPPED
            self._tell(self._run.time, EventKind.STOPPED, {"samples": self._run.seq})
        self._stopping = True

    def _check_alive(self) -> None:
        if self.state not in ALIVE:
            raise InputError("twin", [("", f"{self.id!r} is {self.state}")])

    def _change(self, **changes: Any) -> None:
        self.request = self.request.model_copy(update=changes)

    def close(self) -> None:
        """Let the thread store where it stands and end; a restart goes on from there."""
        self._commands.tell(self._halt)

    def _halt(self) -> None:
        self._stopping = True

    def join(self, patience_s: float) -> None:
        """Wait for the thread, if there is one."""
        if self._thread.ident is not None:
            self._thread.join(patience_s)

    @property
    def begun(self) -> bool:
        """Whether it has told where its epoch begins."""
        return self._thread.ident is not None

    @property
    def alive(self) -> bool:
        """Whether its thread still runs."""
        return self._thread.is_alive()
