"""Lookups in the tables of hydrogen: what kernels call. Two grids, a cubic B-spline on each."""

from __future__ import annotations

import math

from station.compiled import inlined, uncounted
from station.plants.real_gas.tables import ENTHALPY, FLUX, FORCED, FREE, PRESSURE_PER_DENSITY, RATIO, GasTables

_NEWTON_STEPS = 4

_CLOSE = 1e-6
"""Behind a step of Newton's method as short as this nothing is left to find, since errors are squared [K]."""


@inlined
def _weights(t: float) -> tuple[float, float, float, float]:
    """Values of the four B-splines that reach a place `t` of the way from one node to the next."""
    s = 1.0 - t
    return (
        s * s * s / 6.0,
        (t * t * (3.0 * t - 6.0) + 4.0) / 6.0,
        (s * s * (3.0 * s - 6.0) + 4.0) / 6.0,
        t * t * t / 6.0,
    )


@inlined
def _slopes(t: float) -> tuple[float, float, float, float]:
    """Derivatives of the four B-splines by the place."""
    s = 1.0 - t
    return -0.5 * s * s, t * (1.5 * t - 2.0), -s * (1.5 * s - 2.0), 0.5 * t * t


@inlined
def _cell(place: float, count: int) -> int:
    """The cell of a grid in which a place lies; the outermost go on beyond their edges."""
    return min(max(int(place), 0), count - 4)


@uncounted
def state(rho: float, u: float, gas: GasTables) -> tuple[float, float]:
    """Pressure [Pa] and temperature [K] at density [kg/m3] and specific internal energy [J/kg]."""
    grid = gas.by_energy
    x, y = rho * gas.density_scale, (u - gas.energy_first) * gas.energy_scale
    i, j = _cell(x, grid.shape[0]), _cell(y, grid.shape[1])
    a, b = _weights(x - i), _weights(y - j)
    ratio, temperature = 0.0, 0.0
    for k in range(4):
        row = i + k
        ratio += a[k] * (
            b[0] * grid[row, j, 0]
            + b[1] * grid[row, j + 1, 0]
            + b[2] * grid[row, j + 2, 0]
            + b[3] * grid[row, j + 3, 0]
        )
        temperature += a[k] * (
            b[0] * grid[row, j, 1]
            + b[1] * grid[row, j + 1, 1]
            + b[2] * grid[row, j + 2, 1]
            + b[3] * grid[row, j + 3, 1]
        )
    return rho * ratio, temperature


@uncounted
def state_and_slopes(rho: float, u: float, gas: GasTables) -> tuple[float, float, float, float, float]:
    """Pressure [Pa], temperature [K], dp/drho at constant u [J/kg], dp/du at constant rho [kg/m3], cv [J/(kg K)]."""
    grid = gas.by_energy
    x, y = rho * gas.density_scale, (u - gas.energy_first) * gas.energy_scale
    i, j = _cell(x, grid.shape[0]), _cell(y, grid.shape[1])
    a, b = _weights(x - i), _weights(y - j)
    da, db = _slopes(x - i), _slopes(y - j)
    ratio, by_rho, by_u, temperature, warming = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(4):
        row = i + k
        q0, q1, q2, q3 = grid[row, j, 0], grid[row, j + 1, 0], grid[row, j + 2, 0], grid[row, j + 3, 0]
        t0, t1, t2, t3 = grid[row, j, 1], grid[row, j + 1, 1], grid[row, j + 2, 1], grid[row, j + 3, 1]
        along = b[0] * q0 + b[1] * q1 + b[2] * q2 + b[3] * q3
        ratio += a[k] * along
        by_rho += da[k] * along
        by_u += a[k] * (db[0] * q0 + db[1] * q1 + db[2] * q2 + db[3] * q3)
        temperature += a[k] * (b[0] * t0 + b[1] * t1 + b[2] * t2 + b[3] * t3)
        warming += a[k] * (db[0] * t0 + db[1] * t1 + db[2] * t2 + db[3] * t3)
    return (
        rho * ratio,
        temperature,
        ratio + rho * by_rho * gas.density_scale,
        rho * by_u * gas.energy_scale,
        1.0 / (warming * gas.energy_scale),
    )


@uncounted
def state_and_warmth(rho: float, u: float, gas: GasTables) -> tuple[float, float, float]:
    """Pressure [Pa], temperature [K] and cv [J/(kg K)] as `state_and_slopes` has them, to the bit."""
    grid = gas.by_energy
    x, y = rho * gas.density_scale, (u - gas.energy_first) * gas.energy_scale
    i, j = _cell(x, grid.shape[0]), _cell(y, grid.shape[1])
    a, b, db = _weights(x - i), _weights(y - j), _slopes(y - j)
    ratio, temperature, warming = 0.0, 0.0, 0.0
    for k in range(4):
        row = i + k
        q0, q1, q2, q3 = grid[row, j, 0], grid[row, j + 1, 0], grid[row, j + 2, 0], grid[row, j + 3, 0]
        t0, t1, t2, t3 = grid[row, j, 1], grid[row, j + 1, 1], grid[row, j + 2, 1], grid[row, j + 3, 1]
        ratio += a[k] * (b[0] * q0 + b[1] * q1 + b[2] * q2 + b[3] * q3)
        temperature += a[k] * (b[0] * t0 + b[1] * t1 + b[2] * t2 + b[3] * t3)
        warming += a[k] * (db[0] * t0 + db[1] * t1 + db[2] * t2 + db[3] * t3)
    return rho * ratio, temperature, 1.0 / (warming * gas.energy_scale)


