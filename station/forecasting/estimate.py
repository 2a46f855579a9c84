"""Forks of a station that is known by estimates: their mean, and states drawn from what is not known of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.forecasting.fork import Fork
from station.geometry import BUFFERS, TANKS, VEHICLE
from station.plants.interface import begin, plant_named
from station.quantities import PRESSURE_MAX
from station.run import (
    ARRIVAL,
    ARRIVED,
    CLOCK,
    CONNECTED,
    CURRENT,
    DELIVERED,
    FINISH_PRESSURE,
    NEXT,
    START_PRESSURE,
    START_TEMPERATURE,
    VOLUME,
)
from station.scenario import Scenario
from station.simulation import start_run

Floats = NDArray[np.float64]

_LEAST = 0.1
"""No pressure below this is looked for [bar]."""

_STEP = 1e-3
"""Relative step of the slopes of a pressure."""


class Estimated(NamedTuple):
    """Tanks as a filter knows them, in the order of TANKS; a vehicle that is not there has NaN."""

    mass: Floats  # (4,) [g]
    temperature: Floats  # (4,) [deg C]
    mass_deviation: Floats  # (4,) standard deviations [g]
    temperature_deviation: Floats  # (4,) [K]
    volume: float  # of the vehicle's tank [m3]

    @property
    def connected(self) -> bool:
        """Whether a vehicle is there."""
        return bool(np.isfinite(self.mass[VEHICLE]) and np.isfinite(self.temperature[VEHICLE]))


def pressure_of(plant: str, mass: float, temperature: float, volume: float) -> float:
    """Pressure [bar] of a mass [g] at a temperature [deg C] in a volume [m3], by the gas law of a plant.

    Raises
    ------
    ValueError
        if it lies outside 0.1 bar to the greatest pressure of a station.
    """
    from scipy.optimize import brentq  # takes long to import

    held = plant_named(plant).held
    found: float = brentq(lambda bar: held(bar, temperature, volume) - mass, _LEAST, PRESSURE_MAX, xtol=1e-6)
    return found


def _volumes(scenario: Scenario, estimated: Estimated) -> list[float]:
    return [*(tank.volume_m3 for tank in scenario.station.buffers.all), estimated.volume]


def fork_of(scenario: Scenario, time: float, estimated: Estimated) -> Fork:
    """The fork of a station at its mean, with the vehicle at the dispenser and none in the queue.

    Walls and machines are as the plant begins with such a gas; what was open before is not known, and taken as closed.

    Raises
    ------
    ValueError
        if a tank holds what none could.
    """
    run, parameters = start_run(scenario)
    state, counters = run.state.copy(), run.counters.copy()
    state[CLOCK] = time
    vehicles = np.full((len(run.vehicles), int(estimated.connected)), np.nan)
    _fill(state, scenario, estimated, _pressures(scenario, estimated), estimated.temperature, parameters.plant)
    if estimated.connected:
        usual = scenario.station.vehicle
        pressure, temperature = state[VEHICLE], float(estimated.temperature[VEHICLE])
        figures = (time, time, pressure, temperature, estimated.volume, usual.finish_pressure_bar, 0.0)
        places = [ARRIVAL, CONNECTED, START_PRESSURE, START_TEMPERATURE, VOLUME, FINISH_PRESSURE, DELIVERED]
        vehicles[places, 0] = figures
        counters[[ARRIVED, NEXT]], counters[CURRENT] = 1, 0
    else:
        counters[[ARRIVED, NEXT]], counters[CURRENT] = 0, -1
    return Fork(state, counters, vehicles, parameters)


def _pressures(scenario: Scenario, estimated: Estimated) -> list[float]:
    volumes, there = _volumes(scenario, estimated), len(TANKS) if estimated.connected else len(BUFFERS)
    return [
        pressure_of(
            scenario.station.plant, float(estimated.mass[tank]), float(estimated.temperature[tank]), volumes[tank]
        )
        for tank in range(there)
    ]


def _fill(
    state: Floats, scenario: Scenario, estimated: Estimated, pressures: list[float], temperatures: Floats,
    constants: object,
) -> None:  # fmt: skip
    """Let the tanks of a state hold gas at pressures [bar] and temperatures [deg C]."""
    finish = scenario.station.vehicle.finish_pressure_bar
    for tank, (pressure, volume) in enumerate(zip(pressures, _volumes(scenario, estimated), strict=False)):
        begin(state, tank, pressure, float(temperatures[tank]), volume, finish, constants)


def drawn(scenario: Scenario, fork: Fork, estimated: Estimated, seed: int) -> Callable[[int], Floats]:
    """The state in which each future begins: masses and temperatures drawn from their normal laws.

    They are drawn apart, which makes pressures less certain than the filter has them. Pressures follow by their slopes
    at the mean.
    """
    plant, volumes, mean = scenario.station.plant, _volumes(scenario, estimated), _pressures(scenario, estimated)
    slopes = np.zeros((len(mean), 2))
    for tank, pressure in enumerate(mean):
        mass, temperature = float(estimated.mass[tank]), float(estimated.temperature[tank])
        heavier = pressure_of(plant, mass * (1 + _STEP), temperature, volumes[tank])
        warmer = pressure_of(plant, mass, temperature + 1.0, volumes[tank])
        slopes[tank] = (heavier - pressure) / (mass * _STEP), warmer - pressure

    def state(future: int) -> Floats:
        random = np.random.default_rng([seed, future, len(TANKS)])
        normal = random.standard_normal((2, len(TANKS)))
        masses = normal[0] * np.nan_to_num(estimated.mass_deviation)
        temperatures = normal[1] * np.nan_to_num(estimated.temperature_deviation)
        pressures = [
            max(mean[tank] + slopes[tank, 0] * masses[tank] + slopes[tank, 1] * temperatures[tank], _LEAST)
            for tank in range(len(mean))
        ]
        found = fork.state.copy()
        _fill(found, scenario, estimated, pressures, estimated.temperature + temperatures, fork.parameters.plant)
        return found

    return state
