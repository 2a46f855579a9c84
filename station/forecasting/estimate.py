"""Forks of a station that is known by estimates: their mean, and states drawn from what is not known of it.

A filter's belief has all that the plant is made of. A row of estimates that was kept has masses and temperatures alone.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.estimation.belief import Belief
from station.estimation.filter import model_of
from station.forecasting.fork import Fork
from station.geometry import BUFFERS, TANKS, VEHICLE
from station.plants.interface import M, P, T, begin, plant_named
from station.quantities import PRESSURE_MAX
from station.run import (
    ARRIVAL,
    ARRIVED,
    CLOCK,
    CONNECTED,
    CURRENT,
    DELIVERED,
    FINISH_PRESSURE,
    NEAREST,
    NEXT,
    PREVIOUS,
    READING,
    START_PRESSURE,
    START_TEMPERATURE,
    VOLUME,
)
from station.scenario import Scenario
from station.simulation import start_run
from station.step import FAR

Floats = NDArray[np.float64]

_LEAST = 0.1
"""No pressure below this is looked for [bar]."""

_HALVINGS = 10
"""A state drawn that none can be in is halfway nearer to the mean; after so many times it is the mean."""


class Estimated(NamedTuple):
    """Tanks as a row of estimates has them, in the order of TANKS; a vehicle that is not there has NaN."""

    mass: Floats  # (4,) [g]
    temperature: Floats  # (4,) [deg C]
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
    `fork_of_belief` knows them.

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
        vehicles[:, 0] = _visitor(scenario, len(vehicles), state, estimated.volume)
        counters[[ARRIVED, NEXT]], counters[CURRENT] = 1, 0
    else:
        counters[[ARRIVED, NEXT]], counters[CURRENT] = 0, -1
    return Fork(state, counters, vehicles, parameters, scenario.plant_faults)


def _visitor(scenario: Scenario, columns: int, state: Floats, volume: float) -> Floats:
    """The vehicle at the dispenser, with a volume [m3], in a table of vehicles: as if it had come now."""
    time, finish = state[CLOCK], scenario.station.vehicle.finish_pressure_bar
    found = np.full(columns, np.nan)
    places = [ARRIVAL, CONNECTED, START_PRESSURE, START_TEMPERATURE, VOLUME, FINISH_PRESSURE, DELIVERED]
    found[places] = time, time, state[P + VEHICLE], state[T + VEHICLE], volume, finish, 0.0
    return found


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


def fork_of_belief(scenario: Scenario, time: float, belief: Belief) -> Fork:
    """The fork of a station at a filter's mean, with the vehicle at the dispenser and none in the queue.

    Parameters
    ----------
    scenario
        Of the station, in the air that it is believed to stand in (`in_air`).
    time
        Of the second that comes next [s].
    belief
        What is believed before it.

    Raises
    ------
    ValueError
        if a tank holds what none could.
    """
    if not _is_possible(belief.state, there=belief.connected):
        raise ValueError(f"pressures must lie between {_LEAST:g} and {PRESSURE_MAX:g} bar")
    run, parameters = start_run(scenario)
    state, counters = belief.state.copy(), run.counters.copy()
    state[CLOCK], state[NEAREST] = time, FAR
    vehicles = np.full((len(run.vehicles), int(belief.connected)), np.nan)
    counters[PREVIOUS] = belief.command
    counters[[ARRIVED, NEXT]], counters[CURRENT] = (1, 0) if belief.connected else (0, -1)
    if belief.connected:
        model_of(scenario.station).refill(state, scenario.station.vehicle.finish_pressure_bar, parameters.plant)
        state[READING], state[READING + 1] = state[P + VEHICLE], state[T + VEHICLE]
        vehicles[:, 0] = _visitor(scenario, len(vehicles), state, belief.volume)
    return Fork(state, counters, vehicles, parameters, scenario.plant_faults)


def _is_possible(state: Floats, *, there: bool) -> bool:
    """Whether every tank of a state has a pressure that one can have; `there`: and the vehicle's."""
    pressures = state[P : P + (len(TANKS) if there else len(BUFFERS))]
    return bool(
        np.isfinite(state[M : M + len(pressures)]).all() and ((pressures >= _LEAST) & (pressures <= PRESSURE_MAX)).all()
    )


def in_air(scenario: Scenario, ambient: float) -> Scenario:
    """A scenario whose station stands in air so much warmer than its file says [K]."""
    station = scenario.station
    thermal = station.thermal
    warmer = thermal.model_copy(update={"ambient_temperature_c": thermal.ambient_temperature_c + ambient})
    return scenario.on(station.model_copy(update={"thermal": warmer}))


def drawn(scenario: Scenario, fork: Fork, spread: Floats, seed: int) -> Callable[[int], Floats]:
    """The state in which each future begins: what is not known of it varies together, as the filter has it.

    Parameters
    ----------
    scenario
        Of the fork.
    fork
        At the mean.
    spread
        Times independent standard normals: what is not known of the state; see `Belief`.
    seed
        Future `k` of a seed is always the same.
    """
    model = model_of(scenario.station)
    there = fork.counters[CURRENT] >= 0
    volume = float(fork.vehicles[VOLUME, fork.counters[CURRENT]]) if there else 0.0

    def state(future: int) -> Floats:
        random = np.random.default_rng([seed, future, len(TANKS)])
        moved = spread @ random.standard_normal(spread.shape[1])
        for _ in range(_HALVINGS):
            found: Floats = fork.state + moved
            model.restate(found, volume, fork.parameters.plant)
            if _is_possible(found, there=bool(there)):
                return found
            moved *= 0.5
        return fork.state

    return state
