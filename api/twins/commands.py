"""Commands to live twins: another speed or controller, a vehicle, to stop; and to delete one that has ended."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future
from typing import Any

from pydantic import ValidationError

from api.controllers.service import check
from api.http.problems import conflict, input_error, not_found
from api.http.timeseries import Selection
from api.twins.alarm_schemas import AlarmAction, TwinAlarm
from api.twins.command_schemas import (
    COMMAND,
    AlarmCommand,
    Command,
    ContinueCommand,
    ControllerCommand,
    PauseCommand,
    SpeedCommand,
    StopCommand,
    VehicleCommand,
)
from api.twins.durable import CheckState, KeepAnswer, ask
from api.twins.estimates import ailing
from api.twins.fork import TwinFork, fork_of_twin
from api.twins.measured import MeasuredTwin
from api.twins.measured_commands import MeasuredCommands
from api.twins.paced import PacedTwin
from api.twins.schemas import ALIVE, Source, TwinChange, VehicleRequest
from api.twins.shown import state_of
from api.twins.simulated import SimulatedTwin
from api.twins.state_schemas import TwinState
from station import InputError, Scenario
from station.forecasting.demand import Seen, seen_of

SEEN_S = 86_400
"""So much of what a measured twin has seen says how vehicles come [s]."""

BY_COMMAND = "zenoh"
"""Who did something with an alarm that a command names: zenoh says who may, and not who did."""

REMOTE = "remote"
"""Name of the controller that asks whoever answers the twin's key `decide`."""


class TwinCommands(MeasuredCommands):
    """Commands to live twins; each is done by the twin's own thread, between two seconds, and answered when stored."""

    def change(self, twin_id: str, change: TwinChange, check_state: CheckState = None) -> TwinState:
        """Change speed, controller or pause of a live twin; all or nothing of it.

        `check_state` may raise what refuses the change; nobody else's comes between.

        Raises
        ------
        NotYet
            if that is not stored within 2 s.
        """
        twin = self._paced(twin_id)
        decided = None if change.controller is None else self._simulated(twin_id)
        if decided is not None and change.controller is not None:
            self._check_controller(change.controller, [twin.request.scenario])
        checked = self._checked(twin, check_state)

        def apply() -> Future[None]:
            checked()
            if decided is not None and change.controller is not None:
                decided.set_controller(change.controller)
            if change.speed is not None:
                twin.set_speed(change.speed)
            if change.paused is not None:
                (twin.pause if change.paused else twin.continue_)()
            return twin.store_with()

        self._wait_for(ask(twin, apply))
        return self.state(twin_id)

    def add_vehicle(self, twin_id: str, vehicle: VehicleRequest, keep: KeepAnswer = None) -> TwinState:
        """Let a vehicle arrive at a live twin.

        What `keep` makes of where it stands then is kept with the checkpoint that holds the vehicle.

        Raises
        ------
        NotYet
            if that is not stored within 2 s.
        """
        twin = self._simulated(twin_id)
        stored = self._stored(twin_id)

        def add() -> tuple[TwinState, Future[None]]:
            twin.add_vehicle(vehicle.figures())
            state = state_of(stored, twin, twin.last)
            return state, twin.store_with(None if keep is None else keep(state))

        state, kept = ask(twin, add)
        self._wait_for(kept)
        return state

    def alarm(self, twin_id: str, name: str, action: AlarmAction, by: str) -> TwinAlarm:
        """Do something with an alarm of a live twin, and say who did; the alarm then.

        Raises
        ------
        NotYet
            if that is not stored within 2 s.
        ProblemError
            404 where no alarm has that name; 409 where it cannot be done, the twin has ended or is a replay.
        """
        twin = self._alive(twin_id)
        if twin.alarms is not None and name not in twin.alarms.alarms:
            raise not_found("alarm", name)

        def act() -> tuple[TwinAlarm, Future[None]]:
            try:
                alarm = TwinAlarm.of(twin.alarm(name, action, by))
            except InputError as error:
                raise conflict("; ".join(reason for _, reason in error.problems)) from None
            return alarm, twin.store_with()

        alarm, stored = ask(twin, act)
        self._wait_for(stored)
        return alarm

    def fork(self, twin_id: str) -> TwinFork:
        """Fork of a live twin between two seconds, for forecasts.

        Of one that follows measurements it has the faults which were found and last.
        """
        twin = self._alive(twin_id)
        if isinstance(twin, SimulatedTwin):
            found: TwinFork = ask(twin, twin.fork)
            return found
        if not isinstance(twin, MeasuredTwin):
            raise conflict(f"twin {twin_id!r} plays a stretch of another again: what came of it is known")
        seq, belief = ask(twin, twin.belief)
        if belief is None:
            raise conflict(f"twin {twin_id!r} has followed no second yet")
        seen = self._seen(twin_id, seq - 1)
        scenario, doubt = ailing(self, twin_id)
        return fork_of_twin(scenario, float(seq), belief, seen, twin.journal.events)._replace(doubt=doubt)

    def _seen(self, twin_id: str, seq: int) -> Seen:
        """The vehicles that a measured twin has seen connect in the day before, at the pressures they came with."""
        first = max(0, seq - SEEN_S)
        names = ("measured_vehicle", "measured_pressure_vehicle")
        found = self.columns(twin_id, Selection(names, float(first), float(seq)))
        station = self.scenario(twin_id).station
        return seen_of(found["time"], found[names[0]], found[names[1]], station, float(seq - first))

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

            ask(twin, stop)
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
        live = [each for each in self._live.values() if each.state in ALIVE and each.request.source is Source.REPLAY]
        if playing := [each.id for each in live if each.request.of == twin_id]:
            raise conflict(f"twin {twin_id!r} is played by {', '.join(map(repr, playing))}; stop that first")
        twin = self._live.get(twin_id)
        if twin is not None:
            twin.join(5.0)
            if twin.alive:
                raise conflict(f"twin {twin_id!r} is still ending")
        with self._lock:
            self._store.remove(twin_id)  # before what is known of its end, or that is lost where the store refuses
            self._checkpointer.forget(twin_id)  # or it would be written to the next twin of that id
            self._live.pop(twin_id, None)
        self.on_removed(twin_id)

    def command(self, twin_id: str, document: Any) -> TwinState:
        """Do what a command's document says.

        Raises
        ------
        InputError
            if it is no command of `api.twins.command_schemas.COMMAND`.
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
            case AlarmCommand():
                self.alarm(twin_id, given.alarm, given.do, BY_COMMAND)
                return self.state(twin_id)
            case StopCommand():
                return self.stop(twin_id)

    def _paced(self, twin_id: str) -> PacedTwin:
        twin = self._alive(twin_id)
        if not isinstance(twin, PacedTwin):
            raise conflict(
                f"twin {twin_id!r} follows measurements: it has no controller, speed, pause or vehicles of its own"
            )
        return twin

    def _simulated(self, twin_id: str) -> SimulatedTwin:
        twin = self._paced(twin_id)
        if not isinstance(twin, SimulatedTwin):
            raise conflict(
                f"twin {twin_id!r} is a replay of {twin.request.of!r}: it has no controller or vehicles of its own"
            )
        return twin

    def _check_controller(self, controller: str, scenarios: Sequence[Scenario]) -> None:
        if controller != REMOTE:
            check(controller, scenarios, self._settings)
