"""The estimate of each constant, by least squares inside its interval, and the model of the plant so identified."""

from __future__ import annotations

from typing import Any

import numpy as np

from controllers.adaptive.memory import (
    CENTRE,
    COUNT,
    ERROR,
    ESTIMATE,
    EXCHANGE,
    FLOW,
    FLOWS,
    HALF,
    HEAT,
    HIGH,
    LOW,
    RATE,
    RATES,
    SHARED,
)
from station.compiled import inlined, kernel
from station.control_model import ControlModel
from station.limit_figures import LimitFigures

_NOWHERE = 1e-30
"""Stands for the variance of a constant that is known."""

# The constants identified stand in a row in a ControlModel. Numba slices by plain globals alone.
_FIRST, _BEHIND = (ControlModel._fields.index(name) for name in ("inlet_coefficient", "ambient_temperature"))
_LIMITS, _FLOW_MAX = ControlModel._fields.index("limits"), LimitFigures._fields.index("dispenser_flow_max")
_AFTER_LIMITS, _AFTER_FLOW_MAX = _LIMITS + 1, _FLOW_MAX + 1


@inlined
def _inside(item: int, value: float, memory: np.ndarray) -> float:
    """An estimate moved into the interval; the station's figure of a constant that is known."""
    if memory[HALF + item] == 0.0:
        return memory[CENTRE + item]
    return min(max(value, memory[LOW + item]), memory[HIGH + item])


@inlined
def _precision(item: int, memory: np.ndarray) -> float:
    """What the station's own figure of a constant counts in its estimate: one by its variance, if uniform."""
    return 1.0 / max(memory[HALF + item] ** 2 / 3.0, _NOWHERE * max(memory[CENTRE + item] ** 2, _NOWHERE))


@kernel
def estimate_constants(memory: np.ndarray) -> None:
    """Solve the normal equations: coefficients one by one, heat rates with the exchange they share."""
    for item in range(FLOWS):
        prior = _precision(item, memory)
        squares, products = memory[FLOW + 2 * item], memory[FLOW + 2 * item + 1]
        value = (products + prior * memory[CENTRE + item]) / (squares + prior)
        memory[ESTIMATE + item] = _inside(item, value, memory)
    variance = memory[ERROR + 1] ** 2 / 3.0
    prior = variance * _precision(EXCHANGE, memory)
    squares, products = memory[SHARED] + prior, memory[SHARED + 1] + prior * memory[CENTRE + EXCHANGE]
    for rate in range(RATES):
        place, own = RATE + 3 * rate, variance * _precision(HEAT + rate, memory)
        both = memory[place + 1] / (memory[place] + own)
        squares -= both * memory[place + 1]
        products -= both * (memory[place + 2] + own * memory[CENTRE + HEAT + rate])
    exchange = _inside(EXCHANGE, products / squares, memory)
    memory[ESTIMATE + EXCHANGE] = exchange
    for rate in range(RATES):
        item, place = HEAT + rate, RATE + 3 * rate
        own = variance * _precision(item, memory)
        value = memory[place + 2] - exchange * memory[place + 1] + own * memory[CENTRE + item]
        memory[ESTIMATE + item] = _inside(item, value / (memory[place] + own), memory)


@kernel
def identified(known: ControlModel, memory: np.ndarray) -> ControlModel:
    """The station of `known` with the constants identified, and its limits as `known` has them.

    Eq. (7.11) is a limit on a flow, but is granted by what is known of it: the same pressure difference. So the
    flow it admits is that difference at the coefficient identified.
    """
    value = memory[ESTIMATE : ESTIMATE + COUNT]
    flow_max = (known.limits.dispenser_flow_max * (value[1] / known.outlet_coefficient),)
    figures: tuple[Any, ...] = known.limits[:_FLOW_MAX] + flow_max + known.limits[_AFTER_FLOW_MAX:]
    limits = (LimitFigures(*figures),)
    heating, cooling = (value[2], value[3], value[4]), (value[5], value[6], value[7])
    found = (value[0], value[1], heating, cooling, value[8], value[9])
    fields: tuple[Any, ...] = known[:_FIRST] + found + known[_BEHIND:_LIMITS] + limits + known[_AFTER_LIMITS:]
    return ControlModel(*fields)
