"""The faithful plant behind the interface: a run's state holds that of `station.py`, and what is derived from it.

Its own entries of the state are what its record shows, the connected vehicle's visit and tank, and the flat state of
`station.py` behind them. A vehicle's finish pressure is the nominal working pressure of its tank: it is full at the
target state of charge for it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from station.compiled import merged, uncounted
from station.geometry import VEHICLE
from station.plants.interface import OWN, M, Number, P, Spent, T
from station.plants.real_gas import station as machines
from station.plants.real_gas.catalog import REFERENCE, TankClass, build_tank
from station.plants.real_gas.fill import NOT_ENDED
from station.plants.real_gas.gas import density_and_enthalpy, pressure_at
from station.plants.real_gas.hydrogen import KELVIN
from station.plants.real_gas.layout import (
    BANKS,
    BLOCK,
    CONNECTED,
    DELIVERY,
    ELECTRIC,
    TAIL,
    WORK,
    RealGasStation,
    bank_at,
)
from station.plants.real_gas.tables import GasTables
from station.plants.real_gas.tank import CELLS, ENERGY, MASS, SURFACE, Tank, fill_state, look
from station.plants.real_gas.vehicles import Visit
from station.plants.real_gas.wall import CELLS_PER_LAYER, Wall

PERIOD = 1.0
"""Of the steps that tanks are made for, that of a run [s]."""

VEHICLE_CELLS = 2 * CELLS_PER_LAYER
"""Of the wall of a vehicle's tank, at most: liner and shell."""

RATES = {"power_compressor": "kW", "power_precooler": "kW"}
"""Columns of the record that hold until the next row."""

LEVELS = {
    "energy_compressor": "kWh",
    "energy_precooler": "kWh",
    "state_of_charge_vehicle": "1",
    "temperature_wall_vehicle": "degC",
    "temperature_delivery": "degC",
    "temperature_precooler": "degC",
    "mass_unaccounted": "g",
    "energy_unaccounted": "J",
}
"""Columns that hold at the time of a row: electric energies since the start, inner surface of the vehicle's tank, gas at
the nozzle, the precooler's block, and what is left of the balances of mass and energy since the start."""

FIGURES = {"state_of_charge": "1", "temperature_max": "degC", "ended_by": "code"}
"""Columns of the table of vehicles: the hottest that the gas was; `ended_by` is a `station.plants.real_gas.fill.End`, or
-1 where nothing has ended the fill."""

_POWERS = OWN
_ENERGIES, _CHARGE, _SURFACE, _NOZZLE, _COLD, _LEFT = (
    OWN + len(RATES) + list(LEVELS).index(name)
    for name in (
        "energy_compressor", "state_of_charge_vehicle", "temperature_wall_vehicle", "temperature_delivery",
        "temperature_precooler", "mass_unaccounted",
    )
)  # fmt: skip
_FIGURES = OWN + len(RATES) + len(LEVELS)
_HOTTEST, _END = _FIGURES + 1, _FIGURES + 2
_START = _FIGURES + len(FIGURES)  # the accounts at the start
_VISIT = _START + 2
_FULL = _VISIT + len(Visit._fields)  # mass at a state of charge of 100 % [kg]
_TANK = _FULL + 1  # volume, forced, free, first, skin, area, cells of the vehicle's tank
_WALL = _TANK + 7  # five arrays of its wall
_INSIDE = _WALL + 5 * VEHICLE_CELLS

OWN_ENTRIES = _INSIDE + BANKS * (CELLS + 1) + CELLS + VEHICLE_CELLS + TAIL - OWN
"""Entries of a run's state that are this plant's own; banks have a wall of one cell."""

_SHOWN = (len(RATES), len(LEVELS), len(FIGURES))
_KILO = 1e3
_KWH = 3.6e6
_BAR = 1e5


