"""The limits of a station, Eqs (7.11)-(7.19): every limit once, with its code, name, words, equation and margin.

`LIMITS` is the registry. A limit on the state is a margin: the valve may open while the margin is not negative. Margins
take numbers or symbols, so that the solver models state the same limits; the other limits are on commands. The shield
(`station.valves`) is made of the registry when it is compiled; margins for uncertainty, solver models and proofs of
service go through it, and fail by name where they do not cover a limit (`check_covered`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple

from station.compiled import formula, merged
from station.errors import UncoveredLimitError
from station.geometry import KELVIN
from station.plants.interface import (
    Constants,
    Number,
    emptied_to,
    filled_to,
    outlet_flow,
    vehicle_temperature,
    warmed,
)


class Limit(IntEnum):
    """Reasons that forbid a valve to open."""

    NONE = 0
    FLOW = 1  # Eq. (7.11): the dispenser's flow limit
    GAP = 2  # Eq. (7.12): too little pressure above the vehicle
    VEHICLE_TEMPERATURE = 3  # Eq. (7.13)
    NO_VEHICLE = 4  # Eq. (7.14)
    BUFFER_TEMPERATURE = 5  # Eq. (7.15)
    HOLD = 6  # Eq. (7.16): above 800 bar a closed inlet stays closed
    BOTH_SIDES = 7  # Eq. (7.17): inlet and outlet of one buffer
    COMPRESSORS = 8  # Eq. (7.18): more inlets than compressors
    DISPENSER = 9  # Eq. (7.19): more than one outlet
    COMPRESSOR_PRESSURE = 10  # the buffer is not below the compressor's pressure, or the greatest of its own
    LEAST_PRESSURE = 11  # the buffer is not above its least pressure
    LEAST_TEMPERATURE = 12  # nor above its least temperature
    MINIMUM_TIME = 13  # the valve has not been closed for its minimum time
    BEGIN = 14  # no other buffer could begin the fill of the emptiest vehicle that may come; see `station.starts`


CODE_BITS = 4
"""Bits of a limit's code among the refusals that `shield` gives."""

CODE_MASK = (1 << CODE_BITS) - 1


@formula
def flow_margin(pressure: Number, vehicle_pressure: Number, plant: Constants) -> Number:
    """Eq. (7.11) [g/s]."""
    return plant.limits.dispenser_flow_max - outlet_flow(pressure, vehicle_pressure, plant)


@formula
def gap_margin(pressure: Number, vehicle_pressure: Number, plant: Constants) -> Number:
    """Eq. (7.12) [bar]."""
    return pressure - vehicle_pressure - plant.limits.outlet_gap_min


@formula
def start_limit(plant: Constants) -> float:
    """Pressure of a buffer from which even an empty vehicle can just be given gas, Eq. (7.11) [bar]."""
    return plant.limits.dispenser_flow_max / plant.outlet_coefficient


@formula
def vehicle_temperature_margin(temperature: Number, plant: Constants, period: float) -> Number:
    """Eq. (7.13) [K], of the vehicle after `period` seconds of filling."""
    return plant.limits.vehicle_temperature_max - vehicle_temperature(temperature, 1, plant, period)


@formula
def buffer_temperature_margin(
    buffer: int, pressure: Number, temperature: Number, plant: Constants, period: float
) -> Number:
    """Eq. (7.15) [K], of a buffer after `period` seconds of filling."""
    return plant.limits.buffer_temperature_max - warmed(buffer, pressure, temperature, plant, period)


@formula
def compressor_margin(buffer: int, pressure: Number, plant: Constants) -> Number:
    """How far a buffer lies below the pressure to which it is filled [bar]; must be positive."""
    return filled_to(buffer, plant) - pressure


@formula
def least_pressure_margin(buffer: int, pressure: Number, plant: Constants) -> Number:
    """How far a buffer lies above the pressure to which it may be emptied [bar]."""
    return pressure - emptied_to(buffer, plant)


@formula
def least_temperature_margin(temperature: Number, plant: Constants) -> Number:
    """How far a buffer lies above the temperature to which it may be cooled by what flows out of it [K]."""
    return temperature - plant.limits.buffer_temperature_min


