"""The vehicles of a day as arrays: tanks of any class, and what ends each fill."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from station.compiled import uncounted
from station.plants.real_gas.fill import Ends, FillStart
from station.plants.real_gas.leachman import Array
from station.plants.real_gas.tank import Tank
from station.plants.real_gas.wall import Wall


class Visit(NamedTuple):
    """A vehicle's fill: how it comes, its ramp and what ends it."""

    pressure: float  # at the start [Pa]
    temperature: float  # of gas and wall at the start [K]
    ramp: float  # [Pa/s]
    mass: float  # that ends it [kg]; infinite for none
    pressure_max: float  # [Pa]
    temperature_max: float  # of the gas [K]


def visit_of(start: FillStart, ramp: float, ends: Ends) -> Visit:
    """The visit of a vehicle whose tank comes as `start`, at a ramp [Pa/s], to what ends its fill."""
    return Visit(start.pressure, start.temperature, ramp, ends.mass, ends.pressure, ends.temperature)


class Vehicles(NamedTuple):
    """The vehicles of a day as kernels use them, one row each: tanks (see `Tank`, `Wall`) and visits (see `Visit`)."""

    volume: Array
    forced: Array
    free: Array
    fixed: Array
    capacity: Array
    rate: Array
    conductance: Array
    passed: Array
    inverse: Array
    first: Array
    skin: Array
    area: Array
    visit: Array  # [vehicle, field of Visit]


def vehicles_of(tanks: list[Tank], visits: list[Visit]) -> Vehicles:
    """Vehicles of tanks and visits; the walls must have as many cells.

    Raises
    ------
    ValueError
        if they have not, or there is no vehicle.
    """
    cells = {len(tank.wall.capacity) for tank in tanks}
    if len(cells) != 1 or len(tanks) != len(visits):
        raise ValueError(f"vehicles need tanks with as many cells, and a visit each; given {sorted(cells)}")
    own = [np.array(column) for column in zip(*(tank[:4] for tank in tanks), strict=True)]
    walls = [np.ascontiguousarray(np.array(column)) for column in zip(*(tank.wall for tank in tanks), strict=True)]
    return Vehicles._make([*own, *walls, np.array(visits, float)])


@uncounted
def tank_at(vehicles: Vehicles, index: int) -> Tank:
    """The tank of a vehicle. Only uncounted kernels may call it: it gives arrays back uncounted."""
    wall = Wall(
        vehicles.capacity[index], vehicles.rate[index], vehicles.conductance[index], vehicles.passed[index],
        vehicles.inverse[index], vehicles.first[index], vehicles.skin[index], vehicles.area[index],
    )  # fmt: skip
    return Tank(vehicles.volume[index], vehicles.forced[index], vehicles.free[index], vehicles.fixed[index], wall)


@uncounted
def visit_at(vehicles: Vehicles, index: int) -> Visit:
    """The visit of a vehicle."""
    row = vehicles.visit
    return Visit(
        row[index, 0], row[index, 1], row[index, 2], row[index, 3], row[index, 4], row[index, 5]
    )  # fmt: skip
