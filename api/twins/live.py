"""One live twin: a thread that does what commands say, tells what happens and keeps what it told."""

from __future__ import annotations

import logging
import math
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from functools import partial
from typing import Any

import numpy as np

from api.packing import Basis
from api.store.records import StoredResponse, StoredTwin
from api.twins.alarm_schemas import AlarmAction
from api.twins.checkpointer import Checkpointer
from api.twins.checkpoints import Checkpoints
from api.twins.command_queue import CommandQueue
from api.twins.days import Days
from api.twins.journal import TwinJournal
from api.twins.messages import CERTIFIED, UNCERTIFIED, Event, EventKind, Sample, TwinObserver
from api.twins.schemas import ALIVE, CHANGEABLE, Source, TwinRequest, TwinStateName
from api.twins.shadow_log import ShadowLog
from api.twins.shadow_schemas import ShadowRequest
from station import InputError
from station.alarms.states import Alarm
from station.alarms.system import AlarmSystem, Transition
from station.measured_second import HEALTHY, SensorState

log = logging.getLogger(__name__)


class LiveTwin(ABC):
    """A twin that lives in this process, simulated or measured.

    Only its thread touches what it runs; others read `current`, its `journal`, or send commands.
    """

    def __init__(
        self, stored: StoredTwin, request: TwinRequest, *, checkpointer: Checkpointer,
        observers: Iterable[TwinObserver], checkpoint_s: float,
        on_superseded: Callable[[LiveTwin], None] = lambda _: None,
    ) -> None:  # fmt: skip
        self.id = stored.id
        self.stored = stored  # as it was when this epoch began
        self.request = request
        self.epoch = stored.epoch
        self.state = TwinStateName.PAUSED if request.paused else TwinStateName.RUNNING
        self.current: Sample | None = None
        self.ticks_late = 0
        self.lateness_max_s = 0.0
        self._heard = time.monotonic()  # when data came last; before the first when it began [s]
        self._observers = tuple(observers)
        self.days = Days(request.scenario)
        self.alarms = None if request.source is Source.REPLAY else AlarmSystem(request.followed_station)
        self.shadow = ShadowLog(request.shadow)
        self._commands = CommandQueue(self.id)
        self.first, self.first_event = 0, stored.events  # of this epoch
        self.journal = TwinJournal(stored.events, Basis.of(request.scenario.station), request.layout)
        self._on_superseded = on_superseded
        self._checkpoints = Checkpoints(self.id, self.epoch, checkpointer, self.journal, checkpoint_s, self._superseded)
        self._stopping = False
        self._thread = threading.Thread(target=self._main, name=f"twin-{self.id}", daemon=True)

    # What it runs.

    @abstractmethod
    def start(self) -> None:
        """Begin at the first second."""

    @abstractmethod
    def resume(self, snapshot: bytes) -> None:
        """Go on from the last stored state.

        Raises
        ------
        InputError
            if the snapshot cannot be read.
        """

    @abstractmethod
    def _wait(self, due: float) -> float | None:
        """Seconds until the next tick; None while there is none to come."""

    @abstractmethod
    def _tick(self, due: float) -> float:
        """Do what was due; when the next tick is [s, monotonic]."""

    @property
    @abstractmethod
    def _time(self) -> float:
        """Seconds since it began: when what happens now happens."""

    @abstractmethod
    def _snapshot(self, memories: dict[str, np.ndarray]) -> bytes:
        """Everything needed to go on in another process."""

    @property
    def certification(self) -> str:
        """Whether a verified certificate belongs to the controller that decides now."""
        return CERTIFIED if self.request.certificate is not None else UNCERTIFIED

    def _resume_told(self, memories: dict[str, np.ndarray], first: int) -> None:
        """Begin at row `first`: give no event a number given before."""
        self.first = first
        self.journal.resume(memories, first)
        if self.alarms is not None:
            self.alarms.resume(memories)
        self.shadow.resume(memories, first)
        self.first_event = self.journal.events

    def _begin(self, kind: EventKind, details: dict[str, Any]) -> None:
        for observer in self._observers:
            observer.opened(self.id)
        self._tell(self._time, kind, details)
        self._thread.start()

    # The thread.

    @property
    def _changed(self) -> bool:
        """Whether there is something to store besides what was told."""
        return False

    def _main(self) -> None:
        due = time.monotonic()
        try:
            while not self._stopping:
                wait = self._wait(due)
                if self._commands.obey(self._checkpoints.period_s if wait is None else wait):
                    due = time.monotonic() if wait is None else due
                elif wait is not None:
                    due = self._tick(due)
                if self._checkpoints.due(changed=self._changed):
                    self._store()
        except Exception:
            log.exception("twin %s has stopped", self.id)
            self.state = TwinStateName.FAILED
        finally:
            self._end()

    def _sample(self, seq: int, row: tuple[float, ...], sensors: SensorState = HEALTHY) -> None:
        """Tell the row of a second."""
        sent = round(time.time(), 3)  # as it is stored
        sample = Sample(self.id, self.epoch, seq, sent, row, self.certification, self.request.layout, sensors)
        self.journal.add(row, sent)
        self.current = sample
        for observer in self._observers:
            observer.sample(sample)

    def _tell(self, simulated: float, kind: EventKind, details: dict[str, Any]) -> None:
        plain = {
            name: None if isinstance(value, float) and not math.isfinite(value) else value
            for name, value in details.items()
        }
        event = Event(self.id, self.epoch, self.journal.events, time.time(), simulated, kind, plain)
        self.journal.add_event(event)
        for observer in self._observers:
            observer.event(event)

    def _tell_alarms(self, transitions: Iterable[Transition]) -> None:
        for transition in transitions:
            self._tell(transition.time, EventKind.ALARM, transition.details)

    # What is kept.

    def _memories(self) -> dict[str, np.ndarray]:
        """Arrays for a snapshot, by name."""
        alarms = {} if self.alarms is None else self.alarms.memories()
        return {**self.journal.memories(), **self.shadow.memories(), **alarms}

    @property
    def _measured(self) -> int | None:
        """Number of the last measurements that a snapshot holds."""
        return None

    def _store(self) -> None:
        """Hand a checkpoint to the checkpointer."""
        changes = self.request.model_dump(mode="json", include=CHANGEABLE)
        self._checkpoints.store(self.state, changes, self._snapshot(self._memories()), self._measured)

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

    @abstractmethod
    def _close(self) -> None:
        """Let go of what it runs with, as its thread ends."""

    def _end(self) -> None:
        self._close()
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
        return Sample(self.id, self.epoch, self.first - 1, None, row, layout=self.request.layout)

    @property
    def data_age(self) -> float | None:
        """Time since its newest second, or since measurements came last [s, wall clock]; None where none is to come."""
        return max(0.0, time.monotonic() - self._heard) if self.state is TwinStateName.RUNNING else None

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

    def stop(self) -> None:
        """End for good. In the twin's thread, as every command."""
        if self.state is not TwinStateName.FINISHED:
            self.state = TwinStateName.STOPPED
            self._tell(self._time, EventKind.STOPPED, {"samples": self.journal.rows})
        self._stopping = True

    def _check_alive(self) -> None:
        if self.state not in ALIVE:
            raise InputError("twin", [("", f"{self.id!r} is {self.state}")])

    def alarm(self, name: str, action: AlarmAction, by: str) -> Alarm:
        """Do with an alarm what somebody says; in the twin's thread. The alarm as it is then.

        Raises
        ------
        InputError
            if that cannot be done.
        """
        self._check_alive()
        if self.alarms is None:
            raise InputError("alarm", [("", f"twin {self.id!r} is a replay: its alarms are those of another")])
        self._tell_alarms(action.apply(self.alarms, name, by))
        return self.alarms.alarms[name]

    def set_shadow(self, settings: ShadowRequest | None) -> None:
        """Hold these controllers against the one that acts, or none; in the twin's thread. The same again is nothing.

        Raises
        ------
        InputError
            if the twin has ended.
        """
        self._check_alive()
        if settings != self.request.shadow:
            self._change(shadow=settings)
            self.shadow.restart(settings)

    def shadow_taken(self, begin: int) -> None:
        """The stretch that begins then has been taken, and need not be kept."""
        if self.alive:
            self._commands.tell(partial(self.shadow.taken, begin))
        else:
            self.shadow.taken(begin)

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
