"""The faithful plant behind the interface: kernels of a run's state, which holds the flat state of `station.py`.

A vehicle's finish pressure is the nominal working pressure of its tank: it is full at the target state of charge for
it.
"""

from __future__ import annotations

import numpy as np

from station.compiled import merged, uncounted
from station.geometry import KELVIN, VALVES, VEHICLE
from station.plants.interface import COMPLETE, CUT_SHORT, GOES_ON, M, Number, P, Spent, T
from station.plants.real_gas import dispensing
from station.plants.real_gas import station as machines
from station.plants.real_gas.entries import (
    CHARGE,
    COLD,
    ENDED,
    ENERGIES,
    FILLED,
    FULL,
    HOTTEST,
    INSIDE,
    KILO,
    KWH,
    LONG_SINCE,
    NOZZLE,
    OPEN,
    POWERS,
    SHOWN,
    SINCE,
    START,
    TANK_VOLUME,
    UNACCOUNTED,
    WALL_SURFACE,
    RealGasConstants,
    connected_tank,
    connected_visit,
    make_vehicle,
)
from station.plants.real_gas.fill import BY_TEMPERATURE, NOT_ENDED
from station.plants.real_gas.gas import pressure_at
from station.plants.real_gas.hydrogen import BAR
from station.plants.real_gas.layout import BANKS, BLOCK, CONNECTED, DELIVERY, ELECTRIC, WORK, bank_at
from station.plants.real_gas.tank import ENERGY, MASS, SURFACE, fill_state, look

_NEAR = 40.0
"""A bank further below its greatest temperature is not warmed to it within a second [K]."""

_COOLED = 1.0
"""A bank no further above its surroundings cools no more by waiting [K]."""


@uncounted
def _begin(
    state: np.ndarray, tank: int, pressure: float, temperature: float, volume: float, finish_pressure: float,
    plant: RealGasConstants,
) -> None:  # fmt: skip
    inside, station = state[INSIDE:], plant.station
    if tank == VEHICLE:
        pascal, kelvin = pressure * BAR, temperature + KELVIN
        make_vehicle(state, pascal, kelvin, volume, finish_pressure * BAR, plant)
        machines.connect(inside, connected_tank(state), connected_visit(state), station, plant.gas)
        state[HOTTEST], state[ENDED] = temperature, NOT_ENDED
        derive(state, plant)
        return
    if inside[station.rest_at + BLOCK] == 0.0:
        machines.start(inside, station, plant.gas)
        state[SINCE : SINCE + len(VALVES)] = LONG_SINCE
    fill_state(
        inside, tank * station.stride, bank_at(tank, station), pressure * BAR, temperature + KELVIN,
        temperature + KELVIN, plant.gas,
    )  # fmt: skip
    state[P + tank], state[T + tank] = pressure, temperature
    state[M + tank] = inside[tank * station.stride + MASS] * KILO
    state[START], state[START + 1] = machines.accounts(inside, connected_tank(state), station)
    _tell(state, plant)


@merged
def begin(
    state: np.ndarray, tank: int, pressure: float, temperature: float, volume: float, finish_pressure: float,
    plant: RealGasConstants,
) -> None:  # fmt: skip
    """Let a tank hold gas; see `interface.begin`."""
    _begin(state, tank, pressure, temperature, volume, finish_pressure, plant)


@uncounted
def derive(state: np.ndarray, plant: RealGasConstants) -> None:
    """Write what others read of the state: pressures, temperatures, masses, and the columns of the record."""
    inside, station = state[INSIDE:], plant.station
    for place in range(BANKS):
        at = place * station.stride
        if machines.has_notes(inside, station):
            p, kelvin = machines.look_and_note(inside, place, station, plant.gas)
        else:
            p, kelvin = look(inside, at, bank_at(place, station), plant.gas)
        state[P + place], state[T + place] = p / BAR, kelvin - KELVIN
        state[M + place] = inside[at + MASS] * KILO
    if inside[station.rest_at + CONNECTED] > 0.0:
        p, kelvin = look(inside, station.vehicle_at, connected_tank(state), plant.gas)
        state[P + VEHICLE], state[T + VEHICLE] = p / BAR, kelvin - KELVIN
        state[M + VEHICLE] = inside[station.vehicle_at + MASS] * KILO
        state[FILLED] = inside[station.vehicle_at + MASS] / state[FULL]
        state[HOTTEST] = max(state[HOTTEST], kelvin - KELVIN)
    _tell(state, plant)


