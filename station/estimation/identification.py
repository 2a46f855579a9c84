"""The control model of a station by least squares: what makes its predictions of recorded days best.

Two forms. `THESIS` has what Eqs (7.1)-(7.10) have; its driving pressure is given. `REAL_GAS` has a covolume, a driving
pressure of its own, and a vehicle warmed by the energy of its gas; its ramp and nozzle are the station's. Volumes of
buffers and limits are taken from the station in both.

The errors weighed are those of `prediction.residuals`, pressures and temperatures of tanks minutes ahead, so that what
is fitted is what a plan asks of the model; the start is a regression on differences of a second.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from station.control_model import ControlModel, gas_pressure
from station.estimation.prediction import BUFFER_HORIZONS, VEHICLE_HORIZONS, Day, residuals
from station.geometry import VEHICLE

Floats = NDArray[np.float64]

COVOLUME = 7.69e-6
"""b of hydrogen, where the search begins [m3/g]."""

DELIVERED, CONDUCTANCE = 340.0, 40.0
"""Where the search for the vehicle's energy begins [K], [g/(s m3)]: gas of -30 degC warms by the ratio of heat
capacities when it is pressed into a tank."""

PRESSURE_SCALE, TEMPERATURE_SCALE = 10.0, 10.0
"""Errors that count alike [bar], [K]: a plan asks for pressures, temperatures keep the heat rates apart."""

OVERSHOOT = 0.5
"""An outlet's coefficient is at most what moves this share of a difference in a second: steps are explicit."""

DRIVING_PRESSURE_MAX = 20_000.0
"""A driving pressure above is a flow that does not fall [bar]."""

_LEAST, _MOST = 1e-3, 1e3
"""A figure is looked for between these multiples of where the search begins."""

_TINY = 1e-6
"""Stands for a figure that regression finds not to be positive, in its own unit."""


class Form(StrEnum):
    """The equations of a control model."""

    THESIS = "thesis"
    REAL_GAS = "real-gas"


class _Unknown(NamedTuple):
    """The figures that are looked for; those of the other form are held."""

    middle_flow: float  # of the compressor at the middle pressure [g/s]; with p0 it gives the coefficient
    driving_pressure: float
    outlet_coefficient: float
    inlet_heating: tuple[float, float, float]
    outlet_cooling: tuple[float, float, float]
    heat_exchange: float
    vehicle_heating: float
    covolume: float
    delivered_temperature: float
    wall_conductance: float


_ONLY = {
    Form.THESIS: {"vehicle_heating"},
    Form.REAL_GAS: {"driving_pressure", "covolume", "delivered_temperature", "wall_conductance"},
}


def _inlet_line(days: Sequence[Day]) -> tuple[float, float, float]:
    """A compressor's flow over pressure: where it vanishes [bar], at the middle pressure [g/s], that pressure [bar]."""
    flows, sums, counts = [], [], []
    for day in days:
        opened = np.array([day.command >> buffer & 1 for buffer in range(3)])
        filling = opened.sum(axis=0) > 0
        counts.append(opened.sum(axis=0)[filling])
        sums.append((opened * day.pressure[:VEHICLE]).sum(axis=0)[filling])
        flows.append(day.flow[0][filling])
    count, total, flow = np.concatenate(counts), np.concatenate(sums), np.concatenate(flows)
    known = np.isfinite(flow)
    count, total, flow = count[known], total[known], flow[known]
    if flow.size < 2:
        raise ValueError("the compressor must run in the days that a model is identified from")
    middle = float(total.sum() / count.sum())
    level, slope = np.linalg.lstsq(np.stack((count, total - middle * count), axis=1), flow, rcond=None)[0]
    return middle + float(level) / max(-float(slope), _TINY), float(level), middle


def _heat_rates(days: Sequence[Day], model: ControlModel) -> Floats:
    """Rates while each inlet and each outlet is open [K/s], of high, medium and low, and the exchange [1/s]: (7,).

    The model's own of a valve that never opens.
    """
    normal, right = np.zeros((7, 7)), np.zeros(7)
    for day in days:
        for buffer in range(3):
            rows = np.zeros((7, day.command.size - 1))
            rows[buffer] = (day.command >> buffer & 1)[:-1]
            rows[3 + buffer] = -(day.command >> (3 + buffer) & 1)[:-1]
            rows[6] = model.ambient_temperature - day.temperature[buffer, :-1]
            normal += rows @ rows.T
            right += rows @ np.diff(day.temperature[buffer])
    found = np.linalg.lstsq(normal, right, rcond=None)[0]
    own = np.array([*model.inlet_heating, *model.outlet_cooling, model.heat_exchange])
    return np.maximum(np.where(np.diag(normal) > 0.0, found, own), _TINY)


def _outlet_start(days: Sequence[Day]) -> float:
    """Flow a bar of difference where it is greatest, so that no cap holds it down [g/(s bar)]."""
    found = []
    for day in days:
        for buffer in range(3):
            giving = (day.command >> 3 == 1 << buffer) & (day.vehicle >= 0)
            gap = (day.pressure[buffer] - day.pressure[VEHICLE])[giving]
            flow = day.flow[1][giving]
            found.append((flow / gap)[(gap > 1.0) & np.isfinite(flow)])
    ratio = np.concatenate(found)
    if ratio.size == 0:
        raise ValueError("vehicles must be filled in the days that a model is identified from")
    return float(np.quantile(ratio, 0.9))


