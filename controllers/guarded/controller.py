"""The guarded controller: `switched` while the reserve rule could still keep the promise, else that rule."""

from __future__ import annotations

import numpy as np

from controllers.estimate import ESTIMATE_SIZE, estimate_vehicle, use_station_prediction
from controllers.guarded.future import TANKS_SIZE, keeps, note_tanks
from controllers.guarded.settings import OWN, GuardedSettings, guarded_vector, promise_in, rule_in
from controllers.reserve.controller import Reserve
from controllers.reserve.rule import MEMORY_SIZE as SHADOW_SIZE
from controllers.reserve.rule import reserve_command
from controllers.switched.controller import (
    LONG_AGO,
    Switched,
    leave_plan,
    look,
    note_command,
    plan_anew,
    planned_command,
)
from controllers.switched.controller import MEMORY_SIZE as PLAN_SIZE
from station.compiled import callback, kernel
from station.control_model import ControlModel, as_thesis
from station.controller import DECIDE, CompiledController, Decision, Observation, Status
from station.parameters import Station
from station.planning import Model, advance, is_thesis
from station.run import PERIOD

# Parts of the memory: that of `switched`, of the reserve rule as if it had decided all along, an estimate of the
# vehicle, the tanks as they are expected, room for futures, who decides, the vehicle and when it connected.
_SHADOW = PLAN_SIZE
_ESTIMATE = _SHADOW + SHADOW_SIZE
_TANKS = _ESTIMATE + ESTIMATE_SIZE
_ROOM_SHADOW = _TANKS + TANKS_SIZE
_ROOM_TANKS = _ROOM_SHADOW + SHADOW_SIZE
_RULES = _ROOM_TANKS + TANKS_SIZE
_VEHICLE, _SINCE = _RULES + 1, _RULES + 2
MEMORY_SIZE = _RULES + 3

_FEASIBLE, _RULE = int(Status.FEASIBLE), int(Status.RULE)


@kernel
def _kept(command: int, observation: Observation, model: Model, settings: np.ndarray, memory: np.ndarray) -> bool:
    """Whether the promise can be kept after a command."""
    shadow, tanks = memory[_ROOM_SHADOW:_ROOM_TANKS], memory[_ROOM_TANKS:_RULES]
    shadow[:], tanks[:] = memory[_SHADOW:_ESTIMATE], memory[_TANKS:_ROOM_SHADOW]
    return keeps(command, memory[_SINCE], observation, promise_in(settings), model, rule_in(settings), shadow, tanks)


@kernel
def _may(
    wanted: int, safe: int, observation: Observation, model: Model, settings: np.ndarray, memory: np.ndarray
) -> bool:
    """Whether a command may be given in place of the rule's: the promise can be kept after it.

    Where it is certified nowhere, as at real gas, the rule takes over to keep it, not where it could not either.
    """
    if _kept(wanted, observation, model, settings, memory):
        return True
    return not is_thesis(model) and not _kept(safe, observation, model, settings, memory)


@kernel
def _note(observation: Observation, model: Model, memory: np.ndarray) -> None:
    """What the guard has to know of this second: the tanks, the vehicle, and when it connected."""
    note_tanks(
        observation, estimate_vehicle(observation, model, memory[_ESTIMATE:_TANKS]), model, memory[_TANKS:_ROOM_SHADOW]
    )
    if observation.vehicle >= 0 and memory[_VEHICLE] != observation.vehicle + 1:
        memory[_VEHICLE], memory[_SINCE] = observation.vehicle + 1, observation.time


@kernel
def _decide(observation: Observation, model: Model, settings: np.ndarray, memory: np.ndarray) -> Decision:
    """The command of the plan in force while the promise can be kept after it, else the reserve rule's."""
    own = settings[OWN:]
    _note(observation, model, memory)
    safe = reserve_command(observation, model, rule_in(settings), memory[_SHADOW:_ESTIMATE])
    seen = look(observation, model, model, own, memory)
    if seen.happened:
        plan_anew(observation, seen, model, own, memory)
        memory[_RULES] = 0.0
    command, status = safe, _RULE
    cost, bound = np.nan, np.nan
    if memory[_RULES] == 0.0:
        wanted = planned_command(seen.allowed, memory)
        if wanted.command == safe or _may(wanted.command, safe, observation, model, settings, memory):
            command, status, cost, bound = wanted
        else:
            memory[_RULES] = 1.0
            leave_plan(memory)
    note_command(observation, command, seen.allowed, memory)
    volume = observation.vehicle_volume if observation.vehicle >= 0 else 0.0
    advance(memory[_TANKS:_ROOM_SHADOW], volume, command, PERIOD, model)
    return Decision(command, status, cost, bound)


@callback(DECIDE, counted=False)
def decide_guarded(observation: Observation, model: ControlModel, settings: np.ndarray, memory: np.ndarray) -> Decision:
    """Decision as the compiled loop calls it."""
    if is_thesis(model):
        return _decide(observation, as_thesis(model), settings, memory)
    return _decide(observation, model, settings, memory)


class Guarded(Switched):
    """`switched` under the guard of the reserve rule, whose certificate of service it keeps.

    A command of `switched` is given if the reserve rule, taking over after it, would finish the vehicle in time and
    leave the buffers ready for the next one; the station's own equations tell. Else the rule decides until
    `switched` plans anew.
    """

    name = "guarded"
    about = "switched as long as the reserve rule can still keep its certified promise afterwards, else that rule"
    obeys_hold = False
    settings_type = GuardedSettings

    def rule(self, station: Station) -> Reserve:
        """The reserve rule that takes over."""
        settings: GuardedSettings = self.settings_for(station)
        own = {"open_bar": settings.open_bar, "stop_share": settings.stop_share}
        found = Reserve(space_s=0, **{name: value for name, value in own.items() if value is not None})
        found.start(station)
        return found

    def compiled(self) -> CompiledController:
        """This controller for the compiled loop, with fresh memory."""
        settings: GuardedSettings = self.settings_for(self.station)
        rule = self.rule(self.station).settings_for(self.station)
        vector = guarded_vector(settings, rule, self.station)
        memory = use_station_prediction(self.station, np.zeros(MEMORY_SIZE))
        use_station_prediction(self.station, memory[_SHADOW:])
        use_station_prediction(self.station, memory[_ESTIMATE:])
        memory[_SINCE] = -LONG_AGO
        return CompiledController(decide_guarded, self.station.control_constants(), vector, memory, self.obeys_hold)
