"""One live twin: a thread that steps its run on the clock, obeys commands, tells listeners and the keeper."""

from __future__ import annotations

import logging
import math
import queue
import threading
import time
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from functools import partial
from typing import Any

import numpy as np

from api.problems import conflict
from api.store.records import Checkpoint, KeptAnswer
from api.twins.events import Watcher
from api.twins.feed import CERTIFIED, COLUMNS, UNCERTIFIED, Event, EventKind, Listener, Sample
from api.twins.keeper import Draft, Keeper
from api.twins.schemas import ALIVE, CHANGEABLE, MAX, Speed, TwinRequest, TwinStateName
from api.twins.seated import Seated
from api.twins.told import Told
from controllers.registry import FALLBACK
from station import Controller, InputError
from station.live import LiveRun

log = logging.getLogger(__name__)

REBASE_S = 1.0
"""A twin that is later than this gives up catching up and goes on from now [s]."""

BEHIND_MAX = 8
"""A twin as fast as possible waits when so many checkpoints are not stored yet."""

LATE_S = 0.1
"""A tick later than this counts as late [s]."""


class LiveTwin:
    """A twin that runs in this process.

    Only its thread touches the run; others read `current`, what it has `told`, or send commands.
    """

    def __init__(
        self, twin_id: str, request: TwinRequest, epoch: int, *, keeper: Keeper, listeners: Iterable[Listener],
        create_controller: Callable[[str, str], Controller], checkpoint_s: float,
        on_late: Callable[[], None] = lambda: None, events: int = 0,
    ) -> None:  # fmt: skip
        self.id = twin_id
        self.request = request
        self.epoch = epoch
        self.state = TwinStateName.PAUSED if request.paused else TwinStateName.RUNNING
        self.current: Sample | None = None
        self.ticks_late = 0
        self.lateness_max_s = 0.0
        self._on_late = on_late
        self._keeper = keeper
        self._listeners = tuple(listeners)
        self._seated = Seated(lambda controller: create_controller(controller, twin_id), request.scenario.told)
        self._checkpoint_s = checkpoint_s
        self._run = LiveRun(request.scenario, request.at_end, request.replication, request.seed)
        self._watcher = Watcher()
        self._commands: queue.SimpleQueue[tuple[Callable[[], Any], Future[Any]] | None] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._awaited: dict[Future[None], KeptAnswer | None] = {}  # commands obeyed that no stored checkpoint has yet
        self.first, self.first_event = 0, events  # of this epoch
        self.told = Told(events)
        self._stopping = False
        self._gone = False  # another server has it
        self._ended = False  # no command is obeyed any more
        self.end_stored: Future[None] = Future()  # that it has ended for good; done, too, if nobody will store it
        self._thread = threading.Thread(target=self._main, name=f"twin-{twin_id}", daemon=True)

    # Starting.

    def start(self) -> None:
        """Begin at the first second."""
        self._seated.take(self.request.controller, self.request.speed)
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
        try:
            self._seated.take(self.request.controller, self.request.speed)
        except Exception as error:  # noqa: BLE001  # whatever a plug-in raises, the station goes on
            log.warning("twin %s: controller %s does not start: %r", self.id, self.request.controller, error)
            self._change(controller=FALLBACK, certificate=None)
            self._seated.take(FALLBACK, self.request.speed)
            memory = f"{FALLBACK} in its place: {error or repr(error)}"
        else:
            memory = "restored" if self._seated.remember(memories) else "anew"
        self._go_on_behind(memories)
        details = {"from_seq": self.first, "controller": self.request.controller, "memory": memory}
        details["service"] = self.service
        self._begin(EventKind.RESUMED, details)

    def _go_on_behind(self, memories: dict[str, np.ndarray]) -> None:
        """Tell nothing anew that was told before the snapshot, and give no event a number given before."""
        row = tuple(memories.get("row", np.zeros(0)).ravel().tolist())
        row = row if len(row) == len(COLUMNS) else ()
        if row:
            self._watcher.resume(row)
        self.first = self._run.seq
        self.told.go_on(self.first, int(memories.get("told", np.zeros(()))), row)
        self.first_event = self.told.events

    def _begin(self, kind: EventKind, details: dict[str, Any]) -> None:
        if self._run.over:
            self.state, self._stopping = TwinStateName.FINISHED, True
        for listener in self._listeners:
            listener.opened(self.id)
        self._tell(self._run.time, kind, details)
        self._thread.start()

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
        if late > LATE_S:
            self.ticks_late += 1
            self._on_late()
        return now if late > REBASE_S else due + 1.0 / float(self.request.speed)

    def _second(self) -> None:
        second = self._run.step(self._seated.seat)
        sample = Sample(self.id, self.epoch, second.seq, time.time(), second.row, self.service)
        self.told.add(second.row)
        self.current = sample
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
        event = Event(self.id, self.epoch, self.told.events, time.time(), simulated, kind, plain)
        self.told.add_event(event)
        for listener in self._listeners:
            listener.event(event)

    # What is kept.

    def _maybe_store(self, stored: float) -> float:
        now = time.monotonic()
        if self.told.full or (now - stored >= self._checkpoint_s and self.told.waiting):
            self._store()
            return now
        return stored

    def _store(self) -> None:
        """Hand a checkpoint to the keeper."""
        segment = self.told.segment
        events = tuple(event.document() for event in self.told.take_events())
        memories = {**self._seated.memories(), "told": np.array(self.told.events)}
        if self.told.last_row:
            memories["row"] = np.array(self.told.last_row)
        awaited = dict(self._awaited)
        answers = tuple(answer for answer in awaited.values() if answer is not None)
        checkpoint = Checkpoint(
            str(self.state), self.request.model_dump(include=CHANGEABLE), self._run.snapshot(**memories), segment.first,
            len(segment.rows), None, events, answers,
        )  # fmt: skip
        saved = partial(self._saved, tuple(awaited))
        urgent = bool(awaited) or self.state not in ALIVE
        self._keeper.keep(Draft(self.id, self.epoch, checkpoint, segment, saved, self._superseded, urgent=urgent))
        self.told.turn()

    def store_with(self, answer: KeptAnswer | None = None) -> Future[None]:
        """Store now, and with it the answer to a command; in the twin's thread. Done when it is stored."""
        stored: Future[None] = Future()
        self._awaited[stored] = answer
        self._store()
        return stored

    def _saved(self, awaited: Iterable[Future[None]], checkpoint: Checkpoint) -> None:
        self.told.saved(checkpoint)
        if checkpoint.state not in ALIVE and not self.end_stored.done():
            self.end_stored.set_result(None)
        for stored in awaited:
            if stored in self._awaited:
                del self._awaited[stored]
                stored.set_result(None)

    def _superseded(self) -> None:
        log.warning("twin %s runs elsewhere now", self.id)
        self._gone = True
        if not self.end_stored.done():
            self.end_stored.set_result(None)
        self._commands.put(None)
        while self._awaited:
            stored, _ = self._awaited.popitem()
            stored.set_exception(conflict(f"twin {self.id!r} runs elsewhere now"))

    def _end(self) -> None:
        self._seated.close()
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

    @property
    def settled(self) -> bool:
        """Whether it has ended and all it told is stored."""
        return (self.told.stored or self._gone) and not self._thread.is_alive()

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
        self._seated.hurry(speed)
        self._tell(self._run.time, EventKind.SPEED_CHANGED, {"speed": speed})

    def set_controller(self, controller: str) -> None:
        """Let another controller decide from the next second on."""
        self._check_alive()
        self._seated.take(controller, self.request.speed)
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
        if self.state not in ALIVE:
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
    def begun(self) -> bool:
        """Whether it has told where its epoch begins."""
        return self._thread.ident is not None

    @property
    def alive(self) -> bool:
        """Whether its thread still runs."""
        return self._thread.is_alive()