@inlined
def _two(p: float, kelvin: float, first: int, second: int, gas: GasTables) -> tuple[float, float]:
    """Two entries of the grid over pressure and temperature."""
    grid = gas.by_pressure
    x, y = p * gas.pressure_scale, (kelvin - gas.temperature_first) * gas.temperature_scale
    i, j = _cell(x, grid.shape[0]), _cell(y, grid.shape[1])
    a, b = _weights(x - i), _weights(y - j)
    one, other = 0.0, 0.0
    for k in range(4):
        for n in range(4):
            weight = a[k] * b[n]
            one += weight * grid[i + k, j + n, first]
            other += weight * grid[i + k, j + n, second]
    return one, other


@uncounted
def enthalpy(p: float, kelvin: float, gas: GasTables) -> float:
    """Specific enthalpy [J/kg] at pressure [Pa] and temperature [K]."""
    return _two(p, kelvin, ENTHALPY, ENTHALPY, gas)[0]


@uncounted
def _enthalpy_and_slope(p: float, kelvin: float, gas: GasTables) -> tuple[float, float]:
    """Specific enthalpy [J/kg] and its slope by temperature [J/(kg K)]."""
    grid = gas.by_pressure
    x, y = p * gas.pressure_scale, (kelvin - gas.temperature_first) * gas.temperature_scale
    i, j = _cell(x, grid.shape[0]), _cell(y, grid.shape[1])
    a, b, db = _weights(x - i), _weights(y - j), _slopes(y - j)
    h, slope = 0.0, 0.0
    for k in range(4):
        for n in range(4):
            at_node = a[k] * grid[i + k, j + n, ENTHALPY]
            h += b[n] * at_node
            slope += db[n] * at_node
    return h, slope * gas.temperature_scale


@uncounted
def density_and_enthalpy(p: float, kelvin: float, gas: GasTables) -> tuple[float, float]:
    """Density [kg/m3] and specific enthalpy [J/kg] at pressure [Pa] and temperature [K]."""
    ratio, h = _two(p, kelvin, PRESSURE_PER_DENSITY, ENTHALPY, gas)
    return p / ratio, h


@uncounted
def choked(p: float, kelvin: float, gas: GasTables) -> tuple[float, float]:
    """Choked mass flux [kg/(m2 s)] out of a stagnation state, and the critical ratio of pressures."""
    flux, ratio = _two(p, kelvin, FLUX, RATIO, gas)
    return p * flux, ratio


@uncounted
def film(p: float, kelvin: float, gas: GasTables) -> tuple[float, float]:
    """Of the film: k mu^-0.67 and k (g beta rho2 cp / (mu k))^0.352 / p^0.704, which make the inner coefficient."""
    return _two(p, kelvin, FORCED, FREE, gas)


@uncounted
def temperature_of_enthalpy(p: float, h: float, guess: float, gas: GasTables) -> float:
    """Temperature [K] at pressure [Pa] and specific enthalpy [J/kg], from a guess by Newton's method."""
    kelvin = guess
    for _ in range(_NEWTON_STEPS):
        here, slope = _enthalpy_and_slope(p, kelvin, gas)
        step = (h - here) / slope
        kelvin += step
        if abs(step) < _CLOSE:
            break
    return kelvin


@uncounted
def pressure_at(rho: float, kelvin: float, guess: float, gas: GasTables) -> float:
    """Pressure [Pa] at density [kg/m3] and temperature [K], from a guess of the internal energy [J/kg]."""
    u = guess
    for _ in range(_NEWTON_STEPS):
        _, temperature, cv = state_and_warmth(rho, u, gas)
        u += cv * (kelvin - temperature)
    return state(rho, u, gas)[0]


@uncounted
def energy_of(p: float, kelvin: float, volume: float, gas: GasTables) -> tuple[float, float]:
    """Mass [kg] and internal energy [J] of a volume [m3] at pressure [Pa] and temperature [K].

    Newton's method on the grid over density and energy, so that `state` gives back what was asked for.
    """
    rho, h = density_and_enthalpy(p, kelvin, gas)
    u = h - p / rho
    for _ in range(_NEWTON_STEPS):
        pressure, temperature, by_rho, by_u, cv = state_and_slopes(rho, u, gas)
        eps = 1e-4 * rho
        t_rho = (state(rho + eps, u, gas)[1] - temperature) / eps
        t_u = 1.0 / cv
        miss_p, miss_t = p - pressure, kelvin - temperature
        determinant = by_rho * t_u - by_u * t_rho
        rho += (miss_p * t_u - by_u * miss_t) / determinant
        u += (by_rho * miss_t - t_rho * miss_p) / determinant
    return rho * volume, rho * volume * u


@uncounted
def is_within(p: float, kelvin: float, low: float, high: float, top: float) -> bool:
    """Whether a state lies where the tables hold; false for what is no number."""
    return bool(kelvin >= low and kelvin <= high and p > 0.0 and p <= top and math.isfinite(p))
