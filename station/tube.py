"""A tank known by intervals, one second on: what every parameter and error within its half-width can lead to.

A tank is its density, mass by volume [g/m3], and its temperature [deg C]: a reading of both needs no volume. Every
flow is rate * (pressure on the other side - own pressure), an outlet of a buffer among them. The next density rises
with the present one as long as rate * R / M * absolute temperature < 1, which scenarios are checked for, and is affine
in everything else alone: the ends of the next interval are met at ends of the given ones.
"""

from __future__ import annotations

from typing import NamedTuple

from station.compiled import inlined
from station.geometry import KELVIN
from station.plants.thesis import SPECIFIC_GAS

OUTWARD = 1e-12
"""Relative widening of every end and second, for the rounding of double arithmetic."""


class TankInterval(NamedTuple):
    """Between what the density [g/m3] and the temperature [deg C] of a tank lie."""

    low: float
    high: float
    cold: float
    warm: float


class TankInputs(NamedTuple):
    """Intervals of what acts on a tank during a second; low before high."""

    driving_pressure: tuple[float, float]  # pressure on the other side of the open valve [bar]
    rate: tuple[float, float]  # flow coefficient by volume [g/(s bar m3)], 0 where every valve is closed
    heating: tuple[float, float]  # by the open valve [K/s]
    exchange: tuple[float, float]  # c_Tn [1/s]
    ambient: tuple[float, float]  # T_env [deg C]


@inlined
def interval_at(pressure: float, temperature: float, error: float, thermal_error: float) -> TankInterval:
    """Interval of a tank whose readings [bar], [deg C] have errors of at most [bar], [K]."""
    cold, warm = temperature - thermal_error, temperature + thermal_error
    return TankInterval(
        (pressure - error) / (SPECIFIC_GAS * (warm + KELVIN)) * (1.0 - OUTWARD),
        (pressure + error) / (SPECIFIC_GAS * (cold + KELVIN)) * (1.0 + OUTWARD),
        cold - OUTWARD * KELVIN,
        warm + OUTWARD * KELVIN,
    )


@inlined
def pressure_interval(ends: TankInterval) -> tuple[float, float]:
    """Between what the pressure [bar] of a tank lies."""
    return (
        ends.low * SPECIFIC_GAS * (ends.cold + KELVIN) * (1.0 - OUTWARD),
        ends.high * SPECIFIC_GAS * (ends.warm + KELVIN) * (1.0 + OUTWARD),
    )


@inlined
def next_interval(ends: TankInterval, inputs: TankInputs) -> TankInterval:
    """Between what a tank lies a second on, Eqs (7.1)-(7.10)."""
    up = inputs.driving_pressure[1] - ends.high * SPECIFIC_GAS * (ends.cold + KELVIN)
    down = inputs.driving_pressure[0] - ends.low * SPECIFIC_GAS * (ends.warm + KELVIN)
    high = ends.high + up * (inputs.rate[1] if up > 0.0 else inputs.rate[0])
    low = ends.low + down * (inputs.rate[0] if down > 0.0 else inputs.rate[1])
    rise = inputs.ambient[1] - ends.warm
    fall = inputs.ambient[0] - ends.cold
    warm = ends.warm + inputs.heating[1] + rise * (inputs.exchange[1] if rise > 0.0 else inputs.exchange[0])
    cold = ends.cold + inputs.heating[0] + fall * (inputs.exchange[0] if fall > 0.0 else inputs.exchange[1])
    return TankInterval(low * (1.0 - OUTWARD), high * (1.0 + OUTWARD), cold - OUTWARD * KELVIN, warm + OUTWARD * KELVIN)


@inlined
def below(ends: TankInterval, pressure: float) -> TankInterval:
    """Part of a tank's interval that is left when its pressure is known to be at most `pressure` [bar]."""
    most = pressure / (SPECIFIC_GAS * (ends.cold + KELVIN)) * (1.0 + OUTWARD)
    return TankInterval(ends.low, min(ends.high, most), ends.cold, ends.warm)
