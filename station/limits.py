"""Which valve commands a station admits, Eqs (7.11)-(7.19), the name of the limit that forbids one, the shield.

Every limit on a state is a margin: the valve may open while the margin is not negative. Margins take numbers
or symbols, so that the solver models state the same limits.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

from station.compiled import formula, inlined
from station.geometry import ALL_VALVES, INLETS, OUTLETS, VEHICLE
from station.plants.thesis import Number, PlantConstants, buffer_temperature, outlet_flow, vehicle_temperature


class Limit(IntEnum):
    """What forbids a valve to open."""

    NONE = 0
    FLOW = 1  # Eq. (7.11): the dispenser's flow limit
    GAP = 2  # Eq. (7.12): too little pressure above the vehicle
    VEHICLE_TEMPERATURE = 3  # Eq. (7.13)
    NO_VEHICLE = 4  # Eq. (7.14)
    BUFFER_TEMPERATURE = 5  # Eq. (7.15)
    HOLD = 6  # Eq. (7.16): above 800 bar a closed inlet stays closed
    BOTH_SIDES = 7  # Eq. (7.17): inlet and outlet of one buffer
    COMPRESSORS = 8  # Eq. (7.18): more inlets than compressors
    DISPENSER = 9  # Eq. (7.19): more than one outlet
    COMPRESSOR_PRESSURE = 10  # the buffer is not below the compressor's pressure


# Numba reads plain integers faster than members, so each code stands here once more by value.
_FLOW, _GAP, _VEHICLE_TEMPERATURE = int(Limit.FLOW), int(Limit.GAP), int(Limit.VEHICLE_TEMPERATURE)
_NO_VEHICLE, _BUFFER_TEMPERATURE = int(Limit.NO_VEHICLE), int(Limit.BUFFER_TEMPERATURE)
_HOLD, _BOTH_SIDES, _COMPRESSORS = int(Limit.HOLD), int(Limit.BOTH_SIDES), int(Limit.COMPRESSORS)
_DISPENSER, _COMPRESSOR_PRESSURE = int(Limit.DISPENSER), int(Limit.COMPRESSOR_PRESSURE)


@formula
def flow_margin(pressure: Number, vehicle_pressure: Number, plant: PlantConstants) -> Number:
    """Eq. (7.11) [g/s]."""
    return plant.dispenser_flow_max - outlet_flow(pressure, vehicle_pressure, plant)


@formula
def gap_margin(pressure: Number, vehicle_pressure: Number, plant: PlantConstants) -> Number:
    """Eq. (7.12) [bar]."""
    return pressure - vehicle_pressure - plant.outlet_gap_min


@formula
def start_limit(plant: PlantConstants) -> float:
    """Pressure of a buffer from which even an empty vehicle can just be given gas, Eq. (7.11) [bar]."""
    return plant.dispenser_flow_max / plant.outlet_coefficient


START_SHARE = 0.95
"""Low is not filled beyond this share of `start_limit`, so that a fill can begin whatever a vehicle holds: once as warm
as its surroundings a cold low has risen by less than the rest."""


@formula
def vehicle_temperature_margin(temperature: Number, plant: PlantConstants, period: float) -> Number:
    """Eq. (7.13) [K], of the vehicle after `period` seconds of filling."""
    return plant.vehicle_temperature_max - vehicle_temperature(temperature, 1, plant, period)


@formula
def buffer_temperature_margin(buffer: int, temperature: Number, plant: PlantConstants, period: float) -> Number:
    """Eq. (7.15) [K], of a buffer after `period` seconds of filling."""
    return plant.buffer_temperature_max - buffer_temperature(buffer, temperature, 1, 0, plant, period)


@formula
def compressor_margin(pressure: Number, plant: PlantConstants) -> Number:
    """How far a buffer lies below the compressor's pressure [bar]; must be positive."""
    return plant.compressor_pressure - pressure


@formula
def hold_margin(pressure: Number, plant: PlantConstants) -> Number:
    """Eq. (7.16) for an inlet that was closed [bar]."""
    return plant.hold_pressure - pressure


@inlined
def inlet_limit(
    buffer: int,
    pressure: float,
    temperature: float,
    was_open: bool,
    obeys_hold: bool,
    plant: PlantConstants,
    period: float,
) -> int:
    """The limit on a state that forbids this inlet to open, or 0."""
    if not compressor_margin(pressure, plant) > 0.0:
        return _COMPRESSOR_PRESSURE
    if obeys_hold and not was_open and not hold_margin(pressure, plant) >= 0.0:
        return _HOLD
    if not buffer_temperature_margin(buffer, temperature, plant, period) >= 0.0:
        return _BUFFER_TEMPERATURE
    return 0


