"""Coordinates and working arrays of the filter of the faithful plant, and the estimates that it gives.

The mean is a run's state of the plant with every cell of every wall; the covariance is of the coordinates below, in
which a wall has one node, or two where it has layers: the cells of a node move together.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from station.compiled import uncounted
from station.estimation.drifting import drifts_of_nothing
from station.estimation.interface import SHARED_STATES
from station.estimation.jumps import jumps_of_nothing
from station.estimation.noise import usual_noise
from station.estimation.put_right import PUT
from station.estimation.resting import runs_of_nothing
from station.estimation.sudden import DOUBT
from station.geometry import BUFFERS
from station.plants.interface import OWN
from station.plants.real_gas.entries import INSIDE, OWN_ENTRIES
from station.plants.real_gas.layout import AIM, BANKS, LINE_ENERGY, LINE_MASS, RealGasStation
from station.plants.real_gas.tank import CELLS, ENERGY, MASS, SURFACE, Tank
from station.plants.real_gas.wall import CELLS_PER_LAYER
from station.sensor_names import ANALOG, SENSORS

BANK_MASS, BANK_ENERGY, BANK_WALL = 0, BANKS, 2 * BANKS
"""Where masses [kg], energies [J] and walls [K] of the banks begin among the coordinates."""

VEHICLE_MASS, VEHICLE_ENERGY, LINER, SHELL, PACK, PACK_ENERGY, RAMP_AIM, AIR = range(3 * BANKS, 3 * BANKS + 8)
"""Of the vehicle; mass and energy of the line [kg], [J]; the pressure that the ramp aims at [Pa]; deviation of the
surroundings [K]."""

PLANT_STATES = AIR + 1
"""Coordinates of the stiff filter; the others are the robust form's."""

LEAKS, COMPRESSOR, DISPENSER, WARMER = PLANT_STATES, PLANT_STATES + BANKS, PLANT_STATES + BANKS + 1, PLANT_STATES + 5
"""Leaks [g/s], what is left of the compressor's displacement and of the outlets' area [1], a precooler's fault [K]."""

N = WARMER + 1

DRIFT = 1.1
"""A pressure sensor drifts that is off by so much [bar]: healthy ones of calibrated stations are by less."""

BIASED = N + BANKS
"""Of the form for sensors that drift: what pressures are off [bar] takes the leaks' places, thermometers' comes behind
N [K]."""

STATES = {
    **dict.fromkeys(SHARED_STATES, ""),
    **{f"mass_{each}": "g" for each in (*BUFFERS, "vehicle")},
    **{f"temperature_{each}": "degC" for each in (*BUFFERS, "vehicle")},
    **{f"leak_{each}": "g/s" for each in BUFFERS},
    "ambient_deviation": "K",
    "precooler_deviation": "K",
    **{f"temperature_wall_{each}": "degC" for each in (*BUFFERS, "vehicle")},
}
"""Estimates and their units; the wall of the vehicle is its liner."""

INSIDE_SIZE = OWN + OWN_ENTRIES - INSIDE


class Scratch(NamedTuple):
    """The filter and its working arrays; all float64."""

    state: np.ndarray  # (OWN + OWN_ENTRIES,) a run's state: the mean of what is the plant's own
    health: np.ndarray  # (BIASED,) the mean of the coordinates from AIR on
    cov: np.ndarray  # (BIASED, BIASED)
    half: np.ndarray  # (BIASED, BIASED)
    transition: np.ndarray  # (BIASED, BIASED) slopes of a second
    delta: np.ndarray  # (BIASED,) what readings have changed
    column: np.ndarray  # (BIASED,)
    flow: np.ndarray  # (2,) of the compressors and to the vehicle [g/s]
    flow_slopes: np.ndarray  # (2, BIASED)
    following: np.ndarray  # (INSIDE_SIZE,) the plant's own state a second on
    varied: np.ndarray  # (INSIDE_SIZE,)
    gas: np.ndarray  # (4, 8) of each tank's gas, see `look_at`
    volume: np.ndarray  # (1,) of the vehicle's tank [m3]
    valve: np.ndarray  # (6,) 1: open, as last known
    unseen: np.ndarray  # (6,) above 0: nobody told, and nothing says it; its square is how likely it is not as before
    moving: np.ndarray  # (6,) how often it moves in a second [1]
    vehicle: np.ndarray  # (1,) the vehicle connected, as last known; -1: none
    low: np.ndarray  # (1,) seconds in a row in which less flows than is expected
    unread: np.ndarray  # (1,) 1: its pressure was not read yet
    blind: np.ndarray  # (BANKS + 1,) seconds in a row in which nobody told what a tank gave and was given
    anew: np.ndarray  # (BANKS,) 1: begun anew in this second
    runs: np.ndarray  # (len(ANALOG), ENTRIES) of `station.estimation.resting`
    heard: np.ndarray  # (len(SENSORS),) a second's readings, but those of sensors that are stuck
    tag_noise: np.ndarray  # (len(ANALOG),) a second's noise by tags and steps
    loud: np.ndarray  # (len(ANALOG), ENTRIES) of `station.estimation.noise`
    noise: np.ndarray  # (len(ANALOG),) a second's noise as the filter takes it
    relative: np.ndarray  # (len(ANALOG),) and its relative part
    doubt: np.ndarray  # (DOUBT,) of `station.estimation.sudden`
    put: np.ndarray  # (2, PUT) of `station.estimation.put_right`
    drifts: np.ndarray  # (len(BANK_SENSORS) + 1, ENTRIES) of `station.estimation.drifting`
    jumps: np.ndarray  # (len(ANALOG), JUMP) of `station.estimation.jumps`
    behind: np.ndarray  # (4,) of `station.estimation.thermometers` [K]
    before: np.ndarray  # (4,) temperatures of the tanks once a second's readings were used [K]
    given: np.ndarray  # (1,) what the meter read last of a vehicle's fill [g/s]; below 0: nothing yet
    share: np.ndarray  # (1,) what the compressors' meter read last of an open inlet [g/s]; 0: nothing yet


