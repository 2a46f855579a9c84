"""One live twin: a thread that steps its run on the clock, obeys commands, tells listeners and the keeper."""

from __future__ import annotations

import logging
import math
import queue
import threading
import time
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from typing import Any

import numpy as np

from api.store.records import Checkpoint
from api.twins.events import Watcher
from api.twins.feed import CERTIFIED, COLUMNS, UNCERTIFIED, Event, EventKind, Listener, Sample
from api.twins.keeper import Draft, Keeper, Segment
from api.twins.schemas import CHANGEABLE, MAX, Speed, TwinRequest, TwinStateName
from controllers import Deadline, create
from controllers.slot import DEADLINE_MAX, FALLBACK
from station import Controller, InputError, StationError
from station.controller import NEVER
from station.live import LiveRun, Seat
from station.loop import CLOSED_CONTROLLER

log = logging.getLogger(__name__)

REBASE_S = 1.0
"""A twin that is later than this gives up catching up and goes on from now [s]."""

SEGMENT_ROWS = 512
"""Rows of a full segment: at 1x it is stored anew with every checkpoint until then, some 3 ms each."""

SEGMENT_ROWS_MAX = 4096
"""A fast twin stores as soon as it has so many."""

BEHIND_MAX = 8
"""A twin as fast as possible waits when so many checkpoints are not stored yet."""

DIRECT_S = 0.1
"""A controller that is `bounded` is asked without a shorter deadline than this [s]."""

LATE_S = 0.1
"""A tick later than this counts as late [s]."""