@uncounted
def _tell(state: np.ndarray, plant: RealGasConstants) -> None:
    """Write the levels of the record; of a future, which has none, the energies alone."""
    inside, station = state[INSIDE:], plant.station
    tail = inside[station.rest_at :]
    state[ENERGIES], state[ENERGIES + 1] = tail[WORK] / KWH, tail[ELECTRIC] / KWH
    if machines.has_notes(inside, station):
        return
    connected = tail[CONNECTED] > 0.0
    state[CHARGE] = state[FILLED] if connected else np.nan
    state[WALL_SURFACE] = inside[station.vehicle_at + SURFACE] - KELVIN if connected else np.nan
    state[NOZZLE], state[COLD] = tail[DELIVERY] - KELVIN, tail[BLOCK] - KELVIN
    mass, energy = machines.accounts(inside, connected_tank(state), station)
    state[UNACCOUNTED], state[UNACCOUNTED + 1] = (mass - state[START]) * KILO, energy - state[START + 1]


@uncounted
def _time_valves(state: np.ndarray, command: int, period: float) -> None:
    """Count for how long each valve has been as it is."""
    changed = int(state[OPEN]) ^ command
    for valve in range(len(VALVES)):
        state[SINCE + valve] = period if changed >> valve & 1 else state[SINCE + valve] + period
    state[OPEN] = command


@uncounted
def _advance(state: np.ndarray, command: int, period: float, plant: RealGasConstants) -> tuple[float, float]:
    """Apply a command; mass given by the compressors and to the vehicle [kg]."""
    inside, station = state[INSIDE:], plant.station
    _time_valves(state, command, period)
    tail = inside[station.rest_at :]
    work, electric = tail[WORK], tail[ELECTRIC]
    vehicle, visit = connected_tank(state), connected_visit(state)
    compressed, dispensed = machines.advance(inside, vehicle, visit, command, station, period, plant.gas)
    state[POWERS] = (tail[WORK] - work) / period / KILO
    state[POWERS + 1] = (tail[ELECTRIC] - electric) / period / KILO
    if tail[CONNECTED] > 0.0:
        state[ENDED] = machines.fill_ends(inside, vehicle, visit, station, period, plant.gas)
    derive(state, plant)
    return compressed, dispensed


@merged
def advance(
    state: np.ndarray,
    volume: float,  # the tank stands in the state
    command: int,
    period: float,
    plant: RealGasConstants,
) -> Spent:
    """Apply a command; see `interface.advance`."""
    compressed, dispensed = _advance(state, command, period, plant)
    return Spent(compressed * KILO / period, dispensed * KILO / period)


@merged
def rest(state: np.ndarray, period: float, plant: RealGasConstants) -> None:
    """Let time pass with every valve closed; see `interface.rest`."""
    _advance(state, 0, period, plant)


@merged
def fill_end(
    state: np.ndarray,
    finish_pressure: float,  # what ends the fill was found when it was advanced
    plant: RealGasConstants,
) -> int:
    """A limit of temperature cuts it short; see `interface.fill_end`."""
    if state[ENDED] < 0.0:
        return GOES_ON
    return CUT_SHORT if state[ENDED] == BY_TEMPERATURE else COMPLETE


@merged
def leaves_at(
    state: np.ndarray,
    finish_pressure: float,  # its mass stands in the state
    plant: RealGasConstants,
) -> float:
    """The pressure of the mass that ends the fill at the gas' temperature now; see `interface.leaves_at`."""
    return _leaves_at(state, plant)


@uncounted
def _leaves_at(state: np.ndarray, plant: RealGasConstants) -> float:
    at, volume, visit = INSIDE + plant.station.vehicle_at, state[TANK_VOLUME], connected_visit(state)
    if not plant.reports:
        return visit.pressure_max / BAR
    p = pressure_at(visit.mass / volume, state[T + VEHICLE] + KELVIN, state[at + ENERGY] / state[at + MASS], plant.gas)
    return min(p, visit.pressure_max) / BAR


@uncounted
def _leave(state: np.ndarray, plant: RealGasConstants) -> None:
    machines.disconnect(state[INSIDE:], connected_tank(state), plant.station, plant.gas)
    _tell(state, plant)


@merged
def leave(state: np.ndarray, plant: RealGasConstants) -> None:
    """Let the vehicle go and vent the line; see `interface.leave`."""
    _leave(state, plant)