def scratch() -> Scratch:
    """All of it 0, and no vehicle."""
    n = BIASED
    return Scratch(
        np.zeros(OWN + OWN_ENTRIES), np.zeros(n), np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n)), np.zeros(n),
        np.zeros(n), np.zeros(2), np.zeros((2, n)), np.zeros(INSIDE_SIZE), np.zeros(INSIDE_SIZE), np.zeros((4, 8)),
        np.zeros(1), np.zeros(6), np.zeros(6), np.zeros(6), np.full(1, -1.0), np.zeros(1), np.zeros(1),
        np.zeros(BANKS + 1), np.zeros(BANKS), runs_of_nothing(len(ANALOG)), np.zeros(len(SENSORS)),
        np.zeros(len(ANALOG)), usual_noise(len(ANALOG)), np.zeros(len(ANALOG)), np.zeros(len(ANALOG)),
        np.zeros(DOUBT), np.zeros((2, PUT)), drifts_of_nothing(DRIFT), jumps_of_nothing(), np.zeros(4),
        np.zeros(4), np.full(1, -1.0), np.zeros(1),
    )  # fmt: skip


@uncounted
def tank_place(tank: int, station: RealGasStation) -> int:
    """Place where a tank begins in the plant's own state; 3 is the vehicle's."""
    return tank * station.stride if tank < BANKS else station.vehicle_at


@uncounted
def _move_cells(inside: np.ndarray, place: int, first: int, last: int, by: float) -> None:
    for cell in range(first, last):
        inside[place + CELLS + cell] += by


@uncounted
def _move_visit(inside: np.ndarray, coordinate: int, by: float, vehicle: Tank, station: RealGasStation) -> None:
    """Change a coordinate of the vehicle or the line."""
    at, tail, cells = station.vehicle_at, station.rest_at, vehicle.wall.capacity.shape[0]
    if coordinate == LINER:
        inside[at + SURFACE] += by
        _move_cells(inside, at, 0, min(cells, CELLS_PER_LAYER), by)
    elif coordinate == SHELL:
        _move_cells(inside, at, CELLS_PER_LAYER, cells, by)
    elif coordinate < LINER:
        inside[at + (MASS if coordinate == VEHICLE_MASS else ENERGY)] += by
    elif coordinate == PACK:
        inside[tail + LINE_MASS] += by
    else:
        inside[tail + (LINE_ENERGY if coordinate == PACK_ENERGY else AIM)] += by


@uncounted
def move(inside: np.ndarray, coordinate: int, by: float, vehicle: Tank, station: RealGasStation) -> None:
    """Change a coordinate of the plant's own state."""
    bank = coordinate % BANKS * station.stride
    if coordinate < BANK_ENERGY:
        inside[bank + MASS] += by
    elif coordinate < BANK_WALL:
        inside[bank + ENERGY] += by
    elif coordinate < VEHICLE_MASS:
        inside[bank + SURFACE] += by
        inside[bank + CELLS] += by
    else:
        _move_visit(inside, coordinate, by, vehicle, station)


@uncounted
def _mean_cell(inside: np.ndarray, place: int, first: int, last: int, vehicle: Tank) -> float:
    """Temperature of some cells of the vehicle's wall by their heat capacities; 0 for none [K]."""
    total, weight = 0.0, 0.0
    for cell in range(first, last):
        total += vehicle.wall.capacity[cell] * inside[place + CELLS + cell]
        weight += vehicle.wall.capacity[cell]
    return total / weight if weight > 0.0 else 0.0


@uncounted
def coordinate_of(inside: np.ndarray, coordinate: int, vehicle: Tank, station: RealGasStation) -> float:
    """A coordinate of the plant's own state."""
    at, tail, cells = station.vehicle_at, station.rest_at, vehicle.wall.capacity.shape[0]
    if coordinate < BANK_ENERGY:
        return inside[coordinate * station.stride + MASS]
    if coordinate < BANK_WALL:
        return inside[(coordinate - BANK_ENERGY) * station.stride + ENERGY]
    if coordinate < VEHICLE_MASS:
        return inside[(coordinate - BANK_WALL) * station.stride + CELLS]
    if coordinate == VEHICLE_MASS:
        return inside[at + MASS]
    if coordinate == VEHICLE_ENERGY:
        return inside[at + ENERGY]
    if coordinate == LINER:
        return _mean_cell(inside, at, 0, min(cells, CELLS_PER_LAYER), vehicle)
    if coordinate == SHELL:
        return _mean_cell(inside, at, CELLS_PER_LAYER, cells, vehicle)
    if coordinate == PACK:
        return inside[tail + LINE_MASS]
    return inside[tail + LINE_ENERGY] if coordinate == PACK_ENERGY else inside[tail + AIM]
