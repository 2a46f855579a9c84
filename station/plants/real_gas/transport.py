"""Viscosity and thermal conductivity of normal hydrogen from density and temperature."""

from __future__ import annotations

import numpy as np

from station.plants.real_gas.hydrogen import CRITICAL_TEMPERATURE, HYDROGEN, MOLAR_MASS
from station.plants.real_gas.leachman import Array, Values

_VISCOSITY = HYDROGEN["viscosity"]
_CONDUCTIVITY = HYDROGEN["conductivity"]
_AVOGADRO = 6.02214076e23


def viscosity(density: Values, temperature: Values) -> Array:
    """Viscosity [Pa s] at density [kg/m3] and temperature [K]; Muzny et al. 2013, 10.1021/je301273j."""
    rho, kelvin = np.asarray(density, float), np.asarray(temperature, float)
    reduced = kelvin / _VISCOSITY["energy_K"]
    length = _VISCOSITY["length_nm"]
    integral = np.exp(np.polynomial.polynomial.polyval(np.log(reduced), _VISCOSITY["dilute"]))
    dilute = 0.021357 * np.sqrt(MOLAR_MASS * 1e3 * kelvin) / (length**2 * integral)
    second = np.polynomial.polynomial.polyval(1 / reduced, _VISCOSITY["initial"])
    initial = second * (length * 1e-9) ** 3 * _AVOGADRO * rho / MOLAR_MASS
    scaled, tau = rho / _VISCOSITY["reference_density_kg_m3"], kelvin / CRITICAL_TEMPERATURE
    c = _VISCOSITY["rest"]
    exponent = c[1] * tau + c[2] / tau + c[3] * scaled**2 / (c[4] + tau) + c[5] * scaled**6
    return np.asarray((dilute * (1 + initial) + c[0] * scaled**2 * np.exp(exponent)) * 1e-6)


def conductivity(density: Values, temperature: Values) -> Array:
    """Thermal conductivity [W/(m K)]; Assael et al. 2011, 10.1063/1.3606499, no critical enhancement."""
    rho, tau = np.asarray(density, float), np.asarray(temperature, float) / CRITICAL_TEMPERATURE
    polyval = np.polynomial.polynomial.polyval
    dilute = polyval(tau, _CONDUCTIVITY["dilute_above"]) / polyval(tau, _CONDUCTIVITY["dilute_below"])
    scaled = rho / _CONDUCTIVITY["reference_density_kg_m3"]
    residual = polyval(scaled, [0.0, *_CONDUCTIVITY["residual"]])
    warmer = polyval(scaled, [0.0, *_CONDUCTIVITY["residual_temperature"]])
    return np.asarray(dilute + residual + tau * warmer)
