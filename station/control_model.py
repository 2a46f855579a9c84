"""The control model: what controllers believe of a station, the thesis's equations with what a real gas adds.

p = m R T / (V - m b), a compressor whose flow falls with the pressure of a buffer towards p0, an outlet whose flow the
nozzle and the ramp of this tank cap, and a vehicle warmed by the energy of the gas it is given. With b = 0, p0 = p_com,
no caps and no energy law (`thesis_model`) every figure is that of Eqs (7.1)-(7.10), to the bit. Units and order of
tanks are those of `station.plants.thesis`.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from station.compiled import formula, merged
from station.geometry import KELVIN, VEHICLE
from station.limit_figures import LimitFigures
from station.plants import thesis
from station.plants.interface import M, Number, P, Spent, T, register_model
from station.plants.thesis import SPECIFIC_GAS, PlantConstants, buffer_temperature, next_mass, outlet_flow


class ControlModel(NamedTuple):
    """The numbers of one station that its controllers plan with: those of `PlantConstants`, and eight of their own."""

    buffer_volume: tuple[float, float, float]  # V_H, V_M, V_L [m3]
    compressor_pressure: float  # p_com: nothing is filled beyond it [bar]
    inlet_coefficient: float  # c_f_in [g/(s bar)]
    outlet_coefficient: float  # c_f_out [g/(s bar)]
    inlet_heating: tuple[float, float, float]  # c_T_in [K/s]
    outlet_cooling: tuple[float, float, float]  # c_T_out [K/s]
    vehicle_heating: float  # c_TV [K/s]; without the energy law
    heat_exchange: float  # c_Tn [1/s]; of the vehicle without the energy law
    ambient_temperature: float  # T_env [deg C]
    limits: LimitFigures
    compressor_count: int  # n_com of Eq. (7.18)
    unfilled: tuple[float, float, float]  # so far below p_com filling a buffer ends [bar]
    buffer_pressure_min: tuple[float, float, float]  # nothing flows out below; 0: no limit [bar]
    driving_pressure: float  # p0: where the compressor's flow would vanish [bar]; p_com in the thesis
    covolume: float  # b [m3/g]; 0: ideal gas
    nozzle_flow: float  # no more flows into a vehicle [g/s]; infinite: no such cap
    ramp: float  # of a vehicle's pressure at most [bar/s]; infinite: no such cap
    delivered_temperature: float  # of a vehicle warmed by nothing but the gas it is given [K]; 0: the thesis's law
    wall_conductance: float  # heat its tank takes, over c_v, a cubic metre of it [g/(s m3)]
    effort_base: float  # of a second of compressor, as a line over the pressure it works against; 1 in the thesis
    effort_slope: float  # of that line [1/bar]; 0 in the thesis: each second counts alike


LEAST_EFFORT = 0.1
"""No second of compressor counts for less, though gas flows by itself into a bank below the suction's pressure: a plan
that pays nothing for it and gains nothing by it leaves empty banks empty."""


def thesis_model(plant: PlantConstants) -> ControlModel:
    """The control model that is the thesis's, Eqs (7.1)-(7.10)."""
    return ControlModel(*plant, plant.compressor_pressure, 0.0, math.inf, math.inf, 0.0, 0.0, 1.0, 0.0)


_OF_THESIS = len(PlantConstants._fields)
"""A ControlModel begins with so many entries: those of PlantConstants, in their order."""

SAMPLE_MODEL = thesis_model(thesis.SAMPLE_CONSTANTS)
"""Constants of the types that kernels are compiled for."""


@formula
def gas_pressure(mass: Number, temperature: Number, volume: Number, plant: ControlModel) -> Number:
    """Pressure [bar] of a mass [g] at a temperature [deg C] in a volume [m3]; Abel and Noble's, ideal where b = 0."""
    if plant.covolume == 0.0:
        return thesis.gas_pressure(mass, temperature, volume)
    return mass * (temperature + KELVIN) * (SPECIFIC_GAS / (volume - mass * plant.covolume))


@formula
def held_mass(pressure: Number, temperature: Number, volume: Number, covolume: float) -> Number:
    """Mass [g] at a pressure [bar] with a covolume [m3/g]: `gas_pressure` solved for it."""
    if covolume == 0.0:
        return thesis.gas_mass(pressure, temperature, volume)
    return pressure * volume / (SPECIFIC_GAS * (temperature + KELVIN) + pressure * covolume)


