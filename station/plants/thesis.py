"""One second of a station, equations (7.1)-(7.10): the next masses and temperatures from state and valves.

Every function takes plain numbers, CasADi or Pyomo symbols, and holds no branch, so the simulator, the exact
search and the solver models run the same text. Units: g, g/s, bar, deg C, m3, s. Tanks are ordered high,
medium, low, vehicle. A valve is 0 (closed) or 1 (open).
"""

from __future__ import annotations

from typing import Any, NamedTuple

from station.compiled import formula
from station.geometry import KELVIN

GAS_CONSTANT = 8.3145
"""R of Eq. (7.3) [J/(K mol)], the digits the thesis prints."""

MOLAR_MASS = 0.002016
"""M of Eq. (7.3), hydrogen [kg/mol]."""

SPECIFIC_GAS = GAS_CONSTANT / MOLAR_MASS * 1e-3 * 1e-5
"""R / M for mass in g and pressure in bar [bar m3/(g K)]."""


Number = Any
"""A float, or a symbol of CasADi or Pyomo."""


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
    buffer_temperature_max: float  # T_bmax [deg C]
    vehicle_temperature_max: float  # T_Vmax [deg C]
    dispenser_flow_max: float  # Eq. (7.11) [g/s]
    outlet_gap_min: float  # p_dref of Eq. (7.12) [bar]
    hold_pressure: float  # threshold of Eq. (7.16) [bar]
    compressor_count: int  # n_com of Eq. (7.18)


@formula
def gas_pressure(mass: Number, temperature: Number, volume: Number) -> Number:
    """Pressure [bar] of an ideal gas, Eqs (7.3) and (7.8)."""
    return mass * (temperature + KELVIN) * (SPECIFIC_GAS / volume)


@formula
def gas_mass(pressure: Number, temperature: Number, volume: Number) -> Number:
    """Mass [g] of an ideal gas, Eqs (7.3) and (7.8) solved for it."""
    return pressure * volume / (SPECIFIC_GAS * (temperature + KELVIN))


@formula
def inlet_flow(pressure: Number, plant: PlantConstants) -> Number:
    """Flow [g/s] the compressor gives a buffer at `pressure`, first term of Eq. (7.1)."""
    return plant.inlet_coefficient * (plant.compressor_pressure - pressure)


@formula
def outlet_flow(pressure: Number, vehicle_pressure: Number, plant: PlantConstants) -> Number:
    """Flow [g/s] from a buffer to the vehicle, second term of Eq. (7.1) and a term of Eq. (7.6)."""
    return plant.outlet_coefficient * (pressure - vehicle_pressure)


@formula
def exchange_rate(temperature: Number, plant: PlantConstants) -> Number:
    """Warming by the surroundings [K/s]; Eq. (7.4) with its c_Tn read as in Eq. (7.9)."""
    return plant.heat_exchange * (plant.ambient_temperature - temperature)


@formula
def buffer_temperature(
    buffer: int, temperature: Number, inlet: Number, outlet: Number, plant: PlantConstants, period: float
) -> Number:
    """Temperature [deg C] of a buffer `period` seconds on, Eqs (7.4) and (7.5)."""
    heating = plant.inlet_heating[buffer] * inlet - plant.outlet_cooling[buffer] * outlet
    return temperature + period * (heating + exchange_rate(temperature, plant))


@formula
def vehicle_temperature(temperature: Number, outlets: Number, plant: PlantConstants, period: float) -> Number:
    """Temperature [deg C] of the vehicle tank `period` seconds on, Eqs (7.9) and (7.10).

    `outlets` is the number of open outlets.
    """
    return temperature + period * (plant.vehicle_heating * outlets + exchange_rate(temperature, plant))


@formula
def next_mass(mass: Number, inflow: Number, outflow: Number, period: float) -> Number:
    """Mass [g] of a tank `period` seconds on, at constant flows [g/s]."""
    return mass + period * (inflow - outflow)
