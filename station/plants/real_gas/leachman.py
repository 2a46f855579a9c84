"""Leachman's Helmholtz equation of normal hydrogen: every property from density and temperature, exactly.

Source: Leachman, Jacobsen, Penoncello, Lemmon, J. Phys. Chem. Ref. Data 38 (2009) 721, 10.1063/1.3160306. Functions
take floats or arrays of one shape and give arrays of it. They are the truth that `tables` samples; no loop calls them.
Valid for the gas from 100 K on (the critical point is at 33 K).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from station.errors import StationError
from station.plants.real_gas.hydrogen import CRITICAL_DENSITY, CRITICAL_TEMPERATURE, IDEAL, RESIDUAL, SPECIFIC_GAS

Array = npt.NDArray[Any]
Values = float | Array

_STEPS = 60
_CLOSE = 1e-13
_VACUUM = 1.0
"""At this pressure [Pa] hydrogen is ideal to 1e-8: it stands for none at all where a ratio to the pressure is asked."""


class Properties(NamedTuple):
    """Properties of hydrogen at given densities and temperatures."""

    pressure: Array  # [Pa]
    internal_energy: Array  # [J/kg]
    enthalpy: Array  # [J/kg]
    entropy: Array  # [J/(kg K)]
    heat_capacity_volume: Array  # cv [J/(kg K)]
    heat_capacity_pressure: Array  # cp [J/(kg K)]
    speed_of_sound: Array  # [m/s]
    pressure_by_density: Array  # dp/drho at constant temperature [J/kg]
    expansion: Array  # -(drho/dT)/rho at constant pressure [1/K]


def _ideal(tau: Array) -> tuple[Array, Array, Array]:
    """alpha0 of Eq. (31) without ln(delta), tau times its first and tau2 times its second derivative by tau."""
    value = IDEAL["log_tau"] * np.log(tau) + IDEAL["constant"] + IDEAL["linear"] * tau
    first = IDEAL["log_tau"] + IDEAL["linear"] * tau
    second = np.full_like(tau, -IDEAL["log_tau"])
    for factor, temperature in zip(IDEAL["coefficient"], IDEAL["temperature_K"], strict=True):
        x = temperature / CRITICAL_TEMPERATURE * tau
        decay = np.exp(-x)
        value = value + factor * np.log1p(-decay)
        first = first + factor * x * decay / (1 - decay)
        second = second - factor * x**2 * decay / (1 - decay) ** 2
    return value, first, second


def _residual(delta: Array, tau: Values) -> tuple[Array, Array, Array, Array, Array, Array]:
    """alpha_r of Eq. (32) and, each times its powers of delta and tau, its derivatives d, dd, t, tt, dt."""
    total = [np.zeros(np.broadcast(delta, tau).shape) for _ in range(6)]
    for n, t, d, p, phi, beta, gamma, place in zip(*RESIDUAL.values(), strict=True):
        term = n * tau**t * delta**d * np.exp(-p * delta + phi * (delta - place) ** 2 + beta * (tau - gamma) ** 2)
        by_delta = d - p * delta + 2 * phi * delta * (delta - place)
        by_tau = t + 2 * beta * tau * (tau - gamma)
        total[0] += term
        total[1] += term * by_delta
        total[2] += term * (by_delta**2 - d + 2 * phi * delta**2)
        total[3] += term * by_tau
        total[4] += term * (by_tau**2 - t + 2 * beta * tau**2)
        total[5] += term * by_delta * by_tau
    return total[0], total[1], total[2], total[3], total[4], total[5]


def properties(density: Values, temperature: Values) -> Properties:
    """Properties at density [kg/m3] and temperature [K], Eqs (31)-(32)."""
    rho, kelvin = np.broadcast_arrays(np.asarray(density, float), np.asarray(temperature, float))
    delta, tau = rho / CRITICAL_DENSITY, CRITICAL_TEMPERATURE / kelvin
    ideal, ideal_t, ideal_tt = _ideal(tau)
    rest, r_d, r_dd, r_t, r_tt, r_dt = _residual(delta, tau)
    compressibility = 1 + r_d
    energy = ideal_t + r_t
    isochoric = -(ideal_tt + r_tt)
    stiffness = 1 + 2 * r_d + r_dd
    by_temperature = 1 + r_d - r_dt
    isobaric = isochoric + by_temperature**2 / stiffness
    heat = SPECIFIC_GAS * kelvin
    return Properties(
        pressure=rho * heat * compressibility,
        internal_energy=heat * energy,
        enthalpy=heat * (energy + compressibility),
        entropy=SPECIFIC_GAS * (energy - ideal - rest - np.log(delta)),
        heat_capacity_volume=SPECIFIC_GAS * isochoric,
        heat_capacity_pressure=SPECIFIC_GAS * isobaric,
        speed_of_sound=np.sqrt(heat * stiffness * isobaric / isochoric),
        pressure_by_density=heat * stiffness,
        expansion=by_temperature / stiffness / kelvin,
    )


def pressure(density: Values, temperature: float) -> Array:
    """Pressure [Pa] at densities [kg/m3] and one temperature [K], Eq. (31): that of `properties`, for less work."""
    rho = np.asarray(density, float)
    _, by_delta, *_ = _residual(rho / CRITICAL_DENSITY, np.float64(CRITICAL_TEMPERATURE / temperature))
    return np.asarray(rho * (SPECIFIC_GAS * temperature) * (1 + by_delta))


def density(pressure: Values, temperature: Values) -> Array:
    """Density [kg/m3] at pressure [Pa] and temperature [K], by Newton's method from the ideal gas with a covolume.

    Raises
    ------
    StationError
        if it does not converge, as where there is no such gas.
    """
    p, kelvin = np.broadcast_arrays(np.maximum(np.asarray(pressure, float), _VACUUM), np.asarray(temperature, float))
    rho = p / (SPECIFIC_GAS * kelvin + 7.7e-3 * p)
    for _ in range(_STEPS):
        found = properties(rho, kelvin)
        step = (p - found.pressure) / found.pressure_by_density
        rho = rho + step
        if np.all(np.abs(step) <= _CLOSE * rho):
            return np.asarray(rho)
    raise StationError("the density of hydrogen was not found: pressure and temperature must be those of a gas")


def _temperature(
    density: Values, wanted: Values, guess: Values, step: Callable[[Properties, Array, Array], Array], what: str
) -> Array:
    """Temperature [K] at density [kg/m3] and another quantity, called `what`; `step` is Newton's [K]."""
    rho, target = np.broadcast_arrays(np.asarray(density, float), np.asarray(wanted, float))
    kelvin = np.broadcast_to(np.asarray(guess, float), rho.shape)
    for _ in range(_STEPS):
        change = step(properties(rho, kelvin), target, kelvin)
        kelvin = kelvin + change
        if np.all(np.abs(change) <= 10 * _CLOSE * kelvin):
            return np.asarray(kelvin)
    raise StationError(f"the temperature of hydrogen was not found: density and {what} must be those of a gas")


