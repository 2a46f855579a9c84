"""One second of a station, equations (7.1)-(7.10): the next masses and temperatures from state and valves.

Every function takes plain numbers, CasADi or Pyomo symbols, and holds no branch, so the simulator, the exact
search and the solver models run the same text. Units: g, g/s, bar, deg C, m3, s. Tanks are ordered high,
medium, low, vehicle. A valve is 0 (closed) or 1 (open).
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np

from station.compiled import formula, merged
from station.errors import PlantError
from station.geometry import KELVIN, VEHICLE
from station.limit_figures import LimitFigures
from station.plants.interface import COMPLETE, GOES_ON, REFERENCE_TEMPERATURE, M, Number, P, Plant, Spent, T
from station.plants.sample import sample_of

GAS_CONSTANT = 8.3145
"""R of Eq. (7.3) [J/(K mol)], the digits the thesis prints."""

MOLAR_MASS = 0.002016
"""M of Eq. (7.3), hydrogen [kg/mol]."""

SPECIFIC_GAS = GAS_CONSTANT / MOLAR_MASS * 1e-3 * 1e-5
"""R / M for mass in g and pressure in bar [bar m3/(g K)]."""


class PlantConstants(NamedTuple):
    """The numbers of one station that its equations and limits use."""

    buffer_volume: tuple[float, float, float]  # V_H, V_M, V_L [m3]
    compressor_pressure: float  # p_com [bar]
    inlet_coefficient: float  # c_f_in [g/(s bar)]
    outlet_coefficient: float  # c_f_out [g/(s bar)]
    inlet_heating: tuple[float, float, float]  # c_T_in [K/s]
    outlet_cooling: tuple[float, float, float]  # c_T_out [K/s]
    vehicle_heating: float  # c_TV [K/s]
    heat_exchange: float  # c_Tn [1/s]
    ambient_temperature: float  # T_env [deg C]
    limits: LimitFigures
    compressor_count: int  # n_com of Eq. (7.18)
    unfilled: tuple[float, float, float]  # so far below p_com filling a buffer ends; 0 in the thesis [bar]
    buffer_pressure_min: tuple[float, float, float]  # nothing flows out below; 0 in the thesis [bar]


class Rates(Protocol):
    """Constants that flows and temperatures are computed with: of this plant, or of a model that has these names."""

    @property
    def compressor_pressure(self) -> float:
        """p_com [bar]."""

    @property
    def inlet_coefficient(self) -> float:
        """c_f_in [g/(s bar)]."""

    @property
    def outlet_coefficient(self) -> float:
        """c_f_out [g/(s bar)]."""

    @property
    def inlet_heating(self) -> tuple[float, float, float]:
        """c_T_in [K/s]."""

    @property
    def outlet_cooling(self) -> tuple[float, float, float]:
        """c_T_out [K/s]."""

    @property
    def vehicle_heating(self) -> float:
        """c_TV [K/s]."""

    @property
    def heat_exchange(self) -> float:
        """c_Tn [1/s]."""

    @property
    def ambient_temperature(self) -> float:
        """T_env [deg C]."""


@formula
def gas_pressure(mass: Number, temperature: Number, volume: Number) -> Number:
    """Pressure [bar] of an ideal gas, Eqs (7.3) and (7.8)."""
    return mass * (temperature + KELVIN) * (SPECIFIC_GAS / volume)


@formula
def gas_mass(pressure: Number, temperature: Number, volume: Number) -> Number:
    """Mass [g] of an ideal gas, Eqs (7.3) and (7.8) solved for it."""
    return pressure * volume / (SPECIFIC_GAS * (temperature + KELVIN))


@formula
def inlet_flow(pressure: Number, plant: Rates) -> Number:
    """Flow [g/s] the compressor gives a buffer at `pressure`, first term of Eq. (7.1)."""
    return plant.inlet_coefficient * (plant.compressor_pressure - pressure)


@formula
def outlet_flow(pressure: Number, vehicle_pressure: Number, plant: Rates) -> Number:
    """Flow [g/s] from a buffer to the vehicle, second term of Eq. (7.1) and a term of Eq. (7.6)."""
    return plant.outlet_coefficient * (pressure - vehicle_pressure)


@formula
def exchange_rate(temperature: Number, plant: Rates) -> Number:
    """Warming by the surroundings [K/s]; Eq. (7.4) with its c_Tn read as in Eq. (7.9)."""
    return plant.heat_exchange * (plant.ambient_temperature - temperature)


@formula
def buffer_temperature(
    buffer: int, temperature: Number, inlet: Number, outlet: Number, plant: Rates, period: float
) -> Number:
    """Temperature [deg C] of a buffer `period` seconds on, Eqs (7.4) and (7.5)."""
    heating = plant.inlet_heating[buffer] * inlet - plant.outlet_cooling[buffer] * outlet
    return temperature + period * (heating + exchange_rate(temperature, plant))


@formula
def warmed(buffer: int, pressure: Number, temperature: Number, plant: Rates, period: float) -> Number:
    """Temperature by Eqs (7.4) and (7.5), whatever the pressure; see `interface.warmed`."""
    return buffer_temperature(buffer, temperature, 1, 0, plant, period)


@formula
def vehicle_temperature(temperature: Number, outlets: Number, plant: Rates, period: float) -> Number:
    """Temperature [deg C] of the vehicle tank `period` seconds on, Eqs (7.9) and (7.10).

    `outlets` is the number of open outlets.
    """
    return temperature + period * (plant.vehicle_heating * outlets + exchange_rate(temperature, plant))


@formula
def next_mass(mass: Number, inflow: Number, outflow: Number, period: float) -> Number:
    """Mass [g] of a tank `period` seconds on, at constant flows [g/s]."""
    return mass + period * (inflow - outflow)


@merged
def begin(
    state: np.ndarray,
    tank: int,
    pressure: float,
    temperature: float,
    volume: float,
    finish_pressure: float,
    plant: PlantConstants,
) -> None:
    """Let a tank hold gas; see `interface.begin`."""
    state[P + tank], state[T + tank] = pressure, temperature
    state[M + tank] = gas_mass(pressure, temperature, volume)


@merged
def advance(state: np.ndarray, volume: float, command: int, period: float, plant: PlantConstants) -> Spent:
    """Apply a command, Eqs (7.1)-(7.10); see `interface.advance`."""
    compressed = 0.0
    dispensed = 0.0
    outlets = 0.0
    for buffer in range(3):
        inlet = command >> buffer & 1
        outlet = command >> (3 + buffer) & 1
        pressure = state[P + buffer]
        inflow = inlet_flow(pressure, plant) if inlet else 0.0
        outflow = outlet_flow(pressure, state[P + VEHICLE], plant) if outlet else 0.0
        compressed += inflow
        dispensed += outflow
        outlets += outlet
        mass = next_mass(state[M + buffer], inflow, outflow, period)
        temperature = buffer_temperature(buffer, state[T + buffer], inlet, outlet, plant, period)
        state[M + buffer], state[T + buffer] = mass, temperature
        state[P + buffer] = gas_pressure(mass, temperature, plant.buffer_volume[buffer])
    if volume > 0.0:
        mass = next_mass(state[M + VEHICLE], dispensed, 0.0, period)
        temperature = vehicle_temperature(state[T + VEHICLE], outlets, plant, period)
        state[M + VEHICLE], state[T + VEHICLE] = mass, temperature
        state[P + VEHICLE] = gas_pressure(mass, temperature, volume)
    return Spent(compressed, dispensed)


@merged
def rest(state: np.ndarray, period: float, plant: PlantConstants) -> None:
    """Let time pass with every valve closed; see `interface.rest`."""
    for buffer in range(3):
        temperature = buffer_temperature(buffer, state[T + buffer], 0.0, 0.0, plant, period)
        state[T + buffer] = temperature
        state[P + buffer] = gas_pressure(state[M + buffer], temperature, plant.buffer_volume[buffer])


@merged
def fill_end(
    state: np.ndarray,
    finish_pressure: float,
    plant: PlantConstants,
) -> int:
    """At its finish pressure a vehicle is full; see `interface.fill_end`."""
    return COMPLETE if state[P + VEHICLE] >= finish_pressure else GOES_ON


@merged
def leaves_at(
    state: np.ndarray,
    finish_pressure: float,
    plant: PlantConstants,
) -> float:
    """At its finish pressure; see `interface.leaves_at`."""
    return finish_pressure


@merged
def leave(state: np.ndarray, plant: PlantConstants) -> None:  # as every plant's
    """Let the vehicle go; see `interface.leave`."""


@merged
def own_columns(plant: PlantConstants) -> tuple[int, int, int]:
    """None; see `interface.own_columns`."""
    return 0, 0, 0


@merged
def lose(state: np.ndarray, buffer: int, mass: float, plant: PlantConstants) -> None:
    """Take gas out of a buffer at its temperature; see `interface.lose`."""
    state[M + buffer] = max(state[M + buffer] - mass, 0.0)
    state[P + buffer] = gas_pressure(state[M + buffer], state[T + buffer], plant.buffer_volume[buffer])


@merged
def seep(state: np.ndarray, buffer: int, mass: float, volume: float, plant: PlantConstants) -> None:
    """Move gas between tanks that keep their temperatures; see `interface.seep`."""
    lose(state, buffer, mass, plant)
    state[M + VEHICLE] += mass
    state[P + VEHICLE] = gas_pressure(state[M + VEHICLE], state[T + VEHICLE], volume)


def ailing(
    plant: PlantConstants,
    compressor: float,
    dispenser: float,
    warmer: float,  # chapter 7 has no precooler
) -> PlantConstants:
    """Constants with less of both coefficients; a compressor that gives nothing heats nothing. See `Plant.ailing`."""
    if compressor == 0.0:
        plant = plant._replace(inlet_heating=(0.0, 0.0, 0.0))
    return plant._replace(
        inlet_coefficient=plant.inlet_coefficient * compressor,
        outlet_coefficient=plant.outlet_coefficient * dispenser,
    )


@merged
def emptied_to(buffer: int, plant: PlantConstants) -> Number:
    """The least pressure of a buffer; see `interface.emptied_to`."""
    return plant.buffer_pressure_min[buffer]


@merged
def timed_valves(state: np.ndarray, plant: PlantConstants) -> tuple[int, int]:
    """None: chapter 7 has no minimum times; see `interface.timed_valves`."""
    return 0, 0


@merged
def reads_nozzle(plant: PlantConstants) -> bool:
    """It does not: chapter 7 has vehicles report all or nothing; see `interface.reads_nozzle`."""
    return False


@merged
def metered(state: np.ndarray, plant: PlantConstants) -> float:  # as every plant's
    """Nothing is known; see `interface.metered`."""
    return np.nan


@merged
def filled_to(buffer: int, plant: PlantConstants) -> Number:
    """The compressor's pressure, or what is less by `unfilled`; see `interface.filled_to`."""
    return plant.compressor_pressure - plant.unfilled[buffer]


