"""Valves within a second: the limit on each, the commands there are, and the admissible part of one."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from station.compiled import inlined, merged
from station.geometry import ALL_VALVES, INLETS, OUTLETS, VEHICLE
from station.limits import CODE_BITS, CODE_MASK, Limit, Situation, StateLimit, state_limits
from station.plants.interface import Constants

# Numba reads plain integers faster than members, so these codes stand here once more by value.
_NO_VEHICLE, _BOTH_SIDES = int(Limit.NO_VEHICLE), int(Limit.BOTH_SIDES)
_COMPRESSORS, _DISPENSER = int(Limit.COMPRESSORS), int(Limit.DISPENSER)


def first_forbidding(limits: Iterable[StateLimit]) -> Callable[[Situation, bool, Any, float], int]:
    """A formula that gives the code of the first of `limits` that forbids a valve, or 0.

    Its arguments are the situation, whether the valve is free of limits on closed ones, a plant's constants, and the
    period [s]. It is unrolled where it is compiled: a limit costs its margin alone.
    """
    given = list(limits)
    if not given:
        return merged(lambda _at, _free, _plant, _period: 0)
    margin, code, rest = given[0].margin, int(given[0].limit), first_forbidding(given[1:])
    strict, of_closed = given[0].strict, given[0].of_closed

    @merged
    def first(at: Situation, free: bool, plant: Any, period: float) -> int:
        if not (of_closed and free):
            found = margin(at, plant, period)
            if not (found > 0.0 if strict else found >= 0.0):
                return code
        return rest(at, free, plant, period)

    return first


_first_of_inlet, _first_of_outlet = first_forbidding(state_limits("inlet")), first_forbidding(state_limits("outlet"))


@inlined
def inlet_limit(
    buffer: int,
    pressure: float,
    temperature: float,
    was_open: bool,
    obeys_hold: bool,
    plant: Constants,
    period: float,
) -> int:
    """The limit on a state that forbids this inlet to open, or 0."""
    at = Situation(buffer, pressure, temperature, 0.0, 0.0)
    return _first_of_inlet(at, was_open or not obeys_hold, plant, period)


@inlined
def outlet_limit(
    buffer: int,
    pressure: float,
    temperature: float,
    vehicle_connected: bool,
    vehicle_pressure: float,
    vehicle_temperature: float,
    plant: Constants,
    period: float,
) -> int:
    """The limit on a state that forbids this outlet to open, or 0."""
    if not vehicle_connected:
        return _NO_VEHICLE
    at = Situation(buffer, pressure, temperature, vehicle_pressure, vehicle_temperature)
    return _first_of_outlet(at, True, plant, period)


@inlined
def admitted_valves(
    pressure: tuple[float, float, float, float],
    temperature: tuple[float, float, float, float],
    vehicle_connected: bool,
    previous: int,
    plant: Constants,
    period: float,
) -> int:
    """The valves that no limit on the state forbids a controller bound by Eq. (7.16), as bits of Valve."""
    found = 0
    for buffer in range(3):
        was_open = previous >> buffer & 1 != 0
        if inlet_limit(buffer, pressure[buffer], temperature[buffer], was_open, True, plant, period) == 0:
            found |= 1 << buffer
        if (
            outlet_limit(
                buffer,
                pressure[buffer],
                temperature[buffer],
                vehicle_connected,
                pressure[VEHICLE],
                temperature[VEHICLE],
                plant,
                period,
            )
            == 0
        ):
            found |= 8 << buffer
    return found


@inlined
def barred_valves(timed: tuple[int, int], allowed: int, compressor_count: int) -> int:
    """The valves of which minimum times say that they may not open in this second, as bits of Valve.

    `timed` are those kept open and those kept closed, `allowed` those that no limit forbids: one that a limit closes is
    not kept open. What is kept open bars what may not be open beside it, Eqs (7.17)-(7.19).
    """
    opened = timed[0] & allowed
    barred = timed[1] | (opened & INLETS) << 3 | opened >> 3
    if opened & OUTLETS:
        barred |= OUTLETS & ~opened
    if count_inlets(opened) >= compressor_count:
        barred |= INLETS & ~opened
    return barred


def commands(compressor_count: int) -> list[int]:
    """All commands that Eqs (7.17)-(7.19) admit: 13 with one compressor, 19 with two, 20 from three on."""
    found = []
    for command in range(ALL_VALVES + 1):
        inlets, outlets = command & INLETS, command >> 3
        if inlets & outlets or inlets.bit_count() > compressor_count or outlets.bit_count() > 1:
            continue
        found.append(command)
    return found


class ValveLimits(NamedTuple):
    """Limits of one second: the limit that forbids each valve, or 0."""

    inlet: tuple[int, int, int]
    outlet: tuple[int, int, int]


@inlined
def count_inlets(command: int) -> int:
    """Number of open inlets, which is the number of compressors at work."""
    return (command & 1) + (command >> 1 & 1) + (command >> 2 & 1)


@inlined
def _outlet_beside(kept: int, buffer: int, limit: int) -> int:
    """The limit that forbids an outlet beside the valves in `kept`, or 0."""
    if limit == 0 and kept & (1 << buffer):
        return _BOTH_SIDES
    if limit == 0 and kept & OUTLETS:
        return _DISPENSER
    return limit


@inlined
def _inlet_beside(kept: int, buffer: int, limit: int, compressor_count: int) -> int:
    """The limit that forbids an inlet beside the valves in `kept`, or 0."""
    if limit == 0 and kept & (8 << buffer):
        return _BOTH_SIDES
    if limit == 0 and count_inlets(kept) >= compressor_count:
        return _COMPRESSORS
    return limit


@inlined
def shield(command: int, kept: int, admission: ValveLimits, compressor_count: int) -> tuple[int, int]:
    """The shield: `kept` and what of a command may open beside it, and the limits of the valves refused.

    The limit of valve v stands in CODE_BITS bits of the second number; see `refused_limit`. Outlets come before inlets
    and high before medium before low, so that of two valves that exclude each other the same one stays.
    """
    refusals = 0
    for buffer in range(3):
        bit = 8 << buffer
        if command & bit and not kept & bit:
            limit = _outlet_beside(kept, buffer, admission.outlet[buffer])
            kept |= bit if limit == 0 else 0
            refusals |= limit << (CODE_BITS * (3 + buffer))
    for buffer in range(3):
        bit = 1 << buffer
        if command & bit and not kept & bit:
            limit = _inlet_beside(kept, buffer, admission.inlet[buffer], compressor_count)
            kept |= bit if limit == 0 else 0
            refusals |= limit << (CODE_BITS * buffer)
    return kept, refusals


@inlined
def refused_limit(refusals: int, valve: int) -> int:
    """The limit that refused a valve, or 0, from what `admissible_part` gives."""
    return refusals >> (CODE_BITS * valve) & CODE_MASK


@inlined
def limits_at(
    pressure: tuple[float, float, float, float],
    temperature: tuple[float, float, float, float],
    vehicle_connected: bool,
    previous: int,
    obeys_hold: bool,
    plant: Constants,
    period: float,
) -> ValveLimits:
    """The limit on each valve at these pressures [bar] and temperatures [deg C]."""
    return ValveLimits(
        (
            inlet_limit(0, pressure[0], temperature[0], previous & 1 != 0, obeys_hold, plant, period),
            inlet_limit(1, pressure[1], temperature[1], previous & 2 != 0, obeys_hold, plant, period),
            inlet_limit(2, pressure[2], temperature[2], previous & 4 != 0, obeys_hold, plant, period),
        ),
        (
            outlet_limit(
                0,
                pressure[0],
                temperature[0],
                vehicle_connected,
                pressure[VEHICLE],
                temperature[VEHICLE],
                plant,
                period,
            ),
            outlet_limit(
                1,
                pressure[1],
                temperature[1],
                vehicle_connected,
                pressure[VEHICLE],
                temperature[VEHICLE],
                plant,
                period,
            ),
            outlet_limit(
                2,
                pressure[2],
                temperature[2],
                vehicle_connected,
                pressure[VEHICLE],
                temperature[VEHICLE],
                plant,
                period,
            ),
        ),
    )
