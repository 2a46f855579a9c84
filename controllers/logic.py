"""The rule-based controller of chapter 7: dispensing rules, refill orders and hysteresis, thresholds in data."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from controllers.base import CompiledBase, Settings
from controllers.estimate import ESTIMATE_SIZE, estimate_vehicle, use_station_prediction
from station.compiled import callback, uncounted
from station.controller import DECIDE, CompiledController, Decision, Observation
from station.geometry import ALL_VALVES, INLETS
from station.planning import Model
from station.quantities import Part, Pressure
from station.valves import barred_valves, inlet_limit, outlet_limit

_DISPENSE = ("largest_gap", "cascade", "lowest_label")
_REFILL = ("low_first", "lowest_pressure")
_LARGEST_GAP, _CASCADE, _LOWEST_LABEL = range(3)
_LOW_FIRST, _LOWEST_PRESSURE = range(2)

# Entries of the settings and of the memory behind the estimate.
_DISPENSE_RULE, _REFILL_ORDER, _HYSTERESIS, _CASCADE_GAP, _STOP = 0, 1, 2, 3, 4
_NEEDY, _CASCADE_VEHICLE, _CASCADE_STAGE = ESTIMATE_SIZE, ESTIMATE_SIZE + 3, ESTIMATE_SIZE + 4
_MEMORY_SIZE = ESTIMATE_SIZE + 5


class StopPressures(Part):
    """Pressures at which the compressor stops filling each buffer."""

    high: Pressure
    medium: Pressure
    low: Pressure


class LogicSettings(Settings):
    """Rules and thresholds of the logic controller; a station's preset gives them."""

    dispense: Annotated[
        Literal["largest_gap", "cascade", "lowest_label"],
        Field(
            description="largest_gap: the buffer furthest above the vehicle, after the assumption of Sec. 7.2 that "
            "logic keeps hydrogen available. cascade: low, medium, high without going back within a vehicle; the "
            "next buffer's turn comes when the gap falls to a threshold, as in the literature on cascade storage "
            "(Bai et al. 2021, doi:10.1016/j.est.2021.102306). "
            "lowest_label: the cascade, begun anew each second"
        ),
    ]
    refill: Annotated[
        Literal["low_first", "lowest_pressure"],
        Field(
            description="Which needy buffer the compressor fills: low before medium before high, or the one at the "
            "lowest pressure; both orders are readings that fit the printed tables"
        ),
    ]
    hysteresis_bar: Annotated[
        float,
        Field(ge=0, le=2000, allow_inf_nan=False, description="A buffer is needy this far below its stop pressure"),
    ]
    cascade_gap_bar: Annotated[
        float,
        Field(
            ge=0, le=2000, allow_inf_nan=False, description="Gap the cascade asks of low and medium before it moves on"
        ),
    ]
    stop_pressure_bar: StopPressures


@uncounted
def _largest_gap(allowed: int, observation: Observation) -> int:
    best, found = 0.0, -1
    for buffer in range(3):
        if allowed & (8 << buffer) and (found < 0 or observation.pressure[buffer] > best):
            best, found = observation.pressure[buffer], buffer
    return found


@uncounted
def _cascade(
    allowed: int, vehicle_pressure: float, observation: Observation, gap: float, anew: bool, memory: np.ndarray
) -> int:
    """Low, medium, high; a buffer once left stays left until the next vehicle, or (anew) only for the second."""
    if anew or memory[_CASCADE_VEHICLE] != observation.vehicle + 1:
        memory[_CASCADE_VEHICLE] = observation.vehicle + 1
        memory[_CASCADE_STAGE] = 2
    while memory[_CASCADE_STAGE] > 0:
        buffer = int(memory[_CASCADE_STAGE])
        if observation.pressure[buffer] - vehicle_pressure >= gap and allowed & (8 << buffer):
            return buffer
        memory[_CASCADE_STAGE] -= 1
    return 0 if allowed & 8 else _largest_gap(allowed, observation)