@inlined
def outlet_limit(
    pressure: float,
    vehicle_connected: bool,
    vehicle_pressure: float,
    vehicle_temperature: float,
    plant: PlantConstants,
    period: float,
) -> int:
    """The limit on a state that forbids an outlet at this buffer pressure to open, or 0."""
    if not vehicle_connected:
        return _NO_VEHICLE
    if not gap_margin(pressure, vehicle_pressure, plant) >= 0.0:
        return _GAP
    if not flow_margin(pressure, vehicle_pressure, plant) >= 0.0:
        return _FLOW
    if not vehicle_temperature_margin(vehicle_temperature, plant, period) >= 0.0:
        return _VEHICLE_TEMPERATURE
    return 0


@inlined
def admitted_valves(
    pressure: tuple[float, float, float, float],
    temperature: tuple[float, float, float, float],
    vehicle_connected: bool,
    previous: int,
    plant: PlantConstants,
    period: float,
) -> int:
    """The valves that no limit on the state forbids a controller bound by Eq. (7.16), as bits of Valve."""
    found = 0
    for buffer in range(3):
        was_open = previous >> buffer & 1 != 0
        if inlet_limit(buffer, pressure[buffer], temperature[buffer], was_open, True, plant, period) == 0:
            found |= 1 << buffer
        if (
            outlet_limit(pressure[buffer], vehicle_connected, pressure[VEHICLE], temperature[VEHICLE], plant, period)
            == 0
        ):
            found |= 8 << buffer
    return found


def commands(compressor_count: int) -> list[int]:
    """All commands that Eqs (7.17)-(7.19) admit: 13 with one compressor, 19 with two, 20 from three on."""
    found = []
    for command in range(ALL_VALVES + 1):
        inlets, outlets = command & INLETS, command >> 3
        if inlets & outlets or inlets.bit_count() > compressor_count or outlets.bit_count() > 1:
            continue
        found.append(command)
    return found


class ValveLimits(NamedTuple):
    """What the limits say of one second: the limit that forbids each valve, or 0."""

    inlet: tuple[int, int, int]
    outlet: tuple[int, int, int]


@inlined
def count_inlets(command: int) -> int:
    """Number of open inlets, which is the number of compressors at work."""
    return (command & 1) + (command >> 1 & 1) + (command >> 2 & 1)


@inlined
def _outlet_beside(kept: int, buffer: int, limit: int) -> int:
    """The limit that forbids an outlet beside the valves in `kept`, or 0."""
    if limit == 0 and kept & (1 << buffer):
        return _BOTH_SIDES
    if limit == 0 and kept & OUTLETS:
        return _DISPENSER
    return limit


@inlined
def _inlet_beside(kept: int, buffer: int, limit: int, compressor_count: int) -> int:
    """The limit that forbids an inlet beside the valves in `kept`, or 0."""
    if limit == 0 and kept & (8 << buffer):
        return _BOTH_SIDES
    if limit == 0 and count_inlets(kept) >= compressor_count:
        return _COMPRESSORS
    return limit


@inlined
def shield(command: int, kept: int, admission: ValveLimits, compressor_count: int) -> tuple[int, int]:
    """The shield: `kept` and what of a command may open beside it, and the limits of the valves refused.

    The limit of valve v stands in bits 4 v to 4 v + 3 of the second number; see `refusal`. Outlets come before
    inlets and high before medium before low, so that of two valves that exclude each other the same one stays.
    """
    refusals = 0
    for buffer in range(3):
        bit = 8 << buffer
        if command & bit and not kept & bit:
            limit = _outlet_beside(kept, buffer, admission.outlet[buffer])
            kept |= bit if limit == 0 else 0
            refusals |= limit << (4 * (3 + buffer))
    for buffer in range(3):
        bit = 1 << buffer
        if command & bit and not kept & bit:
            limit = _inlet_beside(kept, buffer, admission.inlet[buffer], compressor_count)
            kept |= bit if limit == 0 else 0
            refusals |= limit << (4 * buffer)
    return kept, refusals


@inlined
def refused_limit(refusals: int, valve: int) -> int:
    """The limit that refused a valve, or 0, from what `admissible_part` gives."""
    return refusals >> (4 * valve) & 15


@inlined
def limits_at(
    pressure: tuple[float, float, float, float],
    temperature: tuple[float, float, float, float],
    vehicle_connected: bool,
    previous: int,
    obeys_hold: bool,
    plant: PlantConstants,
    period: float,
) -> ValveLimits:
    """The limit on each valve at these pressures [bar] and temperatures [deg C]."""
    return ValveLimits(
        (
            inlet_limit(0, pressure[0], temperature[0], previous & 1 != 0, obeys_hold, plant, period),
            inlet_limit(1, pressure[1], temperature[1], previous & 2 != 0, obeys_hold, plant, period),
            inlet_limit(2, pressure[2], temperature[2], previous & 4 != 0, obeys_hold, plant, period),
        ),
        (
            outlet_limit(pressure[0], vehicle_connected, pressure[VEHICLE], temperature[VEHICLE], plant, period),
            outlet_limit(pressure[1], vehicle_connected, pressure[VEHICLE], temperature[VEHICLE], plant, period),
            outlet_limit(pressure[2], vehicle_connected, pressure[VEHICLE], temperature[VEHICLE], plant, period),
        ),
    )