def _stable(days: Sequence[Day], model: ControlModel) -> float:
    """The outlet coefficient that OVERSHOOT allows at the smallest tanks of the days [g/(s bar)]."""
    volume = min(float(day.volume[day.volume > 0.0].min(initial=math.inf)) for day in days)
    a_gram = gas_pressure(1.0, model.limits.vehicle_temperature_max, volume, model._replace(covolume=0.0))
    a_gram += gas_pressure(
        1.0, model.limits.buffer_temperature_max, min(model.buffer_volume), model._replace(covolume=0.0)
    )
    return OVERSHOOT / float(a_gram)


def _begin(days: Sequence[Day], model: ControlModel) -> tuple[_Unknown, float]:
    """Where the search begins, and the middle pressure [bar]."""
    vanishes, level, middle = _inlet_line(days)
    least, most = _driving_range(model)
    high_in, medium_in, low_in, high_out, medium_out, low_out, exchange = _heat_rates(days, model)
    return _Unknown(
        middle_flow=level,
        driving_pressure=min(max(vanishes, 1.1 * least), 0.5 * most),
        outlet_coefficient=_outlet_start(days),
        inlet_heating=(high_in, medium_in, low_in),
        outlet_cooling=(high_out, medium_out, low_out),
        heat_exchange=exchange,
        vehicle_heating=max(model.vehicle_heating, _TINY),
        covolume=COVOLUME,
        delivered_temperature=DELIVERED,
        wall_conductance=CONDUCTANCE,
    ), middle


def _packed(unknown: _Unknown, form: Form) -> tuple[list[str], Floats]:
    """Names, one a figure, and the figures that a form looks for."""
    held = set().union(*(_ONLY[other] for other in Form if other != form))
    names: list[str] = []
    figures: list[float] = []
    for name, value in unknown._asdict().items():
        if name not in held:
            each = value if isinstance(value, tuple) else (value,)
            names += [name] * len(each)
            figures += each
    return names, np.array(figures)


def _driving_range(model: ControlModel) -> tuple[float, float]:
    """Between what a driving pressure lies [bar]."""
    return model.compressor_pressure - min(model.unfilled), DRIVING_PRESSURE_MAX


def _model(names: list[str], figures: Floats, model: ControlModel, middle: float) -> ControlModel:
    """`model` with these figures."""
    found: dict[str, list[float]] = {}
    for name, figure in zip(names, figures, strict=True):
        found.setdefault(name, []).append(float(figure))
    changes: dict[str, Any] = {name: each[0] if len(each) == 1 else tuple(each) for name, each in found.items()}
    flow, driving = changes.pop("middle_flow"), changes.get("driving_pressure", model.driving_pressure)
    return model._replace(inlet_coefficient=flow / (driving - middle), **changes)


def identify(days: Sequence[Day], model: ControlModel, form: Form) -> ControlModel:
    """The model of a form that predicts days best; what the form holds is that of `model`.

    Raises
    ------
    ValueError
        if the compressor never runs in the days, or no vehicle is filled.
    """
    base = model
    if form == Form.THESIS:
        base = model._replace(
            covolume=0.0, nozzle_flow=math.inf, ramp=math.inf, delivered_temperature=0.0, wall_conductance=0.0
        )
    unknown, middle = _begin(days, model)
    names, begin = _packed(unknown, form)
    bounds = np.outer((_LEAST, _MOST), begin)
    if "driving_pressure" in names:
        bounds[:, names.index("driving_pressure")] = _driving_range(base)
    place = names.index("outlet_coefficient")
    bounds[1, place] = max(_stable(days, base), 1.01 * begin[place])

    def errors(multiples: Floats) -> Floats:
        candidate = _model(names, begin * multiples, base, middle)
        return np.concatenate([_weighed(day, candidate) for day in days])

    found = least_squares(
        errors, np.ones(begin.size), bounds=tuple(bounds / begin), x_scale="jac", xtol=1e-7, ftol=1e-8
    )
    return _model(names, begin * found.x, base, middle)


def _weighed(day: Day, model: ControlModel) -> Floats:
    """The errors of a day that count: each horizon alike, and buffers as much as the vehicle."""
    found = residuals(day, model)
    scale = np.array([PRESSURE_SCALE, TEMPERATURE_SCALE])
    buffers, vehicle = found.buffers / scale[:, None], found.vehicle / scale
    parts = []
    for errors, horizons in ((buffers, BUFFER_HORIZONS), (vehicle, VEHICLE_HORIZONS)):
        for place, horizon in enumerate(horizons):
            there = np.where(np.isfinite(errors[:, place]), errors[:, place], 0.0)
            parts.append(there.ravel() * math.sqrt(horizons[-1] / horizon / max(there.size, 1)))
    return np.concatenate(parts)
