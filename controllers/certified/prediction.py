"""Prediction without correction: every tank by intervals, over the seconds of given commands."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from station.geometry import INLETS, OUTLETS, VEHICLE
from station.plants.thesis import PlantConstants
from station.tube import TankInputs, TankInterval, next_interval, pressure_interval
from station.uncertainty import Uncertainty

Tanks = tuple[TankInterval, TankInterval, TankInterval, TankInterval | None]
"""High, medium, low and vehicle; None where no vehicle is connected."""


class Known(NamedTuple):
    """Inputs of the tanks, as far as they are known."""

    plant: PlantConstants  # nominal
    uncertainty: Uncertainty
    vehicle_volume: float  # [m3]
    volume_known: bool  # exactly, as a vehicle that communicates tells it


def _about(value: float, width: float) -> tuple[float, float]:
    return value * (1.0 - width), value * (1.0 + width)


def drive(tank: int, command: int, tanks: Tanks, known: Known) -> TankInputs:
    """Inputs of a tank during a second of a command; the pressures of the others are those of `tanks`."""
    plant, width = known.plant, known.uncertainty.parameters
    warm, error = known.uncertainty.temperature_k, known.uncertainty.pressure_bar
    pull, rate, heating = (0.0, 0.0), (0.0, 0.0), (0.0, 0.0)
    vehicle = tanks[VEHICLE]
    outlet = next((buffer for buffer in range(3) if command & OUTLETS & (8 << buffer)), None)
    if tank == VEHICLE and outlet is not None:
        source = tanks[outlet]
        pull = pressure_interval(source) if source is not None else pull
        low, high = _about(plant.outlet_coefficient, width)
        least, most = (1.0, 1.0) if known.volume_known else (1.0 - width, 1.0 + width)
        rate = low / (known.vehicle_volume * most), high / (known.vehicle_volume * least)
        heating = _about(plant.vehicle_heating, width)
    elif tank == outlet and vehicle is not None:
        pull = pressure_interval(vehicle)
        low, high = _about(plant.outlet_coefficient, width)
        rate = low / plant.buffer_volume[tank], high / plant.buffer_volume[tank]
        low, high = _about(plant.outlet_cooling[tank], width)
        heating = -high, -low
    elif tank != VEHICLE and command & INLETS & (1 << tank):
        pull = plant.compressor_pressure - error, plant.compressor_pressure + error
        low, high = _about(plant.inlet_coefficient, width)
        rate = low / plant.buffer_volume[tank], high / plant.buffer_volume[tank]
        heating = _about(plant.inlet_heating[tank], width)
    ambient = plant.ambient_temperature
    return TankInputs(pull, rate, heating, _about(plant.heat_exchange, width), (ambient - warm, ambient + warm))


def step(tanks: Tanks, command: int, known: Known) -> Tanks:
    """Between what every tank lies after a second of a command that breaks no limit."""
    moved = [
        None if ends is None else TankInterval(*next_interval(ends, drive(tank, command, tanks, known)))
        for tank, ends in enumerate(tanks)
    ]
    return tuple(moved)  # type: ignore[return-value]  # as many as before, and None where it was


def predict(tanks: Tanks, commands: Sequence[int], known: Known) -> list[Tanks]:
    """Between what every tank lies after each of these commands: a tube that widens, since no reading corrects it.

    A second's interval holds every state that parameters and sensor errors within the uncertainty lead to from any
    state of `tanks`. Nothing says that it contracts: what is not known of a closed buffer's gas stays unknown.
    """
    found = []
    for command in commands:
        tanks = step(tanks, command, known)
        found.append(tanks)
    return found
