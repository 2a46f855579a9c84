"""The reserve rule: made to be certified. High is kept for the end of each fill; low, then medium begin it."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from controllers.base import CompiledBase, Settings
from controllers.estimate import ESTIMATE_SIZE, believed_vehicle, told_by
from station.compiled import callback, kernel
from station.controller import DECIDE, CompiledController, Decision, Observation
from station.limits import inlet_limit, outlet_limit
from station.loop import CLOSED_CONTROLLER
from station.plant import PlantConstants

# Entries of the settings, and of the memory behind the estimate.
SLOT, GAP, STOP = 0, 1, 2
_VEHICLE, _STAGE = ESTIMATE_SIZE, ESTIMATE_SIZE + 1
_MEMORY_SIZE = ESTIMATE_SIZE + 2


class ReserveSettings(Settings):
    """Settings of `reserve`; all have defaults that fit any station."""

    slot_s: Annotated[
        int,
        Field(
            ge=1, le=60, description="How long a buffer's turn at the compressor lasts",
            json_schema_extra={"unit": "s"},
        ),
    ] = 10  # fmt: skip
    gap_bar: Annotated[
        float,
        Field(
            ge=0, le=2000, allow_inf_nan=False,
            description="Gap at which low and medium hand the vehicle on, where it exceeds the dispenser's least",
            json_schema_extra={"unit": "bar"},
        ),
    ] = 0.0  # fmt: skip
    stop_share: Annotated[
        float, Field(gt=0, le=1, description="A buffer is full at this share of the compressor's pressure")
    ] = 0.95


@kernel
def _outlet(observation: Observation, model: PlantConstants, settings: np.ndarray, memory: np.ndarray) -> int:
    """The buffer to dispense from, or -1; low, medium, high, without going back within a vehicle."""
    if observation.vehicle < 0:
        memory[_VEHICLE] = 0.0
        return -1
    pressure, temperature = believed_vehicle(observation, model, memory)
    if memory[_VEHICLE] != observation.vehicle + 1:
        memory[_VEHICLE], memory[_STAGE] = observation.vehicle + 1, 2
    gap = max(settings[GAP], model.outlet_gap_min)
    while memory[_STAGE] > 0 and observation.pressure[int(memory[_STAGE])] - pressure < gap:
        memory[_STAGE] -= 1
    buffer = int(memory[_STAGE])
    limit = outlet_limit(observation.pressure[buffer], True, pressure, temperature, model, observation.period)
    return buffer if limit == 0 else -1


@kernel
def _inlet(outlet: int, observation: Observation, model: PlantConstants, settings: np.ndarray) -> int:
    """The first buffer of the turn's order that is neither full, too warm nor dispensing; or -1.

    While a buffer dispenses, the two others take turns and none takes the other's. While a vehicle waits for pressure
    high comes first, and while nobody is connected each buffer in turn.
    """
    turn = int(np.floor(observation.time / settings[SLOT]))
    first, places = 0, 3
    if outlet >= 0:
        places = 1
        first = turn % 2 if outlet == 2 else (1 + turn % 2 if outlet == 0 else 2 * (turn % 2))
    elif observation.vehicle < 0:
        first = turn % 3
    for place in range(places):
        buffer = (first + place) % 3
        pressure, temperature = observation.pressure[buffer], observation.temperature[buffer]
        if buffer == outlet or pressure >= settings[STOP]:
            continue
        if inlet_limit(buffer, pressure, temperature, True, False, model, observation.period) == 0:
            return buffer
    return -1


@callback(DECIDE)
def decide_reserve(
    observation: Observation, model: PlantConstants, settings: np.ndarray, memory: np.ndarray
) -> Decision:
    """At most one outlet and one inlet."""
    outlet = _outlet(observation, model, settings, memory)
    inlet = _inlet(outlet, observation, model, settings)
    return Decision(((8 << outlet) if outlet >= 0 else 0) | ((1 << inlet) if inlet >= 0 else 0), 0, np.nan, np.nan)


class Waiting(CompiledBase):
    """Opens nothing: asked where the shield closes a valve of the reserve rule."""

    name = "waiting"

    def compiled(self) -> CompiledController:
        """The controller that keeps every valve closed."""
        return CLOSED_CONTROLLER


class Reserve(CompiledBase):
    """Begins each fill with low and medium while the compressor raises high, which ends it.

    A vehicle never goes back to a buffer, and no decision compares two buffers: that is what lets its service be
    proved for boxes of states (`controllers.certified`). Like logic it is exempt from Eq. (7.16).
    """

    name = "reserve"
    about = "a rule with a certificate of service: fills begin with low and medium, high is kept for their end"
    obeys_hold = False
    settings_type = ReserveSettings
    settings_key = "reserve"

    def compiled(self) -> CompiledController:
        """This controller for the compiled loop, fresh."""
        settings: ReserveSettings = self.settings_for(self.station)
        stop = settings.stop_share * self.station.compressor.pressure_bar
        vector = np.array([settings.slot_s, settings.gap_bar, stop], dtype=np.float64)
        memory = told_by(self.station, np.zeros(_MEMORY_SIZE))
        return CompiledController(decide_reserve, self.station.constants(), vector, memory, self.obeys_hold)

    @property
    def fallback(self) -> CompiledBase:
        """Nobody: where the shield closes a valve, that side waits."""
        return Waiting()