@formula
def hold_margin(pressure: Number, plant: Constants) -> Number:
    """Eq. (7.16) for an inlet that was closed [bar]."""
    return plant.limits.hold_pressure - pressure


class Situation(NamedTuple):
    """Quantities from which the margin of a valve is computed."""

    buffer: int  # whose valve it is
    pressure: Number  # of the buffer [bar]
    temperature: Number  # of the buffer [deg C]
    vehicle_pressure: Number  # [bar]; of an outlet alone
    vehicle_temperature: Number  # [deg C]; likewise


@merged
def _flow(at: Situation, plant: Constants, _period: float) -> Number:
    return flow_margin(at.pressure, at.vehicle_pressure, plant)


@merged
def _gap(at: Situation, plant: Constants, _period: float) -> Number:
    return gap_margin(at.pressure, at.vehicle_pressure, plant)


@merged
def _vehicle_temperature(at: Situation, plant: Constants, period: float) -> Number:
    return vehicle_temperature_margin(at.vehicle_temperature, plant, period)


@merged
def _buffer_temperature(at: Situation, plant: Constants, period: float) -> Number:
    return buffer_temperature_margin(at.buffer, at.pressure, at.temperature, plant, period)


@merged
def _hold(at: Situation, plant: Constants, _period: float) -> Number:
    return hold_margin(at.pressure, plant)


@merged
def _compressor(at: Situation, plant: Constants, _period: float) -> Number:
    return compressor_margin(at.buffer, at.pressure, plant)


@merged
def _least_pressure(at: Situation, plant: Constants, _period: float) -> Number:
    return least_pressure_margin(at.buffer, at.pressure, plant)


@merged
def _least_temperature(at: Situation, plant: Constants, _period: float) -> Number:
    return least_temperature_margin(at.temperature, plant)


def _always(_plant: Any) -> bool:
    return True


class Figure(NamedTuple):
    """The figure of a station that a limit is, and the sign with which a larger margin moves it."""

    part: str
    field: str
    sign: int


@dataclass(frozen=True)
class StateLimit:
    """A limit on the state: it forbids a valve to open while its margin is negative.

    A limit without `errors` and `figure` cannot be kept where sensors err: `station.margins` refuses it by name.
    """

    limit: Limit
    name: str  # of its margin
    equation: str  # its number in the thesis; a word for it, where it has none
    unit: str
    side: str  # the valves it is about: "inlet" or "outlet"
    margin: Callable[[Situation, Any, Any], Number]  # of the situation, a plant's constants, and the period [s]
    title: str  # what people call it
    says: str  # why a valve is refused, as a sentence without its full stop
    strict: bool = False  # forbids a margin of 0, too
    of_closed: bool = False  # binds valves that were closed, of controllers that obey the hold
    binds: Callable[[Any], bool] = _always  # whether it can bind at a plant with these constants
    errors: tuple[str, ...] = ()  # parameters and readings the margin depends on; `{buffer}` stands for the valve's
    figure: Figure | None = None


@dataclass(frozen=True)
class CommandLimit:
    """A limit on commands, or on whether a vehicle is connected, whatever the state."""

    limit: Limit
    equation: str
    title: str
    says: str


_HEAT = ("heat_exchange", "ambient_temperature", "temperature")

