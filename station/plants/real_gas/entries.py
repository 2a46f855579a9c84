"""Places of everything of the faithful plant in a run's state, its constants, and the vehicle connected.

Its own entries are what its record shows, the connected vehicle's visit and tank, and the flat state of `station.py`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from station.compiled import uncounted
from station.geometry import KELVIN, VALVES
from station.limit_figures import LimitFigures
from station.plants.interface import OWN
from station.plants.real_gas.catalog import REFERENCE, TankClass, build_tank
from station.plants.real_gas.fill import PERIOD
from station.plants.real_gas.gas import density_and_enthalpy
from station.plants.real_gas.layout import BANKS, TAIL, RealGasStation, Visit
from station.plants.real_gas.leachman import Array
from station.plants.real_gas.ramp_table import PER_MINUTE, RampTable, ramp_of
from station.plants.real_gas.tables import FORCED_EXPONENT, GasTables
from station.plants.real_gas.tank import CELLS, Tank
from station.plants.real_gas.wall import CELLS_PER_LAYER, Wall

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
"""Columns that hold at the time of a row: electric energies since the start, inner surface of the vehicle's tank, gas
at the nozzle, the precooler's block, and what is left of the balances of mass and energy since the start."""

FIGURES = {"state_of_charge": "1", "temperature_max": "degC", "ended_by": "code", "ramp": "MPa/min"}
"""Columns of the table of vehicles: the hottest that the gas was; what ended the fill, a `fill.End`, or -1 where
nothing has; the ramp of the pressure."""

POWERS = OWN
ENERGIES, CHARGE, WALL_SURFACE, NOZZLE, COLD, UNACCOUNTED = (
    OWN + len(RATES) + list(LEVELS).index(name)
    for name in (
        "energy_compressor", "state_of_charge_vehicle", "temperature_wall_vehicle", "temperature_delivery",
        "temperature_precooler", "mass_unaccounted",
    )
)  # fmt: skip
FILLED = OWN + len(RATES) + len(LEVELS)
HOTTEST, ENDED, RAMP = FILLED + 1, FILLED + 2, FILLED + 3
START = FILLED + len(FIGURES)  # the accounts at the start
SINCE = START + 2  # for how long each valve has been as it is [s]; LONG_SINCE at first
OPEN = SINCE + len(VALVES)  # the valves that are open, as bits
_VISIT = OPEN + 1
FULL = _VISIT + len(Visit._fields)  # mass at a state of charge of 100 % [kg]
TANK_VOLUME, _FORCED, _FIRST, _CELLS = FULL + 1, FULL + 2, FULL + 4, FULL + 7  # then forced, free; first, skin, area
_WALL = _CELLS + 1  # five arrays of the wall of the vehicle's tank
INSIDE = _WALL + 5 * VEHICLE_CELLS

OWN_ENTRIES = INSIDE + BANKS * (CELLS + 1) + CELLS + VEHICLE_CELLS + TAIL - OWN
"""Entries of a run's state that are this plant's own; banks have a wall of one cell."""

LONG_SINCE = 1e9
"""Longer than any minimum time [s]."""

SHOWN = (len(RATES), len(LEVELS), len(FIGURES))
KILO = 1e3
"""Grams a kilogram, watts a kilowatt."""

KWH = 3.6e6
"""[J]"""


class RealGasConstants(NamedTuple):
    """The numbers of one station that its equations and limits use."""

    compressor_pressure: float  # where the compressor stops [bar]
    outlet_coefficient: float  # of the model that controllers have [g/(s bar)]
    limits: LimitFigures  # flow and hold infinite: the nozzle saturates the flow, an inlet opens at any pressure
    compressor_count: int
    bank_pressure_max: tuple[float, float, float]  # up to which banks are filled [bar]
    bank_pressure_min: tuple[float, float, float]  # nothing flows out below; 0: no limit [bar]
    minimum_on: float  # of a valve [s]
    minimum_off: float  # [s]
    target: float  # state of charge that ends a fill
    pressure_factor: float  # the highest pressure of a fill over the nominal working pressure
    reports: bool  # whether vehicles report pressure, temperature and volume
    full_pressure: tuple[float, float]  # ends fills of vehicles that do not, lighter and stronger [Pa]
    lighter_ramps: RampTable
    stronger_ramps: RampTable
    parting: float  # tanks are of the first class up to this nominal working pressure [Pa]
    tank_max: float  # a vehicle that holds more has several such tanks side by side [m3]
    lighter: TankClass
    stronger: TankClass
    station: RealGasStation
    gas: GasTables