class RealGasConstants(NamedTuple):
    """The numbers of one station that its equations and limits use."""

    compressor_pressure: float  # where the compressor stops [bar]
    outlet_coefficient: float  # of the model that controllers have [g/(s bar)]
    buffer_temperature_max: float  # [deg C]
    vehicle_temperature_max: float  # [deg C]
    dispenser_flow_max: float  # infinite: the nozzle's limit saturates the flow [g/s]
    outlet_gap_min: float  # [bar]
    hold_pressure: float  # infinite: a closed inlet may open at any pressure [bar]
    compressor_count: int
    bank_pressure_max: tuple[float, float, float]  # up to which banks are filled [bar]
    target: float  # state of charge that ends a fill
    pressure_factor: float  # the highest pressure of a fill over the nominal working pressure
    ramp: float  # [Pa/s]
    parting: float  # tanks are of the first class up to this nominal working pressure [Pa]
    lighter: TankClass
    stronger: TankClass
    station: RealGasStation
    gas: GasTables


@uncounted
def _vehicle(state: np.ndarray) -> Tank:
    """The tank of the connected vehicle; only uncounted kernels may call it, as `bank_at`."""
    cells, each = int(state[_TANK + 6]), _WALL
    wall = Wall(
        state[each : each + cells], state[each + VEHICLE_CELLS : each + VEHICLE_CELLS + cells],
        state[each + 2 * VEHICLE_CELLS : each + 2 * VEHICLE_CELLS + cells], state[each + 3 * VEHICLE_CELLS : each + 3 * VEHICLE_CELLS + cells],
        state[each + 4 * VEHICLE_CELLS : each + 4 * VEHICLE_CELLS + cells], state[_TANK + 3], state[_TANK + 4], state[_TANK + 5],
    )  # fmt: skip
    return Tank(state[_TANK], state[_TANK + 1], state[_TANK + 2], -1.0, wall)


@uncounted
def _visit(state: np.ndarray) -> Visit:
    """The visit of the connected vehicle."""
    return Visit(
        state[_VISIT], state[_VISIT + 1], state[_VISIT + 2], state[_VISIT + 3], state[_VISIT + 4], state[_VISIT + 5]
    )  # fmt: skip


@uncounted
def _make_vehicle(
    state: np.ndarray, pressure: float, kelvin: float, volume: float, nominal: float, plant: RealGasConstants
) -> None:
    """Write the tank of a vehicle of a volume [m3] and nominal working pressure [Pa], and its visit, into the state."""
    kind = plant.lighter if nominal <= plant.parting else plant.stronger
    each = _WALL
    forced, free, first, skin, area = build_tank(
        kind, volume, nominal, PERIOD, state[each : each + VEHICLE_CELLS], state[each + VEHICLE_CELLS : each + 2 * VEHICLE_CELLS],
        state[each + 2 * VEHICLE_CELLS : each + 3 * VEHICLE_CELLS], state[each + 3 * VEHICLE_CELLS : each + 4 * VEHICLE_CELLS],
        state[each + 4 * VEHICLE_CELLS : each + 5 * VEHICLE_CELLS],
    )  # fmt: skip
    state[_TANK], state[_TANK + 1], state[_TANK + 2] = volume, forced, free
    state[_TANK + 3], state[_TANK + 4], state[_TANK + 5] = first, skin, area
    state[_TANK + 6] = kind.layers.shape[0] * CELLS_PER_LAYER
    state[_FULL] = volume * density_and_enthalpy(nominal, REFERENCE, plant.gas)[0]
    state[_VISIT], state[_VISIT + 1], state[_VISIT + 2] = pressure, kelvin, plant.ramp
    state[_VISIT + 3] = plant.target * state[_FULL]
    state[_VISIT + 4] = plant.pressure_factor * nominal
    state[_VISIT + 5] = plant.vehicle_temperature_max + KELVIN


