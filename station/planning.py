"""Equations of the model that controllers have, chosen by the class of its constants when a kernel is compiled.

For `ControlModel` these are the functions of `station.control_model`, for `PlantConstants` the thesis's own: a plan at
a station of the thesis costs what it costs without the rest. A compiled controller is given a `ControlModel` and goes
on with `as_thesis` of it where that is the thesis's.
"""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np

from station import control_model
from station.compiled import merged, specialised
from station.control_model import ControlModel
from station.plants import thesis
from station.plants.interface import Number, Spent

Model = Any
"""A `ControlModel`, or `PlantConstants`."""


@merged
def _gas_pressure(mass: Number, temperature: Number, volume: Number, plant: Model) -> Number:
    return thesis.gas_pressure(mass, temperature, volume)


@merged
def _gas_mass(pressure: Number, temperature: Number, volume: Number, plant: Model) -> Number:
    return thesis.gas_mass(pressure, temperature, volume)


@merged
def _stiffness(pressure: Number, mass: Number, volume: Number, plant: Model) -> Number:
    return pressure / mass


@merged
def _closing(coefficient: float, pressure: Number, mass: Number, volume: Number, plant: Model) -> Number:
    return coefficient * pressure / mass


@merged
def _effort(pressure: Number, plant: Model) -> Number:
    return 1.0


@merged
def _mean_effort(low: Number, high: Number, plant: Model) -> Number:
    return 1.0


@merged
def _most_dispensed(
    mass: Number, temperature: Number, pressure: Number, volume: Number, plant: Model, period: float
) -> Number:
    return math.inf


@merged
def _nozzle_flow(plant: Model) -> float:
    return math.inf


@merged
def _fastest_rise(plant: Model) -> float:
    return math.inf


@merged
def _vehicle_temperature(
    temperature: Number, outlets: Number, mass: Number, flow: Number, volume: Number, plant: Model, period: float
) -> Number:
    return thesis.vehicle_temperature(temperature, outlets, plant, period)


@merged
def _hottest_vehicle(
    temperature: float, cap: float, mass: float, flow: float, volume: float, plant: Model, period: float
) -> float:
    return min(cap, thesis.vehicle_temperature(temperature, 1.0, plant, period))


@merged
def _coldest_vehicle(temperature: float, plant: Model) -> float:
    return min(temperature, plant.ambient_temperature)


@merged
def _is_thesis(plant: Model) -> bool:
    return True


@merged
def _driving_pressure(plant: Model) -> float:
    driving: float = plant.compressor_pressure
    return driving


_THESIS = SimpleNamespace(
    gas_pressure=_gas_pressure, gas_mass=_gas_mass, stiffness=_stiffness, closing=_closing,
    inlet_flow=thesis.inlet_flow, effort=_effort, mean_effort=_mean_effort, most_dispensed=_most_dispensed,
    nozzle_flow=_nozzle_flow, fastest_rise=_fastest_rise,
    vehicle_temperature=_vehicle_temperature, advance=thesis.advance, is_thesis=_is_thesis,
    driving_pressure=_driving_pressure, hottest_vehicle=_hottest_vehicle, coldest_vehicle=_coldest_vehicle,
)  # fmt: skip


def _equations_of(constants: type[Any]) -> Any:
    return control_model if constants is ControlModel else _THESIS


_specialised = specialised(_equations_of)


@_specialised
def gas_pressure(mass: Number, temperature: Number, volume: Number, plant: Model) -> Number:
    """Pressure [bar] of a mass [g] at a temperature [deg C] in a volume [m3]."""
    return _equations_of(type(plant)).gas_pressure(mass, temperature, volume, plant)


@_specialised
def gas_mass(pressure: Number, temperature: Number, volume: Number, plant: Model) -> Number:
    """Mass [g] at a pressure [bar] and a temperature [deg C] in a volume [m3]."""
    return _equations_of(type(plant)).gas_mass(pressure, temperature, volume, plant)