def _stiffness(temperature: float, volume: float) -> float:
    """How much a gram raises the pressure of a tank [bar/g]: Eqs (7.1)-(7.10) step explicitly."""
    return float(gas_pressure(1.0, temperature, volume))


def _restoring_time(buffer: int, mass: Any, target: float, plant: PlantConstants) -> Any:
    """Seconds in which the compressor brings a buffer from a mass to a larger one [g] at REFERENCE_TEMPERATURE.

    At constant temperature a second of Eq. (7.1) shrinks the distance to the compressor's pressure by the same
    factor, so the seconds are a ratio of logarithms. Infinite where the target lies out of reach. `mass` is a number
    or an array.
    """
    volume = plant.buffer_volume[buffer]
    distance_end, distance_start = (
        plant.compressor_pressure - gas_pressure(m, REFERENCE_TEMPERATURE, volume) for m in (mass, target)
    )
    if distance_start <= 0:
        return np.full(np.shape(mass), np.inf)[()]
    shrink = 1 - plant.inlet_coefficient * SPECIFIC_GAS * (REFERENCE_TEMPERATURE + KELVIN) / volume
    return np.log(distance_start / distance_end) / np.log(shrink)


SAMPLE_CONSTANTS = sample_of(PlantConstants)
"""Constants of the types that kernels are compiled for."""

THESIS = Plant(
    name="thesis",
    constants=PlantConstants,
    constants_of=lambda station, **_communication: station.constants(),
    sample=SAMPLE_CONSTANTS,
    own=0,
    rates={},
    levels={},
    figures={},
    begin=begin,
    advance=advance,
    rest=rest,
    fill_end=fill_end,
    leaves_at=leaves_at,
    leave=leave,
    lose=lose,
    seep=seep,
    own_columns=own_columns,
    reads_nozzle=reads_nozzle,
    metered=metered,
    outlet_flow=outlet_flow,
    filled_to=filled_to,
    emptied_to=emptied_to,
    timed_valves=timed_valves,
    warmed=warmed,
    vehicle_temperature=vehicle_temperature,
    held=gas_mass,
    stiffness=_stiffness,
    restoring_time=_restoring_time,
    ailing=ailing,
)
"""The plant of chapter 7: an ideal gas with constant heat rates."""


def refuse_others(plant: str, claim: str) -> None:
    """Refuse a plant for which a claim is not proved: bounds, margins, tubes and service proofs hold for `THESIS`.

    Raises
    ------
    PlantError
        naming the plant.
    """
    if plant != THESIS.name:
        raise PlantError.of_claim(claim, plant, THESIS.name)