@formula
def gas_mass(pressure: Number, temperature: Number, volume: Number, plant: ControlModel) -> Number:
    """Mass [g] at a pressure [bar]: `gas_pressure` solved for it."""
    return held_mass(pressure, temperature, volume, plant.covolume)


@formula
def stiffness(pressure: Number, mass: Number, volume: Number, plant: ControlModel) -> Number:
    """By how much a gram more at the same temperature raises the pressure of a tank [bar/g]."""
    if plant.covolume == 0.0:
        return pressure / mass
    return pressure / mass * (volume / (volume - mass * plant.covolume))


@formula
def closing(coefficient: float, pressure: Number, mass: Number, volume: Number, plant: ControlModel) -> Number:
    """Share of a difference of pressures that a second of the flow `coefficient` times it closes at a tank."""
    if plant.covolume == 0.0:
        return coefficient * pressure / mass
    return coefficient * pressure / mass * (volume / (volume - mass * plant.covolume))


@formula
def inlet_flow(pressure: Number, plant: ControlModel) -> Number:
    """Flow [g/s] the compressor gives a buffer at `pressure` [bar]."""
    return plant.inlet_coefficient * (plant.driving_pressure - pressure)


@formula
def effort(pressure: Number, plant: ControlModel) -> Number:
    """Work of a second of compressor against a pressure [bar], by the mean of such work: what it counts in a plan."""
    return max(plant.effort_base + plant.effort_slope * pressure, LEAST_EFFORT)


@formula
def mean_effort(low: Number, high: Number, plant: ControlModel) -> Number:
    """The mean of `effort` between two pressures [bar], of which either may be the higher."""
    if plant.effort_slope <= 0.0:
        return effort(low, plant)
    knee = (LEAST_EFFORT - plant.effort_base) / plant.effort_slope
    below, above = min(low, high), max(low, high)
    if below >= knee or above <= knee:
        return effort(0.5 * (low + high), plant)
    light = (knee - below) / (above - below)
    return light * LEAST_EFFORT + (1.0 - light) * effort(0.5 * (knee + above), plant)


@formula
def ramp_flow(
    mass: Number, temperature: Number, pressure: Number, volume: Number, plant: ControlModel, period: float
) -> Number:
    """Flow [g/s] that brings a vehicle's pressure up by the ramp in `period` seconds.

    With the energy that it carries, and what the wall takes; needs the energy law.
    """
    room = volume - mass * plant.covolume
    lost = SPECIFIC_GAS * plant.wall_conductance * volume * (temperature - plant.ambient_temperature)
    a_gram = SPECIFIC_GAS * plant.delivered_temperature + (pressure + plant.ramp * period) * plant.covolume
    return (plant.ramp * room + lost) / a_gram


@formula
def most_dispensed(
    mass: Number, temperature: Number, pressure: Number, volume: Number, plant: ControlModel, period: float
) -> Number:
    """Flow [g/s] that nozzle and ramp let into the vehicle for `period` seconds, infinite without such caps."""
    if plant.ramp == math.inf:
        return plant.nozzle_flow
    return max(min(plant.nozzle_flow, ramp_flow(mass, temperature, pressure, volume, plant, period)), 0.0)


@formula
def vehicle_temperature(
    temperature: Number, outlets: Number, mass: Number, flow: Number, volume: Number, plant: ControlModel, period: float
) -> Number:
    """Temperature [deg C] of the vehicle `period` seconds on, from its mass [g] and the flow [g/s] into it.

    By energy with a constant c_v: what comes in brings `delivered_temperature`, the wall takes the rest; Eqs (7.9) and
    (7.10) where that is 0.
    """
    if plant.delivered_temperature == 0.0:
        return thesis.vehicle_temperature(temperature, outlets, plant, period)
    gained, taken = flow * period, plant.wall_conductance * volume * period
    held = mass * (temperature + KELVIN) + gained * plant.delivered_temperature
    return (held + taken * (plant.ambient_temperature + KELVIN)) / (mass + gained + taken) - KELVIN