def temperature_of_energy(density: Values, energy: Values, guess: Values = 300.0) -> Array:
    """Temperature [K] at density [kg/m3] and specific internal energy [J/kg], by Newton's method.

    Raises
    ------
    StationError
        if it does not converge.
    """

    def step(found: Properties, target: Array, kelvin: Array) -> Array:
        return np.clip((target - found.internal_energy) / found.heat_capacity_volume, -0.5 * kelvin, kelvin)

    return _temperature(density, energy, guess, step, "energy")


def temperature_of_entropy(density: Values, entropy: Values, guess: Values) -> Array:
    """Temperature [K] at density [kg/m3] and specific entropy [J/(kg K)], by Newton's method.

    Raises
    ------
    StationError
        if it does not converge.
    """

    def step(found: Properties, target: Array, kelvin: Array) -> Array:
        return kelvin * np.expm1(np.clip((target - found.entropy) / found.heat_capacity_volume, -1, 1))

    return _temperature(density, entropy, guess, step, "entropy")


def isentropic_enthalpy(pressure: Values, entropy: Values) -> Array:
    """Enthalpy [J/kg] at pressures [Pa] and entropies [J/(kg K)], by Newton's method in ln(T).

    Raises
    ------
    StationError
        if it does not converge.
    """
    p, s = np.broadcast_arrays(np.asarray(pressure, float), np.asarray(entropy, float))
    kelvin = np.full(p.shape, 300.0)
    for _ in range(_STEPS):
        found = properties(density(p, kelvin), kelvin)
        step = kelvin * np.expm1(np.clip((s - found.entropy) / found.heat_capacity_pressure, -0.5, 0.5))
        kelvin = kelvin + step
        if np.all(np.abs(step) <= 10 * _CLOSE * kelvin):
            return np.asarray(found.enthalpy + found.heat_capacity_pressure * step)
    raise StationError("an isentrope of hydrogen was not found: pressure and entropy must be those of a gas")


def choked_flux(pressure: Values, temperature: Values) -> tuple[Array, Array]:
    """Choked mass flux [kg/(m2 s)] out of a stagnation state, and the ratio of throat to stagnation pressure.

    Isentropic and adiabatic to where the velocity is that of sound: h + c2 / 2 = h0, s = s0.

    Raises
    ------
    StationError
        if it does not converge.
    """
    p, stagnation = np.broadcast_arrays(
        np.maximum(np.asarray(pressure, float), _VACUUM), np.asarray(temperature, float)
    )
    before = properties(density(p, stagnation), stagnation)
    low, kelvin = 0.63 * density(p, stagnation), 0.83 * stagnation
    last_rho, last_miss = low, np.full(p.shape, np.nan)
    rho = low * 1.02
    for _ in range(_STEPS):
        kelvin = temperature_of_entropy(rho, before.entropy, kelvin)
        found = properties(rho, kelvin)
        miss = found.enthalpy + found.speed_of_sound**2 / 2 - before.enthalpy
        with np.errstate(invalid="ignore", divide="ignore"):
            slope = (miss - last_miss) / (rho - last_rho)
        usual = found.speed_of_sound**2 / rho * 1.3  # of an ideal gas, about
        step = -miss / np.where(np.isfinite(slope) & (slope > 0), slope, usual)
        last_rho, last_miss = rho, miss
        if np.all(np.abs(step) <= 1e-10 * rho):
            return rho * found.speed_of_sound, found.pressure / p
        rho = np.clip(rho + step, 0.7 * rho, 1.4 * rho)
    raise StationError("the choked flux of hydrogen was not found: pressure and temperature must be those of a gas")