@uncounted
def _begin(
    state: np.ndarray, tank: int, pressure: float, temperature: float, volume: float, finish_pressure: float,
    plant: RealGasConstants,
) -> None:  # fmt: skip
    inside, station = state[_INSIDE:], plant.station
    if tank == VEHICLE:
        pascal, kelvin = pressure * _BAR, temperature + KELVIN
        _make_vehicle(state, pascal, kelvin, volume, finish_pressure * _BAR, plant)
        machines.connect(inside, _vehicle(state), _visit(state), station, plant.gas)
        state[_HOTTEST], state[_END] = temperature, NOT_ENDED
        _derive(state, plant)
        return
    if inside[station.rest_at + BLOCK] == 0.0:
        machines.start(inside, station, plant.gas)
    fill_state(
        inside, tank * station.stride, bank_at(tank, station), pressure * _BAR, temperature + KELVIN,
        temperature + KELVIN, plant.gas,
    )  # fmt: skip
    state[P + tank], state[T + tank] = pressure, temperature
    state[M + tank] = inside[tank * station.stride + MASS] * _KILO
    state[_START], state[_START + 1] = machines.accounts(inside, _vehicle(state), station)
    _tell(state, plant)


@merged
def begin(
    state: np.ndarray, tank: int, pressure: float, temperature: float, volume: float, finish_pressure: float,
    plant: RealGasConstants,
) -> None:  # fmt: skip
    """Let a tank hold gas; see `interface.begin`."""
    _begin(state, tank, pressure, temperature, volume, finish_pressure, plant)


@uncounted
def _derive(state: np.ndarray, plant: RealGasConstants) -> None:
    """Write what others read of the state: pressures, temperatures, masses, and the columns of the record."""
    inside, station = state[_INSIDE:], plant.station
    for place in range(BANKS):
        at = place * station.stride
        p, kelvin = look(inside, at, bank_at(place, station), plant.gas)
        state[P + place], state[T + place] = p / _BAR, kelvin - KELVIN
        state[M + place] = inside[at + MASS] * _KILO
    if inside[station.rest_at + CONNECTED] > 0.0:
        p, kelvin = look(inside, station.vehicle_at, _vehicle(state), plant.gas)
        state[P + VEHICLE], state[T + VEHICLE] = p / _BAR, kelvin - KELVIN
        state[M + VEHICLE] = inside[station.vehicle_at + MASS] * _KILO
        state[_FIGURES] = inside[station.vehicle_at + MASS] / state[_FULL]
        state[_HOTTEST] = max(state[_HOTTEST], kelvin - KELVIN)
    _tell(state, plant)


@uncounted
def _tell(state: np.ndarray, plant: RealGasConstants) -> None:
    """Write the levels of the record."""
    inside, station = state[_INSIDE:], plant.station
    tail = inside[station.rest_at :]
    state[_ENERGIES], state[_ENERGIES + 1] = tail[WORK] / _KWH, tail[ELECTRIC] / _KWH
    connected = tail[CONNECTED] > 0.0
    state[_CHARGE] = state[_FIGURES] if connected else np.nan
    state[_SURFACE] = inside[station.vehicle_at + SURFACE] - KELVIN if connected else np.nan
    state[_NOZZLE], state[_COLD] = tail[DELIVERY] - KELVIN, tail[BLOCK] - KELVIN
    mass, energy = machines.accounts(inside, _vehicle(state), station)
    state[_LEFT], state[_LEFT + 1] = (mass - state[_START]) * _KILO, energy - state[_START + 1]


@uncounted
def _advance(state: np.ndarray, command: int, period: float, plant: RealGasConstants) -> tuple[float, float]:
    """Apply a command; mass given by the compressors and to the vehicle [kg]."""
    inside, station = state[_INSIDE:], plant.station
    tail = inside[station.rest_at :]
    work, electric = tail[WORK], tail[ELECTRIC]
    vehicle, visit = _vehicle(state), _visit(state)
    compressed, dispensed = machines.advance_with(inside, vehicle, visit, command, station, period, plant.gas)
    state[_POWERS] = (tail[WORK] - work) / period / _KILO
    state[_POWERS + 1] = (tail[ELECTRIC] - electric) / period / _KILO
    if tail[CONNECTED] > 0.0:
        state[_END] = machines.end_of(inside, vehicle, visit, station, plant.gas)
    _derive(state, plant)
    return compressed, dispensed