@uncounted
def _lose(state: np.ndarray, buffer: int, mass: float, plant: RealGasConstants) -> None:
    machines.lose(state[INSIDE:], buffer, mass / KILO, plant.station, plant.gas)
    derive(state, plant)


@merged
def lose(state: np.ndarray, buffer: int, mass: float, plant: RealGasConstants) -> None:
    """Let gas leak out of a bank; see `interface.lose`."""
    _lose(state, buffer, mass, plant)


@uncounted
def _seep(state: np.ndarray, buffer: int, mass: float, plant: RealGasConstants) -> None:
    inside, vehicle, visit = state[INSIDE:], connected_tank(state), connected_visit(state)
    dispensing.seep(inside, buffer, mass / KILO, vehicle, visit, plant.station, plant.gas)
    derive(state, plant)


@merged
def seep(
    state: np.ndarray,
    buffer: int,
    mass: float,
    volume: float,  # the tank stands in the state
    plant: RealGasConstants,
) -> None:
    """Let gas flow through precooler and line into the vehicle; see `interface.seep`."""
    _seep(state, buffer, mass, plant)


def ailing(plant: RealGasConstants, compressor: float, dispenser: float, warmer: float) -> RealGasConstants:
    """Constants with less of the displacement, less area of the outlets, and a warmer precooler; see `Plant.ailing`."""
    station = plant.station
    unit, line, precooler = station.compressor, station.line, station.precooler
    return plant._replace(
        station=station._replace(
            compressor=unit._replace(displacement=unit.displacement * compressor),
            line=line._replace(area=line.area * dispenser),
            precooler=precooler._replace(warmer=precooler.warmer + warmer),
        )
    )


@merged
def own_columns(plant: RealGasConstants) -> tuple[int, int, int]:
    """Entries that a record shows; see `interface.own_columns`."""
    return SHOWN


@merged
def emptied_to(buffer: int, plant: RealGasConstants) -> Number:
    """The least pressure of a bank; see `interface.emptied_to`."""
    return plant.bank_pressure_min[buffer]


@merged
def timed_valves(state: np.ndarray, plant: RealGasConstants) -> tuple[int, int]:
    """Those within their minimum times; see `interface.timed_valves`."""
    now, opened, closed = int(state[OPEN]), 0, 0
    for valve in range(len(VALVES)):
        if now >> valve & 1:
            opened |= (state[SINCE + valve] < plant.minimum_on) << valve
        else:
            closed |= (state[SINCE + valve] < plant.minimum_off) << valve
    return opened, closed


@merged
def reads_nozzle(plant: RealGasConstants) -> bool:
    """It does; see `interface.reads_nozzle`."""
    return True


@merged
def metered(state: np.ndarray, plant: RealGasConstants) -> float:
    """Of compressors and precooler; see `interface.metered`."""
    return float(state[ENERGIES] + state[ENERGIES + 1])


@merged
def outlet_flow(pressure: Number, vehicle_pressure: Number, plant: RealGasConstants) -> Number:
    """Flow as the controllers' model has it, since nothing limits it; see `interface.outlet_flow`."""
    return plant.outlet_coefficient * (pressure - vehicle_pressure)


@merged
def warmed(buffer: int, pressure: float, temperature: float, plant: RealGasConstants, period: float) -> float:
    """With a wall that takes no heat, where it is near the limit at all; see `interface.warmed`.

    A small bank that is nearly empty passes the limit in its first second from wherever it begins: once it is as cool
    as its surroundings it is filled, or it never would be.
    """
    cooled = temperature <= plant.station.ambient - KELVIN + _COOLED
    if temperature < plant.limits.buffer_temperature_max - _NEAR or cooled:
        return temperature
    kelvin = machines.filled_kelvin(buffer, pressure * BAR, temperature + KELVIN, plant.station, period, plant.gas)
    return kelvin - KELVIN


@merged
def vehicle_temperature(
    temperature: Number,
    outlets: Number,
    plant: RealGasConstants,
    period: float,
) -> Number:
    """The plant itself ends a fill a second before its limit is passed; see `interface.vehicle_temperature`."""
    return temperature


@merged
def filled_to(buffer: int, plant: RealGasConstants) -> Number:
    """The greatest pressure of a bank; see `interface.filled_to`."""
    return plant.bank_pressure_max[buffer]