@uncounted
def _arrays(state: np.ndarray, cells: int) -> tuple[Array, Array, Array, Array, Array]:
    """The arrays of the vehicle's wall; only uncounted kernels may call it, as `bank_at`."""
    each = _WALL
    return (
        state[each : each + cells],
        state[each + VEHICLE_CELLS : each + VEHICLE_CELLS + cells],
        state[each + 2 * VEHICLE_CELLS : each + 2 * VEHICLE_CELLS + cells],
        state[each + 3 * VEHICLE_CELLS : each + 3 * VEHICLE_CELLS + cells],
        state[each + 4 * VEHICLE_CELLS : each + 4 * VEHICLE_CELLS + cells],
    )


@uncounted
def connected_tank(state: np.ndarray) -> Tank:
    """The tank of the connected vehicle; only uncounted kernels may call it, as `bank_at`."""
    capacity, rate, conductance, passed, inverse = _arrays(state, int(state[_CELLS]))
    wall = Wall(capacity, rate, conductance, passed, inverse, state[_FIRST], state[_FIRST + 1], state[_FIRST + 2])
    return Tank(state[TANK_VOLUME], state[_FORCED], state[_FORCED + 1], -1.0, wall)


@uncounted
def connected_visit(state: np.ndarray) -> Visit:
    """The visit of the connected vehicle."""
    return Visit(
        state[_VISIT], state[_VISIT + 1], state[_VISIT + 2], state[_VISIT + 3], state[_VISIT + 4], state[_VISIT + 5]
    )  # fmt: skip


@uncounted
def make_vehicle(
    state: np.ndarray, pressure: float, kelvin: float, volume: float, nominal: float, plant: RealGasConstants
) -> None:
    """Write the tank of a vehicle of a volume [m3] and nominal working pressure [Pa], and its visit, into the state.

    Several tanks side by side are one with as many times the wall: each takes an equal share of gas and heat.
    """
    kind = plant.lighter if nominal <= plant.parting else plant.stronger
    count = math.ceil(volume / plant.tank_max)
    capacity, rate, conductance, passed, inverse = _arrays(state, VEHICLE_CELLS)
    forced, free, first, skin, area = build_tank(
        kind, volume / count, nominal, PERIOD, capacity, rate, conductance, passed, inverse
    )
    for cell in range(VEHICLE_CELLS):
        capacity[cell] *= count
        rate[cell] *= count
        conductance[cell] *= count
        inverse[cell] /= count
    state[TANK_VOLUME], state[_FORCED] = volume, forced * count ** (1.0 - FORCED_EXPONENT)
    state[_FORCED + 1], state[_FIRST] = free * count, first * count
    state[_FIRST + 1], state[_FIRST + 2] = skin / count, area * count
    state[_CELLS] = kind.layers.shape[0] * CELLS_PER_LAYER
    state[FULL] = volume * density_and_enthalpy(nominal, REFERENCE, plant.gas)[0]
    is_lighter = nominal <= plant.parting
    ramp = ramp_of(plant.lighter_ramps if is_lighter else plant.stronger_ramps, volume / count, pressure)
    state[RAMP] = ramp / PER_MINUTE
    state[_VISIT], state[_VISIT + 1], state[_VISIT + 2] = pressure, kelvin, ramp
    state[_VISIT + 3] = plant.target * state[FULL] if plant.reports else np.inf
    state[_VISIT + 4] = (
        plant.pressure_factor * nominal if plant.reports else plant.full_pressure[0 if is_lighter else 1]
    )
    state[_VISIT + 5] = plant.limits.vehicle_temperature_max + KELVIN if plant.reports else np.inf