class LiveTwin:
    """A twin that runs in this process.

    Only its thread touches the run; others read `current`, `status`, the rows in memory, or send commands.
    """

    def __init__(
        self, twin_id: str, request: TwinRequest, epoch: int, *, keeper: Keeper, listeners: Iterable[Listener],
        create_controller: Callable[[str, str], Controller], checkpoint_s: float, events: int = 0,
    ) -> None:  # fmt: skip
        self.id = twin_id
        self.request = request
        self.epoch = epoch
        self.state = TwinStateName.PAUSED if request.paused else TwinStateName.RUNNING
        self.current: Sample | None = None
        self.ticks_late = 0
        self.lateness_max_s = 0.0
        self._keeper = keeper
        self._listeners = tuple(listeners)
        self._create = create_controller
        self._checkpoint_s = checkpoint_s
        self._run = LiveRun(request.scenario, request.at_end, request.replication, request.seed)
        self._watcher = Watcher()
        self._last_row: tuple[float, ...] = ()
        self._commands: queue.SimpleQueue[tuple[Callable[[], Any], Future[Any]] | None] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self.first = 0  # sample of this epoch
        self._segments = [Segment(0)]
        self._events: list[Event] = []
        self._unsaved_events: list[Event] = []
        self._next_event = events
        self._stopping = False
        self._gone = False  # another server has it
        self._ended = False  # no command is obeyed any more
        self._actor: Any = None  # the controller
        self._late: Any = None  # logic, for when it is late
        self._asked: Any = None  # the controller with its deadline
        self._seat: Seat
        self._thread = threading.Thread(target=self._main, name=f"twin-{twin_id}", daemon=True)

    # Starting.

    def start(self) -> None:
        """Begin at the first second."""
        self._take_seat(self.request.controller)
        about = {"scenario": self.request.scenario.name, "controller": self.request.controller}
        self._begin(EventKind.STARTED, {**about, "speed": self.request.speed, "service": self.service})

    @property
    def service(self) -> str:
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
        self._go_on_behind(memories)
        memory = "anew"
        try:
            self._take_seat(self.request.controller)
        except Exception as error:  # noqa: BLE001  # whatever a plug-in raises, the station goes on
            log.warning("twin %s: controller %s does not start: %r", self.id, self.request.controller, error)
            self.request = self.request.model_copy(update={"controller": FALLBACK, "certificate": None})
            self._take_seat(FALLBACK)
            memory = f"{FALLBACK} in its place: {error or repr(error)}"
        else:
            memory = self._remember(memories)
        self.first = self._run.seq
        self._segments = [Segment(self.first)]
        details = {"from_seq": self._run.seq, "controller": self.request.controller, "memory": memory}
        details["service"] = self.service
        self._begin(EventKind.RESUMED, details)

    def _go_on_behind(self, memories: dict[str, np.ndarray]) -> None:
        """Tell nothing anew that was told before the snapshot, and give no event a number given before."""
        self._next_event = max(self._next_event, int(memories.get("told", np.zeros(()))))
        row = memories.get("row", np.zeros(0))
        if row.shape == (len(COLUMNS),):
            self._last_row = tuple(row.tolist())
            self._watcher.resume(self._last_row)

    def _remember(self, memories: dict[str, np.ndarray]) -> str:
        if memories["fallback"].shape == self._seat.fallback.memory.shape:
            self._seat.fallback.memory[:] = memories["fallback"]
        if memories["late"].shape == self._late.memory.shape:
            self._late.memory = memories["late"]
        if "controller" not in memories or getattr(self._actor, "memory", None) is None:
            return "anew"
        try:
            self._actor.memory = memories["controller"]
        except StationError:
            return "anew"
        return "restored"

    def _begin(self, kind: EventKind, details: dict[str, Any]) -> None:
        if self._run.over:
            self.state, self._stopping = TwinStateName.FINISHED, True
        for listener in self._listeners:
            listener.opened(self.id)
        self._tell(self._run.time, kind, details)
        self._thread.start()

    def _take_seat(self, controller: str) -> None:
        """Put a controller in the slot; raises what it raises, and then the one before stays."""
        station = self.request.scenario.told
        actor = self._create(controller, self.id)
        actor.start(station)
        behind = CLOSED_CONTROLLER
        shield = getattr(actor, "fallback", None)
        if shield is not None:
            shield.start(station)
            behind = shield.compiled()
        late: Any = create(FALLBACK)
        late.start(station)
        self._actor, self._late = actor, late
        asked = self._timed()
        wake = getattr(actor, "wake_pressure", NEVER)
        self._seat = Seat(asked.decide, bool(actor.obeys_hold), wake, behind)
        self._use(asked)

    def _timed(self) -> Any:
        """The controller with the deadline of this speed.

        One whose decisions are sure to come soon is asked directly where the deadline would be so short that the wait
        for another thread decides who meets it; a tick that takes longer is late instead.
        """
        speed = self.request.speed
        seconds = DEADLINE_MAX if speed == MAX else min(DEADLINE_MAX, 1.0 / float(speed))
        soon = getattr(self._actor, "bounded", False)
        if soon and (speed == MAX or seconds < DIRECT_S or self._actor.name == FALLBACK):
            return self._actor
        deadline = Deadline(self._actor, seconds)
        deadline.fallback = self._late
        return deadline

    def _use(self, asked: Any) -> None:
        before, self._asked = self._asked, asked
        if isinstance(before, Deadline):
            before.close()

    # The thread.

    def _main(self) -> None:
        due = time.monotonic()
        stored = due - self._checkpoint_s  # that it was started, or resumed, is stored at once
        try:
            while not self._stopping:
                wait = self._wait(due)
                if self._obey(self._checkpoint_s if wait is None else wait):
                    due = time.monotonic() if wait is None else due
                elif wait is not None:
                    due = self._tick(due)
                stored = self._maybe_store(stored)
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

    def _obey(self, patience_s: float) -> bool:
        """Do what the next command says, waiting for one at most so long; False if none came."""
        try:
            item = self._commands.get(timeout=patience_s) if patience_s > 0 else self._commands.get_nowait()
        except queue.Empty:
            return False
        if item is None:
            self._stopping = True
            return True
        command, reply = item
        try:
            reply.set_result(command())
        except Exception as error:  # noqa: BLE001  # it is the sender's
            reply.set_exception(error)
        return True

    def _tick(self, due: float) -> float:
        """Simulate a second that was due; when the next one is [s, monotonic]."""
        now = time.monotonic()
        self._second()
        if self.request.speed == MAX:
            while self._keeper.behind > BEHIND_MAX and self._commands.empty():
                time.sleep(0.001)
            return now
        late = now - due
        self.lateness_max_s = max(self.lateness_max_s, late)
        self.ticks_late += late > LATE_S
        return now if late > REBASE_S else due + 1.0 / float(self.request.speed)

    def _second(self) -> None:
        second = self._run.step(self._seat)
        sample = Sample(self.id, self.epoch, second.seq, time.time(), second.row, self.service)
        self._segments[-1].rows.append(second.row)
        self.current, self._last_row = sample, second.row
        for listener in self._listeners:
            listener.sample(sample)
        for told in self._watcher.watch(second):
            self._tell(*told)
        if second.over:
            self.state = TwinStateName.FINISHED
            self._tell(self._run.time, EventKind.FINISHED, {"samples": self._run.seq})
            self._stopping = True

    def _tell(self, simulated: float, kind: EventKind, details: dict[str, Any]) -> None:
        plain = {
            name: None if isinstance(value, float) and not math.isfinite(value) else value
            for name, value in details.items()
        }
        event = Event(self.id, self.epoch, self._next_event, time.time(), simulated, kind, plain)
        self._next_event += 1
        with self._lock:
            self._events.append(event)
            self._unsaved_events.append(event)
        for listener in self._listeners:
            listener.event(event)

    # What is kept.

    def _maybe_store(self, stored: float) -> float:
        now = time.monotonic()
        segment = self._segments[-1]
        full = len(segment.rows) >= SEGMENT_ROWS_MAX
        if full or (now - stored >= self._checkpoint_s and (len(segment.rows) > segment.saved or self._events)):
            self._store()
            return now
        return stored

    def _store(self) -> None:
        """Hand a checkpoint to the keeper."""
        segment = self._segments[-1]
        with self._lock:
            events = tuple(event.document() for event in self._events)
            self._events.clear()
        memories = {"fallback": self._seat.fallback.memory, "late": self._late.memory}
        memories["told"] = np.array(self._next_event)
        if self._last_row:
            memories["row"] = np.array(self._last_row)
        memory = getattr(self._actor, "memory", None)
        if memory is not None:
            memories["controller"] = memory
        checkpoint = Checkpoint(
            str(self.state), self.request.model_dump(include=CHANGEABLE), self._run.snapshot(**memories), segment.first,
            len(segment.rows), None, events,
        )  # fmt: skip
        self._keeper.keep(Draft(self.id, self.epoch, checkpoint, segment, self._saved, self._superseded))
        if len(segment.rows) >= SEGMENT_ROWS:
            with self._lock:
                self._segments.append(Segment(segment.end))

    def _saved(self, checkpoint: Checkpoint) -> None:
        """The keeper has stored a checkpoint: what was only in memory may go."""
        stored = {document["seq"] for document in checkpoint.events}
        with self._lock:
            self._unsaved_events = [event for event in self._unsaved_events if event.seq not in stored]
            while len(self._segments) > 1 and self._segments[0].saved == len(self._segments[0].rows):
                self._segments.pop(0)

    def _superseded(self) -> None:
        log.warning("twin %s runs elsewhere now", self.id)
        self._gone = True
        self._commands.put(None)

    def _end(self) -> None:
        if isinstance(self._asked, Deadline):
            self._asked.close()
        if not self._gone:
            self._store()
        self._refuse_the_rest()
        for listener in self._listeners:
            listener.closed(self.id)

    def _refuse_the_rest(self) -> None:
        """Answer the commands that came too late, so that nobody waits for them."""
        with self._lock:
            self._ended = True
        while not self._commands.empty():
            item = self._commands.get()
            if item is not None:
                item[1].set_exception(self._over())

    def _over(self) -> InputError:
        return InputError("twin", [("", f"{self.id!r} has ended")])

    def rows_from(self, first: int) -> tuple[int, list[tuple[float, ...]]]:
        """(number of the first, rows) that are in memory, from `first` on; every row before them is stored."""
        with self._lock:
            segments = list(self._segments)
        begin = max(first, segments[0].first)
        rows = [row for segment in segments for row in segment.rows[max(0, begin - segment.first) :]]
        return begin, rows

    @property
    def settled(self) -> bool:
        """Whether it has ended and all it told is stored."""
        with self._lock:
            segment = self._segments[-1]
            stored = segment.saved == len(segment.rows) and not self._unsaved_events
        return (stored or self._gone) and not self._thread.is_alive()

    @property
    def samples(self) -> int:
        """Samples told since the twin was first started."""
        return self._segments[-1].end

    @property
    def events_told(self) -> int:
        """Events told since the twin was first started."""
        return self._next_event

    def events_in_memory(self) -> list[Event]:
        """Events that may not be stored yet."""
        with self._lock:
            return list(self._unsaved_events)

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
        reply: Future[Any] = Future()
        with self._lock:
            if self._ended:
                raise self._over()
            self._commands.put((command, reply))
        return reply.result(patience_s)

    def pause(self) -> None:
        """Stand still until `go_on`. In the twin's thread, like every command below."""
        self._check_alive()
        if self.state is TwinStateName.RUNNING:
            self._change(paused=True)
            self.state = TwinStateName.PAUSED
            self._tell(self._run.time, EventKind.PAUSED, {})

    def go_on(self) -> None:
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
        asked = self._timed()
        self._seat = self._seat._replace(decide=asked.decide)
        self._use(asked)
        self._tell(self._run.time, EventKind.SPEED_CHANGED, {"speed": speed})

    def set_controller(self, controller: str) -> None:
        """Let another controller decide from the next second on."""
        self._check_alive()
        self._take_seat(controller)
        self._change(controller=controller, certificate=None)
        details = {"controller": controller, "service": self.service}
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
        if self.state not in (TwinStateName.RUNNING, TwinStateName.PAUSED):
            raise InputError("twin", [("", f"{self.id!r} is {self.state}")])

    def _change(self, **changes: Any) -> None:
        self.request = self.request.model_copy(update=changes)

    def close(self) -> None:
        """Let the thread store where it stands and end; a restart goes on from there."""
        self._commands.put(None)

    def join(self, patience_s: float) -> None:
        """Wait for the thread, if there is one."""
        if self._thread.ident is not None:
            self._thread.join(patience_s)

    @property
    def alive(self) -> bool:
        """Whether its thread still runs."""
        return self._thread.is_alive()
