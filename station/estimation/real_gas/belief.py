"""Beliefs of the filter of the faithful plant before a second, and what others read of a state that was moved."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from station.compiled import entry, numba_type, uncounted
from station.estimation.belief import Belief, command_of, root_of
from station.estimation.real_gas.states import AIR, Scratch, move
from station.geometry import KELVIN, VALVES, VEHICLE
from station.parameters import Station
from station.plants.interface import T
from station.plants.real_gas.entries import (
    ENDED,
    HOTTEST,
    INSIDE,
    LONG_SINCE,
    OPEN,
    SINCE,
    TANK_VOLUME,
    RealGasConstants,
    connected_tank,
    connected_visit,
    make_vehicle,
)
from station.plants.real_gas.fill import NOT_ENDED
from station.plants.real_gas.hydrogen import BAR
from station.plants.real_gas.layout import BEFORE
from station.plants.real_gas.plant import derive
from station.plants.real_gas.registration import REAL_GAS

_PLANT = numba_type(REAL_GAS.sample)
_ROW, _TABLE = numba_type(np.zeros(1)), numba_type(np.zeros((1, 1)))


@entry((_ROW, _PLANT))
def _restate(state: np.ndarray, plant: RealGasConstants) -> None:
    derive(state, plant)


@uncounted
def _write_moves(state: np.ndarray, moves: np.ndarray, plant: RealGasConstants) -> None:
    for coordinate in range(moves.shape[0]):
        move(moves[coordinate, INSIDE:], coordinate, 1.0, connected_tank(state), plant.station)


@entry((_ROW, _TABLE, _PLANT))
def _move_each(state: np.ndarray, moves: np.ndarray, plant: RealGasConstants) -> None:
    """Write into each row of `moves` by how much a unit of a coordinate moves the entries of a run's state."""
    _write_moves(state, moves, plant)


def restate(state: NDArray[np.float64], volume: float, constants: RealGasConstants) -> None:  # noqa: ARG001
    """Write what others read of a state; see `EstimationModel`. The vehicle's volume stands in the state."""
    _restate(state, constants)


@entry((_ROW, numba_type(1.0), _PLANT))
def _refill(state: np.ndarray, nominal: float, plant: RealGasConstants) -> None:
    visit = connected_visit(state)
    make_vehicle(state, visit.pressure, visit.temperature, state[TANK_VOLUME], nominal, plant)


def refill(state: NDArray[np.float64], finish_pressure: float, constants: RealGasConstants) -> None:
    """Let ramp and ends of the connected vehicle's fill be those of a station; see `EstimationModel`."""
    _refill(state, finish_pressure * BAR, constants)


def belief_of(s: Scratch, station: Station, constants: RealGasConstants) -> Belief:  # noqa: ARG001
    """The belief before a second; see `EstimationModel`.

    Walls, line and precooler are part of it; for how long valves have been as they are is not.
    """
    connected, state = bool(s.vehicle[0] >= 0.0), s.state.copy()
    state[SINCE : SINCE + len(VALVES)], command = LONG_SINCE, command_of(s.valve)
    state[OPEN], state[ENDED], state[HOTTEST] = command, NOT_ENDED, -np.inf
    restate(state, float(s.volume[0]), constants)
    if connected:  # a filter does not ask how fast the gas warms: as if not at all, for a second
        state[INSIDE + constants.station.rest_at + BEFORE] = state[T + VEHICLE] + KELVIN
    moves = np.zeros((AIR, len(state)))
    _move_each(state, moves, constants)
    spread = np.ascontiguousarray(moves.T @ root_of(s.cov[:AIR, :AIR]))
    return Belief(state, spread, float(s.health[AIR]), connected, float(s.volume[0]), command)
