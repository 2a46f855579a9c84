"""The reserve rule: made to be certified. High is kept for the end of each fill; low, then medium begin it."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from controllers.base import CompiledBase, Settings
from controllers.estimate import ESTIMATE_SIZE, believed_vehicle, told_by
from station.compiled import callback, inlined, uncounted
from station.controller import DECIDE, CompiledController, Decision, Observation
from station.limits import START_SHARE, inlet_limit, outlet_limit, start_limit
from station.loop import CLOSED_CONTROLLER
from station.parameters import Station
from station.plant import HIGH, LOW, MEDIUM, PlantConstants
from station.whole import WHOLE

# Entries of the settings, and of the memory behind the estimate.
SLOT, GAP, OPEN, STOP, SPACE = 0, 1, 2, 3, 6  # from STOP on the pressure at which high, medium and low are full
SETTINGS_SIZE = 7
_VEHICLE, _STAGE, _SINCE, _FREE = range(ESTIMATE_SIZE, ESTIMATE_SIZE + 4)
MEMORY_SIZE = ESTIMATE_SIZE + 4

FIRST, SECOND, WAIT, LAST, AGAIN, IDLE = range(6)
"""Stages of a fill: low dispenses, medium does, the vehicle waits for high, high dispenses, the vehicle waits for it
once more; nobody is filled."""


Gap = Annotated[float, Field(ge=0, le=2000, allow_inf_nan=False, json_schema_extra={"unit": "bar"})]


class ReserveSettings(Settings):
    """Settings of `reserve`; all have defaults that fit any station."""

    slot_s: Annotated[
        int,
        Field(
            ge=1, le=60, description="How long a buffer's turn at the compressor lasts",
            json_schema_extra={"unit": "s"},
        ),
        WHOLE,
    ] = 10  # fmt: skip
    gap_bar: Annotated[
        Gap, Field(description="At which low and medium hand the vehicle on, where it exceeds the dispenser's least")
    ] = 0.0
    stop_share: Annotated[
        float,
        Field(
            gt=0,
            le=1,
            description="A buffer is full at this share of the compressor's pressure; low no later than "
            "where the dispenser's greatest flow would keep an empty vehicle from it",
            json_schema_extra={"unit": "1"},
        ),
    ] = 0.95
    open_bar: Annotated[
        Gap, Field(description="From which high is opened, at first and each time it has come too close")
    ] = 130.0
    space_s: Annotated[
        int,
        Field(
            ge=0, le=7200,
            description="Fills begin at least so far apart: a vehicle of a burst waits until the buffers are restored",
            json_schema_extra={"unit": "s"},
        ),
        WHOLE,
    ] = 0  # fmt: skip


@inlined
def due(second: float, stage: int, slot: float) -> int:
    """The buffer whose turn it is at the compressor, `second` seconds after the last fill has begun.

    Before high is opened it and one of the others take turns: medium until it dispenses, then low. While the vehicle
    first waits for high, all turns are high's. Once high dispenses, the two others take turns, and while the vehicle
    waits once more high has low's. While nobody is filled each has a third: low odd turns and medium even ones, so
    that they are theirs whether or not the fill is over.
    """
    turn = int(np.floor(second / slot))
    if stage == WAIT:
        return HIGH
    if stage == IDLE:
        place = turn % 6
        return HIGH if place % 3 == 0 else (MEDIUM if place % 2 == 0 else LOW)
    if turn % 2 == 0:
        return HIGH if stage < LAST else MEDIUM
    return MEDIUM if stage == FIRST else (HIGH if stage == AGAIN else LOW)


@inlined
def _stage(
    observation: Observation, vehicle: tuple[float, float], model: PlantConstants, settings: np.ndarray,
    memory: np.ndarray,
) -> int:  # fmt: skip
    """The stage of the fill in this second; a vehicle never goes back to a buffer."""
    pressure = vehicle[0]
    gap = max(settings[GAP], model.outlet_gap_min)
    stage = int(memory[_STAGE])
    while stage < WAIT and observation.pressure[LOW - stage] - pressure < gap:
        stage += 1
    above = observation.pressure[HIGH] - pressure
    if stage == LAST and above < model.outlet_gap_min:
        return AGAIN
    opens = above >= max(settings[OPEN], gap) or observation.pressure[HIGH] >= settings[STOP + HIGH]
    if stage in (WAIT, AGAIN) and opens:
        return LAST
    return stage


@inlined
def _outlet(stage: int, observation: Observation, vehicle: tuple[float, float], model: PlantConstants) -> int:
    """The buffer to dispense from, or -1."""
    if stage in (WAIT, AGAIN):
        return -1
    buffer = HIGH if stage == LAST else LOW - stage
    limit = outlet_limit(observation.pressure[buffer], True, vehicle[0], vehicle[1], model, observation.period)
    return buffer if limit == 0 else -1


@inlined
def _inlet(stage: int, second: float, observation: Observation, model: PlantConstants, settings: np.ndarray) -> int:
    """The buffer whose turn it is unless it is full or too warm; or -1.

    Nobody takes another's turn while a vehicle is connected: then what a buffer gets follows from the clock and its
    own state. While nobody is, the next in the order may.
    """
    first = due(second, stage, settings[SLOT])
    for place in range(3 if stage == IDLE else 1):
        buffer = (first + place) % 3
        pressure, temperature = observation.pressure[buffer], observation.temperature[buffer]
        if pressure >= settings[STOP + buffer]:
            continue
        if inlet_limit(buffer, pressure, temperature, True, False, model, observation.period) == 0:
            return buffer
    return -1


@uncounted
def reserve_command(observation: Observation, model: PlantConstants, settings: np.ndarray, memory: np.ndarray) -> int:
    """Bits of Valve: at most one outlet and one inlet. `memory` is (MEMORY_SIZE,), `settings` (SETTINGS_SIZE,)."""
    stage, outlet = IDLE, -1
    if observation.vehicle >= 0:
        vehicle = believed_vehicle(observation, model, memory)
        if memory[_VEHICLE] != observation.vehicle + 1 and observation.time >= memory[_FREE]:
            memory[_VEHICLE], memory[_STAGE], memory[_SINCE] = observation.vehicle + 1, FIRST, observation.time
            memory[_FREE] = observation.time + settings[SPACE]
        if memory[_VEHICLE] == observation.vehicle + 1:
            stage = _stage(observation, vehicle, model, settings, memory)
            memory[_STAGE] = stage
            outlet = _outlet(stage, observation, vehicle, model)
    else:
        memory[_VEHICLE] = 0.0
    inlet = _inlet(stage, observation.time - memory[_SINCE], observation, model, settings)
    return ((8 << outlet) if outlet >= 0 else 0) | ((1 << inlet) if inlet >= 0 else 0)


@callback(DECIDE)
def decide_reserve(
    observation: Observation, model: PlantConstants, settings: np.ndarray, memory: np.ndarray
) -> Decision:
    """The command of the rule."""
    return Decision(reserve_command(observation, model, settings, memory), 0, np.nan, np.nan)


def full_pressures(settings: ReserveSettings, station: Station) -> tuple[float, float, float]:
    """The pressures at which high, medium and low are full [bar]."""
    stop = settings.stop_share * station.compressor.pressure_bar
    return stop, stop, min(stop, START_SHARE * start_limit(station.constants()))


def reserve_vector(settings: ReserveSettings, station: Station) -> np.ndarray:
    """The settings the kernel reads (SETTINGS_SIZE,)."""
    full = full_pressures(settings, station)
    return np.array([settings.slot_s, settings.gap_bar, settings.open_bar, *full, settings.space_s], dtype=np.float64)


class Waiting(CompiledBase):
    """Opens nothing: asked where the shield closes a valve of the reserve rule."""

    name = "waiting"

    def compiled(self) -> CompiledController:
        """The controller that keeps every valve closed."""
        return CLOSED_CONTROLLER


class Reserve(CompiledBase):
    """Begins each fill with low and medium while the compressor raises high, which ends it.

    A vehicle never goes back to a buffer, no decision compares two buffers, and turns at the compressor go by the
    clock: that is what lets its service be proved for boxes of states (`controllers.certified`). Like logic it is
    exempt from Eq. (7.16).
    """

    name = "reserve"
    about = "a rule with a certificate of service: fills begin with low and medium, high is kept for their end"
    obeys_hold = False
    settings_type = ReserveSettings
    settings_key = "reserve"

    def compiled(self) -> CompiledController:
        """This controller for the compiled loop, fresh."""
        vector = reserve_vector(self.settings_for(self.station), self.station)
        memory = told_by(self.station, np.zeros(MEMORY_SIZE))
        return CompiledController(decide_reserve, self.station.constants(), vector, memory, self.obeys_hold)

    @property
    def fallback(self) -> CompiledBase:
        """Nobody: where the shield closes a valve, that side waits."""
        return Waiting()