@formula
def hottest_vehicle(
    temperature: float, cap: float, mass: float, flow: float, volume: float, plant: ControlModel, period: float
) -> float:
    """Nothing warms a vehicle of at least a mass [g] beyond this [deg C] in `period` seconds with at most a flow [g/s].

    `temperature` is at least its own and the ambient one [deg C], and it is opened to nothing beyond `cap`. By energy
    the least mass with the most flow is warmed the most, unless the gas delivered cools.
    """
    if plant.delivered_temperature == 0.0:
        return min(cap, thesis.vehicle_temperature(temperature, 1.0, plant, period))
    return max(temperature, vehicle_temperature(temperature, 1.0, mass, flow, volume, plant, period))


@formula
def coldest_vehicle(temperature: float, plant: ControlModel) -> float:
    """Nothing cools a vehicle below this [deg C]."""
    coldest = min(temperature, plant.ambient_temperature)
    if plant.delivered_temperature == 0.0:
        return coldest
    return min(coldest, plant.delivered_temperature - KELVIN)


@merged
def advance(state: np.ndarray, volume: float, command: int, period: float, plant: ControlModel) -> Spent:
    """A second of a station as its controllers believe it to be; see `interface.advance`."""
    compressed, dispensed, outlets = 0.0, 0.0, 0.0
    for buffer in range(3):
        if command >> (3 + buffer) & 1:
            dispensed += outlet_flow(state[P + buffer], state[P + VEHICLE], plant)
            outlets += 1.0
    share = 1.0
    if volume > 0.0 and outlets > 0.0:
        most = most_dispensed(state[M + VEHICLE], state[T + VEHICLE], state[P + VEHICLE], volume, plant, period)
        if dispensed > most:
            share = most / dispensed
    dispensed = 0.0
    for buffer in range(3):
        inlet, outlet = command >> buffer & 1, command >> (3 + buffer) & 1
        pressure = state[P + buffer]
        inflow = inlet_flow(pressure, plant) if inlet else 0.0
        outflow = share * outlet_flow(pressure, state[P + VEHICLE], plant) if outlet else 0.0
        compressed += inflow
        dispensed += outflow
        mass = next_mass(state[M + buffer], inflow, outflow, period)
        temperature = buffer_temperature(buffer, state[T + buffer], inlet, outlet, plant, period)
        state[M + buffer], state[T + buffer] = mass, temperature
        state[P + buffer] = gas_pressure(mass, temperature, plant.buffer_volume[buffer], plant)
    if volume > 0.0:
        before = state[M + VEHICLE]
        mass = next_mass(before, dispensed, 0.0, period)
        temperature = vehicle_temperature(state[T + VEHICLE], outlets, before, dispensed, volume, plant, period)
        state[M + VEHICLE], state[T + VEHICLE] = mass, temperature
        state[P + VEHICLE] = gas_pressure(mass, temperature, volume, plant)
    return Spent(compressed, dispensed)


@merged
def is_thesis(plant: ControlModel) -> bool:
    """Whether the model is the thesis's, so that what holds for that alone may be asked of it."""
    real_gas = plant.covolume != 0.0 or plant.delivered_temperature != 0.0 or plant.effort_slope != 0.0
    capped = plant.ramp != math.inf or plant.nozzle_flow != math.inf
    return not (real_gas or capped or plant.driving_pressure != plant.compressor_pressure)


@merged
def driving_pressure(plant: ControlModel) -> float:
    """The pressure at which the compressor's flow would vanish [bar]."""
    return plant.driving_pressure


@merged
def nozzle_flow(plant: ControlModel) -> float:
    """The nozzle lets no more into any vehicle [g/s]."""
    return plant.nozzle_flow


@merged
def fastest_rise(plant: ControlModel) -> float:
    """The ramp lets no vehicle's pressure rise faster [bar/s]."""
    return plant.ramp


@formula
def as_thesis(plant: ControlModel) -> PlantConstants:
    """The constants of the thesis's equations in a model."""
    fields: tuple[Any, ...] = plant[:_OF_THESIS]
    return PlantConstants(*fields)


@merged
def _limited_temperature(temperature: Number, outlets: Number, plant: ControlModel, period: Number) -> Number:
    """What Eq. (7.13) looks at: with the energy law the temperature now, for what flows in is not told there."""
    if plant.delivered_temperature == 0.0:
        return thesis.vehicle_temperature(temperature, outlets, plant, period)
    return temperature


register_model(
    replace(
        thesis.THESIS,
        name="control-model",
        constants=ControlModel,
        sample=SAMPLE_MODEL,
        vehicle_temperature=_limited_temperature,
    )
)