@merged
def advance(
    state: np.ndarray,
    volume: float,  # noqa: ARG001  # the tank stands in the state
    command: int,
    period: float,
    plant: RealGasConstants,
) -> Spent:
    """Apply a command; see `interface.advance`."""
    compressed, dispensed = _advance(state, command, period, plant)
    return Spent(compressed * _KILO / period, dispensed * _KILO / period)


@merged
def rest(state: np.ndarray, period: float, plant: RealGasConstants) -> None:
    """Let time pass with every valve closed; see `interface.rest`."""
    _advance(state, 0, period, plant)


@merged
def is_full(
    state: np.ndarray,
    finish_pressure: float,  # noqa: ARG001  # what ends the fill was found when it was advanced
    plant: RealGasConstants,  # noqa: ARG001  # every plant's kernels have the same arguments
) -> bool:
    """Whether something has ended the fill; see `interface.is_full`."""
    return bool(state[_END] >= 0.0)


@merged
def leaves_at(
    state: np.ndarray,
    finish_pressure: float,  # noqa: ARG001  # its mass stands in the state
    plant: RealGasConstants,
) -> float:
    """The pressure of the mass that ends the fill at the gas' temperature now; see `interface.leaves_at`."""
    return _leaves_at(state, plant)


@uncounted
def _leaves_at(state: np.ndarray, plant: RealGasConstants) -> float:
    at, volume, visit = _INSIDE + plant.station.vehicle_at, state[_TANK], _visit(state)
    p = pressure_at(visit.mass / volume, state[T + VEHICLE] + KELVIN, state[at + ENERGY] / state[at + MASS], plant.gas)
    return min(p, visit.pressure_max) / _BAR


@uncounted
def _leave(state: np.ndarray, plant: RealGasConstants) -> None:
    machines.disconnect(state[_INSIDE:], _vehicle(state), plant.station, plant.gas)
    _tell(state, plant)


@merged
def leave(state: np.ndarray, plant: RealGasConstants) -> None:
    """Let the vehicle go and vent the line; see `interface.leave`."""
    _leave(state, plant)


@merged
def own_columns(plant: RealGasConstants) -> tuple[int, int, int]:  # noqa: ARG001  # as every plant's
    """Entries that a record shows; see `interface.own_columns`."""
    return _SHOWN


@merged
def outlet_flow(pressure: Number, vehicle_pressure: Number, plant: RealGasConstants) -> Number:
    """Flow as the controllers' model has it, since nothing limits it; see `interface.outlet_flow`."""
    return plant.outlet_coefficient * (pressure - vehicle_pressure)


@merged
def buffer_temperature(
    buffer: int,  # noqa: ARG001  # as every plant's
    temperature: Number,
    inlet: Number,  # noqa: ARG001
    outlet: Number,  # noqa: ARG001
    plant: RealGasConstants,  # noqa: ARG001
    period: float,  # noqa: ARG001
) -> Number:
    """A second changes it by less than a sensor tells; see `interface.buffer_temperature`."""
    return temperature


@merged
def vehicle_temperature(
    temperature: Number,
    outlets: Number,  # noqa: ARG001  # as every plant's
    plant: RealGasConstants,  # noqa: ARG001
    period: float,  # noqa: ARG001
) -> Number:
    """The plant itself ends a fill a second before its limit is passed; see `interface.vehicle_temperature`."""
    return temperature


@merged
def filled_to(buffer: int, plant: RealGasConstants) -> Number:
    """The greatest pressure of a bank; see `interface.filled_to`."""
    return plant.bank_pressure_max[buffer]