@uncounted
def _outlet(observation: Observation, model: Model, settings: np.ndarray, memory: np.ndarray) -> int:
    """The buffer to dispense from, or -1."""
    if observation.vehicle < 0:
        return -1
    vehicle_pressure, vehicle_temperature = estimate_vehicle(observation, model, memory)
    allowed = 0
    for buffer in range(3):
        if (
            outlet_limit(
                buffer,
                observation.pressure[buffer],
                observation.temperature[buffer],
                True,
                vehicle_pressure,
                vehicle_temperature,
                model,
                observation.period,
            )
            == 0
        ):
            allowed |= 8 << buffer
    allowed &= ~barred_valves(observation.timed, allowed | INLETS, model.compressor_count)
    if allowed == 0:
        return -1
    rule = settings[_DISPENSE_RULE]
    if rule == _LARGEST_GAP:
        return _largest_gap(allowed, observation)
    anew = rule == _LOWEST_LABEL
    return _cascade(allowed, vehicle_pressure, observation, settings[_CASCADE_GAP], anew, memory)


@uncounted
def _inlets(outlet: int, observation: Observation, model: Model, settings: np.ndarray, memory: np.ndarray) -> int:
    """Inlets of the needy buffers to fill, as bits, as many as there are compressors."""
    for buffer in range(3):
        stop = settings[_STOP + buffer]
        if observation.pressure[buffer] < stop - settings[_HYSTERESIS]:
            memory[_NEEDY + buffer] = 1.0
        elif observation.pressure[buffer] >= stop:
            memory[_NEEDY + buffer] = 0.0
    barred = barred_valves(observation.timed, ALL_VALVES, model.compressor_count)
    command = 0
    for _ in range(min(3, model.compressor_count)):
        found = -1
        for buffer in range(2, -1, -1):
            if memory[_NEEDY + buffer] == 0.0 or buffer == outlet or (command | barred) & (1 << buffer):
                continue
            if (
                inlet_limit(
                    buffer,
                    observation.pressure[buffer],
                    observation.temperature[buffer],
                    True,
                    False,
                    model,
                    observation.period,
                )
                != 0
            ):
                continue
            if found < 0 or (
                settings[_REFILL_ORDER] == _LOWEST_PRESSURE
                and observation.pressure[buffer] < observation.pressure[found]
            ):
                found = buffer
        if found < 0:
            break
        command |= 1 << found
    return command & INLETS


@callback(DECIDE, counted=False)
def _decide(observation: Observation, model: Model, settings: np.ndarray, memory: np.ndarray) -> Decision:
    outlet = _outlet(observation, model, settings, memory)
    command = _inlets(outlet, observation, model, settings, memory)
    if outlet >= 0:
        command |= 8 << outlet
    return Decision(command, 0, np.nan, np.nan)


class Logic(CompiledBase):
    """Opens one outlet by a dispensing rule and refills needy buffers in a fixed order; exempt from Eq. (7.16)."""

    name = "logic"
    about = "rules: cascade, largest-gap or lowest-label dispensing, refill with hysteresis"
    obeys_hold = False
    settings_type = LogicSettings
    settings_key = "logic"

    @property
    def wake_pressure(self) -> tuple[float, float, float]:
        """Below these pressures buffers become needy [bar]."""
        settings: LogicSettings = self.settings_for(self.station)
        stop, width = settings.stop_pressure_bar, settings.hysteresis_bar
        return stop.high - width, stop.medium - width, stop.low - width

    def compiled(self) -> CompiledController:
        """This controller for the compiled loop, fresh."""
        settings: LogicSettings = self.settings_for(self.station)
        stop = settings.stop_pressure_bar
        vector = np.array(
            [
                _DISPENSE.index(settings.dispense),
                _REFILL.index(settings.refill),
                settings.hysteresis_bar,
                settings.cascade_gap_bar,
                stop.high,
                stop.medium,
                stop.low,
            ],
            dtype=np.float64,
        )
        memory = use_station_prediction(self.station, np.zeros(_MEMORY_SIZE))
        return CompiledController(
            _decide, self.station.control_constants(), vector, memory, self.obeys_hold, self.wake_pressure
        )
