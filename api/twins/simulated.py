"""A simulated twin: its run is stepped on the clock, by a controller that can be changed."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np

from api.store.records import StoredTwin
from api.twins.controller_slot import ControllerSlot
from api.twins.days import document
from api.twins.event_detection import EventDetector
from api.twins.fork import TwinFork
from api.twins.messages import EventKind
from api.twins.paced import PacedTwin
from api.twins.schemas import Speed, TwinRequest, TwinStateName
from controllers.registry import FALLBACK
from station import Controller
from station.alarms.inputs import SecondInputs, left_incomplete
from station.arrivals import Vehicles
from station.faults.kinds import Fault
from station.forecasting.demand import FIGURES
from station.forecasting.fork import fork_arrays
from station.forecasting.futures import GRID
from station.geometry import BUFFERS
from station.live import LiveRun, Second
from station.measured_second import LiveSensors
from station.run import ARRIVED, PRESSURE

log = logging.getLogger(__name__)

_PRESSURES = slice(PRESSURE, PRESSURE + len(BUFFERS))


class SimulatedTwin(PacedTwin):
    """A twin whose scenario is simulated, second by second."""

    def __init__(
        self, stored: StoredTwin, request: TwinRequest, *, create_controller: Callable[[str, str], Controller],
        **kept: Any,
    ) -> None:  # fmt: skip
        super().__init__(stored, request, **kept)
        self._slot = ControllerSlot(
            lambda controller: create_controller(controller, stored.id), request.scenario.known_station
        )
        self._run = LiveRun(request.drilled, request.at_end, request.replication, request.seed)
        self._detector = EventDetector(request.scenario.station.plant)
        self._inputs = SecondInputs()
        self._coming = deque(request.coming)
        self._sensors = LiveSensors(request.drilled.faults)

    # Starting.

    def start(self) -> None:
        """Begin at the first second."""
        self._slot.take(self.request.controller, self.request.speed)
        about = {"scenario": self.request.scenario.name, "controller": self.request.controller}
        self._begin(EventKind.STARTED, {**about, "speed": self.request.speed, "service": self.certification})

    def start_from(self, snapshot: bytes) -> None:
        """Begin with the state of another twin at a second of it.

        Raises
        ------
        InputError
            if the snapshot cannot be read.
        """
        memories = self._run.restore(snapshot)
        self._slot.take(self.request.controller, self.request.speed)
        self._slot.remember(memories)
        self._go_on_behind(memories)
        about = {"scenario": self.request.scenario.name, "of": self.request.of, "at_s": self.request.at_s}
        details = {**about, "controller": self.request.controller, "speed": self.request.speed}
        self._begin(EventKind.STARTED, {**details, "service": self.certification})

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
        self._coming = deque(each for each in self.request.coming if each.at_s >= self._run.time)
        self.days.resume(memories, self._run.seq - self._run.over)
        self._resume_told(memories, self._run.seq)
        self._sensors.resume(memories)
        if self.journal.last_row:
            self._detector.resume(self.journal.last_row)

    def _begin(self, kind: EventKind, details: dict[str, Any]) -> None:
        if self._run.over:
            self.state, self._stopping = TwinStateName.FINISHED, True
        super()._begin(kind, details)

    @property
    def _time(self) -> float:
        return self._run.time

    # The thread.

    def _second(self) -> None:
        while self._coming and self._coming[0].at_s <= self._run.time:
            self.add_vehicle(self._coming.popleft().figures)
        second = self._run.step(self._slot.state)
        self._sample(second.seq, second.row, self._sensors.second(second.row, second.seq))
        wait = self._wait_of(second)
        for told in self._detector.watch(second, wait):
            self._tell(*told)
        if self.alarms is not None:
            incomplete = left_incomplete(second.left, second.figures)
            inputs = self._inputs.of(second.row, self._run.waited, self.late_s, incomplete=incomplete)
            self._tell_alarms(self.alarms.advance(*inputs))
        if self.shadow.settings is not None:
            self._shadowed(second)
        day = self.days.add(second, wait)
        if day is not None:
            self._tell(day["to_s"], EventKind.DAY_END, document(day))
        if second.over:
            self.state = TwinStateName.FINISHED
            self._tell(self._run.time, EventKind.FINISHED, {"samples": self._run.seq})
            self._stopping = True

    def _shadowed(self, second: Second) -> None:
        """Tell the stretches that last what came in a second, and begin another with the next one."""
        shadow, row = self.shadow, second.row
        for number in second.arrived:
            figures = second.figures if number == second.left else self._run.vehicle(number)
            for stretch in shadow.lasting:
                stretch.came.append(tuple(figures[name] for name in Vehicles._fields))
        if second.seq % GRID == 0:
            for stretch in shadow.lasting:
                stretch.pressures.append(row[_PRESSURES])
        if shadow.lasting and shadow.lasting[0].end == second.seq:
            # Vehicles that have announced themselves by now were known before its end.
            known = self._run.fork().known(float(self.request.scenario.announcement_s))
            coming = known.vehicles[FIGURES, known.counters[ARRIVED] :]
            shadow.lasting[0].came += [tuple(each) for each in coming.T.tolist()]
        shadow.close(second.seq)
        if shadow.begins(second.seq + 1) and not second.over:
            memories = self._slot.memories()
            kept = {f"memory_{name}": memories[name] for name in ("controller", "fallback") if name in memories}
            arrays = {**fork_arrays(self._run.fork().here()), **kept}
            shadow.open(second.seq + 1, self.request.controller, arrays)

    def _wait_of(self, second: Second) -> float | None:
        """How long the vehicle has waited that was connected in a second [s]; None if none was."""
        if second.connected < 0:
            return None
        known = second.figures if second.left == second.connected else self._run.vehicle(second.connected)
        return known["connected"] - known["arrival"]

    # What is kept.

    def _memories(self) -> dict[str, np.ndarray]:
        return {
            **self._slot.memories(), **self.days.memories(), **self._sensors.memories(), **super()._memories(),
        }  # fmt: skip

    def _snapshot(self, memories: dict[str, np.ndarray]) -> bytes:
        return self._run.snapshot(**memories)

    def _close(self) -> None:
        self._slot.close()

    # Commands, from other threads.

    def set_speed(self, speed: Speed) -> None:
        """Run at another speed, with its deadline. In the twin's thread, like every command below."""
        super().set_speed(speed)
        self._slot.set_deadline(speed)

    def fork(self) -> TwinFork:
        """Fork of the run with what decides it, for forecasts."""
        self._check_alive()
        request, memory = self.request, self._slot.memories().get("controller")
        return TwinFork(
            request.drilled, request.replication, request.controller, None if memory is None else memory.copy(),
            self._run.fork(), self._run.seen(), self.journal.events,
        )  # fmt: skip

    def standing(self) -> tuple[bytes, str]:
        """Snapshot of the run as it stands, and who decides it."""
        self._check_alive()
        row = {"row": np.array(self.journal.last_row)} if self.journal.last_row else {}
        return self._run.snapshot(**self._slot.memories(), **self._sensors.memories(), **row), self.request.controller

    def set_controller(self, controller: str) -> None:
        """Let another controller decide from the next second on."""
        self._check_alive()
        self._slot.take(controller, self.request.speed)
        self._change(controller=controller, certificate=None)
        self.shadow.change()
        details = {"controller": controller, "service": self.certification}
        self._tell(self._run.time, EventKind.CONTROLLER_CHANGED, details)

    def drill(self, drills: list[Fault], told: dict[str, Any]) -> None:
        """Let the faults of its drills be these from the next second on."""
        self._check_alive()
        self._change(drills=drills)
        drilled = self.request.drilled
        self._run.set_faults(drilled)
        self._sensors.set_faults(drilled.faults)
        self._tell(self._run.time, EventKind.DRILL, told)

    def add_vehicle(self, figures: dict[str, float]) -> int:
        """Let a vehicle arrive with the next second; its number."""
        self._check_alive()
        number = self._run.add_vehicle(**figures)
        self._tell(self._run.time, EventKind.VEHICLE_ADDED, {"vehicle": number, **figures})
        return number
