"""Tables of hydrogen for loops: uniform cubic B-splines over (density, energy) and (pressure, temperature).

They are made from Leachman's equation when they are first asked for, in some 0.2 s, and never stored, so never stale.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from station.plants.real_gas.leachman import (
    Array,
    choked_flux,
    density,
    properties,
    temperature_of_energy,
)
from station.plants.real_gas.transport import conductivity, viscosity

TEMPERATURE_MIN = 120.0
"""The tables hold from here on [K]."""

TEMPERATURE_MAX = 520.0
"""They hold up to here [K]."""

PRESSURE_MAX = 110e6
"""They hold from a vacuum up to here [Pa]."""

_MARGIN = 10.0
"""The grid over (pressure, temperature) reaches so far beyond the temperatures that hold [K]."""

_ENERGY_NODES = (48, 64)
_PRESSURE_NODES = (64, 64)

FORCED_EXPONENT = 0.67
"""Of the Reynolds number of the inlet in the correlation of the inner side; Woodfield et al. 2008."""

FREE_EXPONENT = 0.352
"""Of the Rayleigh number in the correlation of the inner side; Woodfield et al. 2008."""

ENTHALPY, PRESSURE_PER_DENSITY, FLUX, RATIO, FORCED, FREE = range(6)
"""What stands in `GasTables.by_pressure`, in this order."""


class GasTables(NamedTuple):
    """B-spline coefficients and grids; a grid has one coefficient more than nodes at either end of each side."""

    by_energy: Array  # [density, energy, (p / rho [J/kg], T [K])]
    energy_first: float  # u of the first node [J/kg]
    energy_scale: float  # nodes per J/kg
    density_scale: float  # nodes per kg/m3; the first is 0
    by_pressure: Array  # [pressure, temperature, what]
    temperature_first: float  # of the first node [K]
    temperature_scale: float  # nodes per K
    pressure_scale: float  # nodes per Pa; the first is 0
    density_max: float  # the tables hold up to here [kg/m3]


def spline_coefficients(values: Array, axis: int) -> Array:
    """Coefficients of the cubic B-spline through values at uniform nodes along an axis, not-a-knot at its ends.

    `values` has n nodes along `axis`, the result n + 2: node i lies between coefficients i and i + 2.
    """
    rows = np.moveaxis(values, axis, 0)
    count = len(rows)
    system = np.zeros((count + 2, count + 2))
    for node in range(count):
        system[node + 1, node : node + 3] = 1 / 6, 4 / 6, 1 / 6
    system[0, :5] = system[-1, -5:] = 1, -4, 6, -4, 1  # the third derivative is one on both sides of a node
    wanted = np.zeros((count + 2, *rows.shape[1:]))
    wanted[1:-1] = rows
    found = np.linalg.solve(system, wanted.reshape(count + 2, -1)).reshape(wanted.shape)
    return np.moveaxis(found, 0, axis)


def _by_energy(density_max: float) -> tuple[Array, float, float, float]:
    """P / rho and T over (density, energy): coefficients, first energy, nodes per energy and per density."""
    rho = np.linspace(0, density_max, _ENERGY_NODES[0])
    rho[0] = 1e-9
    edge = properties(rho, np.array([[TEMPERATURE_MIN], [TEMPERATURE_MAX]])).internal_energy
    u = np.linspace(edge[0].min(), edge[1].max(), _ENERGY_NODES[1])
    kelvin = temperature_of_energy(rho[:, None], u)
    pressure = properties(rho[:, None], kelvin).pressure
    values = np.stack([pressure / rho[:, None], kelvin], axis=-1)
    both = spline_coefficients(spline_coefficients(values, 0), 1)
    return both, float(u[0]), float(1 / (u[1] - u[0])), float(1 / (rho[2] - rho[1]))


def _by_pressure() -> tuple[Array, float, float, float]:
    """Six properties over (pressure, temperature): coefficients, first temperature, nodes per kelvin and per pascal."""
    pressure = np.linspace(0, PRESSURE_MAX, _PRESSURE_NODES[0])[:, None]
    kelvin = np.linspace(TEMPERATURE_MIN - _MARGIN, TEMPERATURE_MAX + _MARGIN, _PRESSURE_NODES[1])
    rho = density(pressure, kelvin)
    found = properties(rho, kelvin)
    flux, ratio = choked_flux(pressure, kelvin)
    eta, conducted = viscosity(rho, kelvin), conductivity(rho, kelvin)
    spread = 9.80665 * found.expansion * found.heat_capacity_pressure / (eta * conducted)
    values = np.stack(
        [
            found.enthalpy,
            found.pressure / rho,
            flux / found.pressure,
            ratio,
            conducted * eta**-FORCED_EXPONENT,
            conducted * spread**FREE_EXPONENT * (rho / found.pressure) ** (2 * FREE_EXPONENT),
        ],
        axis=-1,
    )
    both = spline_coefficients(spline_coefficients(values, 0), 1)
    return both, float(kelvin[0]), float(1 / (kelvin[1] - kelvin[0])), float(1 / pressure[1, 0])


@cache
def gas_tables() -> GasTables:
    """The tables, made once in a process."""
    density_max = float(density(PRESSURE_MAX, TEMPERATURE_MIN))
    by_energy, energy_first, energy_scale, density_scale = _by_energy(density_max)
    by_pressure, temperature_first, temperature_scale, pressure_scale = _by_pressure()
    return GasTables(
        np.ascontiguousarray(by_energy), energy_first, energy_scale, density_scale,
        np.ascontiguousarray(by_pressure), temperature_first, temperature_scale, pressure_scale, density_max,
    )  # fmt: skip
