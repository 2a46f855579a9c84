"""Walls in cells: layers as data, and one backward Euler step of gas and wall together (a Thomas sweep)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from station.compiled import formula, uncounted
from station.plants.real_gas.leachman import Array

CELLS_PER_LAYER = 4
"""Four cells a layer of a composite are within 0.15 K of converged in a fill, if they grow outward."""

GROWTH = 1.5
"""Each cell of a layer is so much wider than the one inside it: heat comes from the inside."""


class Layer(NamedTuple):
    """A layer of a wall."""

    name: str
    thickness: float  # [m]
    density: float  # [kg/m3]
    heat_capacity: float  # [J/(kg K)]
    conductivity: float  # [W/(m K)]


class Wall(NamedTuple):
    """The cells of a wall from the inside out, as kernels use them, factored for steps of one period."""

    capacity: Array  # [cell]: heat capacity [J/K]
    rate: Array  # [cell]: the capacity in a period [W/K]
    conductance: Array  # [cell]: to the next cell outward; the last to the surroundings [W/K]
    passed: Array  # [cell]: share of a change of the cell before that reaches a cell
    inverse: Array  # [cell]: reciprocal of the diagonal once the cells outside are eliminated [K/W]
    first: float  # diagonal of the first cell without the gas [W/K]
    skin: float  # from the inner surface to the middle of the first cell [K/W]
    area: float  # inner surface [m2]


@formula
def flat_ended_area(diameter: float, length: float) -> float:
    """Inner surface [m2] of a flat-ended cylinder [m]."""
    return math.pi * diameter * length + math.pi * diameter**2 / 2


@uncounted
def build_wall(
    layers: Array, stronger: float, diameter: float, length: float, outer_coefficient: float, period: float,
    cells_per_layer: int, capacity: Array, rate: Array, conductance: Array, passed: Array, inverse: Array,
) -> tuple[float, float, float]:  # fmt: skip
    """Write the cells of a wall (see `Wall`) into arrays of their own; gives `first`, `skin` and `area`.

    A row of `layers` has the fields of `Layer` after its name, and whether it is `stronger` times as thick (1 or 0).
    """
    inner = flat_ended_area(diameter, length)
    growth, face, before, skin, parts = inner / (diameter / 2), diameter / 2, 0.0, 0.0, 0.0
    for part in range(cells_per_layer):
        parts += GROWTH**part
    count = layers.shape[0] * cells_per_layer
    for cell in range(count):
        layer, part = cell // cells_per_layer, cell % cells_per_layer
        width = layers[layer, 0] * (stronger if layers[layer, 4] > 0.0 else 1.0) * GROWTH**part / parts
        middle = face + width / 2
        inside = math.log(middle / face) / (layers[layer, 3] * growth)
        capacity[cell] = layers[layer, 1] * layers[layer, 2] * width * middle * growth
        rate[cell] = capacity[cell] / period
        if cell == 0:
            skin = inside
        else:
            conductance[cell - 1] = 1 / (before + inside)
        face += width
        before = math.log(face / middle) / (layers[layer, 3] * growth)
    film = outer_coefficient * face * growth
    conductance[count - 1] = film / (1 + film * before)
    return _factor(count, rate, conductance, passed, inverse), skin, inner


@uncounted
def _factor(count: int, rate: Array, conductance: Array, passed: Array, inverse: Array) -> float:
    """Eliminate the cells from the outside in, as a Thomas sweep does; the diagonal of the first."""
    beyond = 0.0
    passed[0], inverse[0] = 0.0, 0.0
    for cell in range(count - 1, 0, -1):
        diagonal = rate[cell] + conductance[cell - 1] + conductance[cell] * (1 - beyond)
        inverse[cell] = 1 / diagonal
        beyond = passed[cell] = conductance[cell - 1] / diagonal
    return float(rate[0] + conductance[0] * (1 - beyond))


def layer_rows(layers: list[Layer], growing: int = 0) -> Array:
    """Layers from the inside out as `build_wall` takes them; the last `growing` of them grow with the pressure."""
    still = len(layers) - growing
    return np.array([[*layer[1:], float(place >= still)] for place, layer in enumerate(layers)])


def wall_of(
    layers: list[Layer], diameter: float, length: float, outer_coefficient: float, period: float,
    cells_per_layer: int = CELLS_PER_LAYER,
) -> Wall:  # fmt: skip
    """The wall of a flat-ended cylinder; areas grow with the radius.

    Parameters
    ----------
    layers
        From the inside out.
    diameter, length
        Of the inside [m].
    outer_coefficient
        To the surroundings [W/(m2 K)]; 0 for none.
    period
        Of the steps [s].
    cells_per_layer
        Cells that each layer is cut into, each wider than the one inside it.
    """
    capacity, rate, conductance, passed, inverse = np.zeros((5, len(layers) * cells_per_layer))
    first, skin, area = build_wall(
        layer_rows(layers), 1.0, diameter, length, outer_coefficient, period, cells_per_layer, capacity, rate,
        conductance, passed, inverse,
    )  # fmt: skip
    return Wall(capacity, rate, conductance, passed, inverse, first, skin, area)


@uncounted
def exchange(
    state: np.ndarray, place: int, wall: Wall, kelvin: float, gas_rate: float, inner: float, surroundings: float,
    period: float,
) -> tuple[float, float]:  # fmt: skip
    """Let gas and wall exchange heat for a period, by backward Euler; the cells' temperatures change in place.

    The gas loses exactly what the first cell takes up, so energy is kept whatever `gas_rate` is.

    Parameters
    ----------
    state
        Where the temperatures of the surface and of the cells stand, from `place` on [K].
    place
        Index of the surface's temperature in `state`.
    wall
        The wall's cells, as `build_wall` made them.
    kelvin, gas_rate
        Temperature of the gas [K], and its heat capacity in a period [W/K].
    inner
        Heat transfer at the inner surface, coefficient times area [W/K].
    surroundings
        Temperature outside [K].
    period
        Duration [s].

    Returns
    -------
    tuple of float
        Heat from the gas to the wall and from the wall to the surroundings [J].
    """
    count = wall.rate.shape[0]
    cells = place + 1
    settled = surroundings
    for cell in range(count - 1, 0, -1):
        held = wall.rate[cell] * state[cells + cell] + wall.conductance[cell] * settled
        settled = held * wall.inverse[cell]
        state[cells + cell] = settled
    held = wall.rate[0] * state[cells] + wall.conductance[0] * settled
    if inner > 0.0:
        to_first = 1.0 / (1.0 / inner + wall.skin)
        diagonal = wall.first + to_first
        # the gas' own equation: (gas_rate + to_first) gas - to_first first = gas_rate kelvin
        lead = gas_rate + to_first * (wall.first / diagonal)
        cooled = (gas_rate * kelvin + to_first * held / diagonal) / lead
        before = (held + to_first * cooled) / diagonal
        taken = to_first * (cooled - before)
        state[place] = before + taken * wall.skin
    else:
        before = held / wall.first
        taken = 0.0
        state[place] = before
    state[cells] = before
    for cell in range(1, count):
        before = wall.passed[cell] * before + state[cells + cell]
        state[cells + cell] = before
    return taken * period, wall.conductance[count - 1] * (before - surroundings) * period
