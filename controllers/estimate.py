"""Estimate of the vehicle: the live reading, or a prediction from the first one."""

from __future__ import annotations

import numpy as np

from station.compiled import uncounted
from station.controller import Observation
from station.geometry import OUTLETS
from station.parameters import Station
from station.planning import Model, gas_mass, gas_pressure, most_dispensed, vehicle_temperature
from station.plants.thesis import next_mass, outlet_flow
from station.tightening import TightenedStation

ESTIMATE_SIZE = 9
"""Entries of memory the estimate uses: vehicle, time, mass, temperature, pressure, three buffer pressures, and whether
the station predicts."""

_VEHICLE, _TIME, _MASS, _TEMPERATURE, _PRESSURE, _BUFFERS, _PREDICTED = 0, 1, 2, 3, 4, 5, 8


def use_station_prediction(station: Station, memory: np.ndarray) -> np.ndarray:
    """`memory` with whether the station itself predicts a vehicle that reports nothing: in a disturbed scenario.

    A prediction of the controller's own, with wrong parameters, would promise what the shield must refuse.
    """
    memory[_PREDICTED] = isinstance(station, TightenedStation)
    return memory


@uncounted
def estimate_vehicle(observation: Observation, model: Model, memory: np.ndarray) -> tuple[float, float]:
    """Pressure [bar] and temperature [deg C] of the connected vehicle.

    With communication these are the readings. Without, the reading at connection is carried forward by Eqs
    (7.6)-(7.10) with the station's usual tank and the commands applied since, up to the finish pressure, at which it
    would have left; a controller that was not asked in the second before starts again from the reading. In a
    disturbed scenario (`told_by`) the station predicts instead. `memory` (ESTIMATE_SIZE,) belongs to this function.
    """
    if observation.communication or observation.vehicle < 0 or memory[_PREDICTED] != 0.0:
        return observation.vehicle_pressure, observation.vehicle_temperature
    pressure, temperature = observation.vehicle_pressure, observation.vehicle_temperature
    mass = gas_mass(pressure, temperature, observation.vehicle_volume, model)
    if memory[_VEHICLE] == observation.vehicle + 1 and observation.time - memory[_TIME] == 1.0:
        flow = 0.0
        outlets = 0.0
        for buffer in range(3):
            if observation.previous & OUTLETS & (8 << buffer):
                flow += outlet_flow(memory[_BUFFERS + buffer], memory[_PRESSURE], model)
                outlets += 1.0
        volume, mass, warmth = observation.vehicle_volume, memory[_MASS], memory[_TEMPERATURE]
        flow = min(flow, most_dispensed(mass, warmth, memory[_PRESSURE], volume, model, 1.0))
        temperature = vehicle_temperature(warmth, outlets, mass, flow, volume, model, 1.0)
        mass = next_mass(mass, flow, 0.0, 1.0)
        pressure = gas_pressure(mass, temperature, observation.vehicle_volume, model)
        if pressure > observation.finish_pressure:  # it would have left: its tank is larger than the usual one
            pressure = observation.finish_pressure
            mass = gas_mass(pressure, temperature, observation.vehicle_volume, model)
    memory[_VEHICLE] = observation.vehicle + 1
    memory[_TIME] = observation.time
    memory[_MASS] = mass
    memory[_TEMPERATURE] = temperature
    memory[_PRESSURE] = pressure
    for buffer in range(3):
        memory[_BUFFERS + buffer] = observation.pressure[buffer]
    return pressure, temperature
