"""A measured case beside the model: root mean square and largest differences of gas temperature and pressure."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from station.errors import InputError
from station.plants.real_gas.cases import Case, OrificeCase
from station.plants.real_gas.hydrogen import BAR
from station.plants.real_gas.leachman import Array, choked_flux
from station.plants.real_gas.replay import Replay, named_area, period_of, replay

_MPA = 1e6
_GOLDEN = (5**0.5 - 1) / 2
_DECADES = 2.0
_SCAN = 21
_FINE = 5e-5  # of the logarithm


class Difference(NamedTuple):
    """The model less what was measured."""

    rms: float
    largest: float


class Measured(NamedTuple):
    """A measured quantity at the times that are compared."""

    name: str
    time: Array  # [s]
    value: Array


class Comparison(NamedTuple):
    """A case beside the model."""

    case: Case
    model: Replay
    gas: Measured | None  # [K]
    gas_difference: Difference | None  # [K]
    pressure_difference: Difference | None  # [bar]
    area: float | None  # effective area that was fitted to the pressure [m2]


def measured_gas(case: Case) -> Measured | None:
    """The temperature of the gas as measured [K]: the mean, else that of low and high, else the one that is there."""
    series = {name: given for name, given in case.measured.items() if name.startswith("gas_") and name.endswith("_K")}
    mean = "gas_mean_temperature_K"
    if mean in series:
        return Measured(mean, np.array(series[mean].time_s), np.array(series[mean].value))
    low, high = series.get("gas_low_temperature_K"), series.get("gas_high_temperature_K")
    if low and high:
        first, last = max(low.time_s[0], high.time_s[0]), min(low.time_s[-1], high.time_s[-1])
        time = np.union1d(low.time_s, high.time_s)
        time = time[(time >= first) & (time <= last)]
        return Measured("mean of low and high", time, (low.at(time) + high.at(time)) / 2)
    for name, given in series.items():
        return Measured(name, np.array(given.time_s), np.array(given.value))
    return None


def _difference(case: Case, model: Replay, of: Measured, computed: Array) -> Difference | None:
    """The model less the measurement, up to where it may be compared; None without a point."""
    until = min(case.compare_until_s or np.inf, model.time[-1])
    kept = (of.time >= 0) & (of.time <= until + 1e-9)
    if not kept.any():
        return None
    gap = np.interp(of.time[kept], model.time, computed) - of.value[kept]
    return Difference(float(np.sqrt(np.mean(gap**2))), float(np.abs(gap).max()))


def _pressure_difference(case: Case, model: Replay) -> Difference | None:
    """Of the pressure [bar]."""
    if "pressure_MPa" not in case.measured:
        return None
    given = case.measured["pressure_MPa"]
    of = Measured("pressure", np.array(given.time_s), np.array(given.value) * 10)
    return _difference(case, model, of, model.pressure / BAR)


def fitted_area(case: Case, source: str) -> float:
    """The effective area [m2] with which the pressure is met best: the best of a scan, then a golden section about it.

    Both go by the logarithm, over a hundredth to a hundredfold of the area named, or of a square millimetre.
    """
    usual, period = named_area(case), 4 * period_of(case)

    def miss(exponent: float) -> float:
        try:
            found = _pressure_difference(case, replay(case, source, usual * 10**exponent, period))
        except InputError:  # so large an area that the gas leaves what the model holds for
            return np.inf
        return np.inf if found is None else found.rms

    tried = np.linspace(-_DECADES, _DECADES, _SCAN)
    best = tried[int(np.argmin([miss(float(exponent)) for exponent in tried]))]
    step = float(tried[1] - tried[0])
    return float(usual * 10 ** _golden_section(miss, float(best) - step, float(best) + step))


def _golden_section(miss: Callable[[float], float], low: float, high: float) -> float:
    """Where a function is least between two places."""
    inner = [high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)]
    value = [miss(inner[0]), miss(inner[1])]
    while high - low > _FINE:
        if value[0] < value[1]:
            high, inner[1], value[1] = inner[1], inner[0], value[0]
            inner[0] = high - _GOLDEN * (high - low)
            value[0] = miss(inner[0])
        else:
            low, inner[0], value[0] = inner[0], inner[1], value[1]
            inner[1] = low + _GOLDEN * (high - low)
            value[1] = miss(inner[1])
    return (low + high) / 2


def compare_case(case: Case, source: str) -> Comparison:
    """Run a case and compare it; an area that was not published is fitted to the pressure first.

    Raises
    ------
    InputError
        if the gas leaves the pressures and temperatures that the model holds for.
    """
    area = None
    if case.area_is_unpublished and "pressure_MPa" in case.measured:
        area = fitted_area(case, source)
    model = replay(case, source, area)
    gas = measured_gas(case)
    difference = _difference(case, model, gas, model.temperature) if gas else None
    return Comparison(case, model, gas, difference, _pressure_difference(case, model), area)


def implied_coefficients(case: OrificeCase) -> Array:
    """Discharge coefficients that measured choked flows imply, one a point."""
    points = case.points
    flux, _ = choked_flux(np.array(points.pressure_MPa) * _MPA, np.array(points.temperature_K))
    area = np.pi / 4 * case.orifice_diameter_m**2
    return np.array(points.mass_flow_g_s) * 1e-3 / (flux * area)