LIMITS: tuple[StateLimit | CommandLimit, ...] = (
    StateLimit(
        Limit.COMPRESSOR_PRESSURE, "compressor", "p < p_com", "bar", "inlet", _compressor, strict=True,
        title="compressor pressure", says="the buffer is not below the compressor's pressure",
        errors=("compressor_pressure", "pressure"), figure=Figure("compressor", "pressure_bar", -1),
    ),
    StateLimit(
        Limit.HOLD, "hold", "7.16", "bar", "inlet", _hold, of_closed=True,
        title="hold pressure", says="above the hold pressure a closed inlet stays closed",
        errors=("pressure",), figure=Figure("compressor", "hold_pressure_bar", -1),
        binds=lambda plant: plant.limits.hold_pressure < math.inf,
    ),
    StateLimit(
        Limit.BUFFER_TEMPERATURE, "buffer_temperature", "7.15", "K", "inlet", _buffer_temperature,
        title="buffer heat", says="the buffer would become too warm",
        errors=("inlet_heating {buffer}", *_HEAT), figure=Figure("thermal", "buffer_temperature_max_c", -1),
    ),
    CommandLimit(Limit.NO_VEHICLE, "7.14", title="no vehicle", says="no vehicle is connected"),
    StateLimit(
        Limit.GAP, "gap", "7.12", "bar", "outlet", _gap,
        title="outlet gap", says="too little pressure above the vehicle",
        errors=("pressure", "vehicle pressure"), figure=Figure("dispenser", "outlet_gap_min_bar", 1),
    ),
    StateLimit(
        Limit.FLOW, "flow", "7.11", "g/s", "outlet", _flow,
        title="dispenser flow", says="the dispenser's flow limit would be exceeded",
        errors=("outlet_coefficient", "pressure", "vehicle pressure"),
        figure=Figure("dispenser", "flow_max_g_per_s", -1),
        binds=lambda plant: plant.limits.dispenser_flow_max < math.inf,
    ),
    StateLimit(
        Limit.VEHICLE_TEMPERATURE, "vehicle_temperature", "7.13", "K", "outlet", _vehicle_temperature,
        title="vehicle heat", says="the vehicle's tank would become too warm",
        errors=("vehicle_heating", *_HEAT), figure=Figure("vehicle", "temperature_max_c", -1),
    ),
    StateLimit(
        Limit.LEAST_PRESSURE, "least_pressure", "least pressure", "bar", "outlet", _least_pressure,
        title="least pressure", says="the bank is below its least pressure",
        binds=lambda plant: any(emptied_to(buffer, plant) > 0.0 for buffer in range(3)),
    ),
    StateLimit(
        Limit.LEAST_TEMPERATURE, "least_temperature", "least temperature", "K", "outlet", _least_temperature,
        title="least temperature", says="the bank is below its least temperature",
        binds=lambda plant: plant.limits.buffer_temperature_min > -KELVIN,
    ),
    CommandLimit(
        Limit.MINIMUM_TIME, "minimum time",
        title="minimum time", says="the valve has not been closed for its minimum time",
    ),
    CommandLimit(
        Limit.BEGIN, "begin of a fill",
        title="begin of a fill", says="no other buffer could begin the fill of an empty vehicle",
    ),
    CommandLimit(
        Limit.BOTH_SIDES, "7.17",
        title="in and out", says="inlet and outlet of one buffer exclude each other",
    ),
    CommandLimit(Limit.COMPRESSORS, "7.18", title="compressors", says="every compressor is in use"),
    CommandLimit(Limit.DISPENSER, "7.19", title="outlet in use", says="another outlet is open"),
)  # fmt: skip
"""Every limit, in the order in which the shield asks: the first that forbids a valve is the one that is named."""


def thesis_equation(limit: StateLimit | CommandLimit) -> str | None:
    """The number of the thesis's equation that a limit is, as `7.12`; None for one that the thesis does not have."""
    return limit.equation if limit.equation[:1].isdigit() else None


def state_limits(side: str = "", plant: Any = None) -> list[StateLimit]:
    """The limits on the state, of inlets, of outlets, or all, in the order of the registry.

    With a plant's constants those that can bind there.
    """
    found = [limit for limit in LIMITS if isinstance(limit, StateLimit) and side in ("", limit.side)]
    return found if plant is None else [limit for limit in found if limit.binds(plant)]


def check_covered(by: str, names: Iterable[str], plant: Any = None) -> None:
    """Check that `by` covers every limit on the state that can bind at a plant with these constants.

    `names` are the margins it covers.

    Raises
    ------
    UncoveredLimitError
        naming the first it does not cover.
    """
    known = set(names)
    for limit in state_limits(plant=plant):
        if limit.name not in known:
            raise UncoveredLimitError(by, limit.name)


def check_codes(limits: Iterable[StateLimit | CommandLimit]) -> None:
    """Check that limits have codes of their own that fit into CODE_BITS.

    Raises
    ------
    ValueError
        naming the limit whose code is too large, or another's.
    """
    taken = {int(Limit.NONE)}
    for limit in limits:
        code = int(limit.limit)
        if code in taken or code > CODE_MASK:
            raise ValueError(f"limit {limit.limit.name}: code {code} is another's, or needs more than {CODE_BITS} bits")
        taken.add(code)


check_codes(LIMITS)