@_specialised
def stiffness(pressure: Number, mass: Number, volume: Number, plant: Model) -> Number:
    """By how much a gram more at the same temperature raises the pressure of a tank [bar/g]."""
    return _equations_of(type(plant)).stiffness(pressure, mass, volume, plant)


@_specialised
def closing(coefficient: float, pressure: Number, mass: Number, volume: Number, plant: Model) -> Number:
    """Share of a difference of pressures that a second of the flow `coefficient` times it closes at a tank."""
    return _equations_of(type(plant)).closing(coefficient, pressure, mass, volume, plant)


@_specialised
def inlet_flow(pressure: Number, plant: Model) -> Number:
    """Flow [g/s] the compressor gives a buffer at `pressure` [bar]."""
    return _equations_of(type(plant)).inlet_flow(pressure, plant)


@_specialised
def effort(pressure: Number, plant: Model) -> Number:
    """Work of a second of compressor against a pressure [bar], by the mean of such work; 1 in the thesis."""
    return _equations_of(type(plant)).effort(pressure, plant)


@_specialised
def mean_effort(low: Number, high: Number, plant: Model) -> Number:
    """The mean of `effort` between two pressures [bar]."""
    return _equations_of(type(plant)).mean_effort(low, high, plant)


@_specialised
def most_dispensed(
    mass: Number, temperature: Number, pressure: Number, volume: Number, plant: Model, period: float
) -> Number:
    """Flow [g/s] that nozzle and ramp let into the vehicle for `period` seconds."""
    return _equations_of(type(plant)).most_dispensed(mass, temperature, pressure, volume, plant, period)


@_specialised
def nozzle_flow(plant: Model) -> float:
    """The nozzle lets no more into any vehicle [g/s]; infinite in the thesis."""
    most: float = _equations_of(type(plant)).nozzle_flow(plant)
    return most


@_specialised
def fastest_rise(plant: Model) -> float:
    """The ramp lets no vehicle's pressure rise faster [bar/s]; infinite in the thesis."""
    rise: float = _equations_of(type(plant)).fastest_rise(plant)
    return rise


@_specialised
def vehicle_temperature(
    temperature: Number, outlets: Number, mass: Number, flow: Number, volume: Number, plant: Model, period: float
) -> Number:
    """Temperature [deg C] of the vehicle `period` seconds on, from its mass [g] and the flow [g/s] into it."""
    found = _equations_of(type(plant)).vehicle_temperature
    return found(temperature, outlets, mass, flow, volume, plant, period)


@_specialised
def hottest_vehicle(
    temperature: float, cap: float, mass: float, flow: float, volume: float, plant: Model, period: float
) -> float:
    """Nothing warms a vehicle of at least a mass [g] beyond this [deg C] in `period` seconds with at most a flow [g/s].

    `temperature` is at least its own and the ambient one [deg C], and it is opened to nothing beyond `cap`.
    """
    hottest: float = _equations_of(type(plant)).hottest_vehicle(temperature, cap, mass, flow, volume, plant, period)
    return hottest


@_specialised
def coldest_vehicle(temperature: float, plant: Model) -> float:
    """Nothing cools a vehicle below this [deg C]."""
    coldest: float = _equations_of(type(plant)).coldest_vehicle(temperature, plant)
    return coldest


@_specialised
def advance(state: np.ndarray, volume: float, command: int, period: float, plant: Model) -> Spent:
    """A second of a station as its controllers believe it to be; see `interface.advance`."""
    spent: Spent = _equations_of(type(plant)).advance(state, volume, command, period, plant)
    return spent


@_specialised
def is_thesis(plant: Model) -> bool:
    """Whether the model is the thesis's, so that what holds for that alone may be asked of it."""
    found: bool = _equations_of(type(plant)).is_thesis(plant)
    return found


@_specialised
def driving_pressure(plant: Model) -> float:
    """The pressure at which the compressor's flow would vanish [bar]."""
    found: float = _equations_of(type(plant)).driving_pressure(plant)
    return found
