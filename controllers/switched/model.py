"""A block of a plan: what one valve does to the station in some seconds, whatever the valves beside it do.

Under one command the buffers do not feel each other: a buffer is filled, rests, or gives to the vehicle. So a block is
computed once for each of these parts, and a command's effect is put together from them. The equations are those of
`station.control_model` with a longer period, the limits those of `station.limits`: a valve they forbid is closed for a
step.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from station.compiled import inlined
from station.planning import (
    Model,
    closing,
    effort,
    gas_mass,
    gas_pressure,
    inlet_flow,
    most_dispensed,
    stiffness,
    vehicle_temperature,
)
from station.plants.thesis import buffer_temperature, next_mass, outlet_flow
from station.valves import inlet_limit, outlet_limit


class Prices(NamedTuple):
    """Cost of a plan, in seconds of compressor."""

    dispensing: float  # of a second with an outlet open
    occupancy: float  # of a second with a vehicle connected
    waiting: float  # of a second in which somebody waits
    start: float  # of a valve that opens
    gas: float  # of a second of compressor that is missing while somebody waits


class Demand(NamedTuple):
    """The vehicles a plan reckons with, all of one kind but the one connected."""

    volume: float  # of the vehicle connected [m3]
    finish: float  # pressure at which it leaves [bar]
    next_volume: float  # of those to come [m3]
    next_finish: float  # [bar]
    next_pressure: float  # at which they arrive [bar]
    next_temperature: float  # [deg C]


class Vehicle(NamedTuple):
    """The dispenser's side of a plan's state."""

    mass: float  # [g]
    temperature: float  # [deg C]
    connected: bool
    started: int  # vehicles connected since the plan began


class Tank(NamedTuple):
    """A buffer in a plan's state."""

    mass: float  # [g]
    temperature: float  # [deg C]


@inlined
def vehicle_tank(vehicle: Vehicle, demand: Demand) -> tuple[float, float]:
    """Volume [m3] and finish pressure [bar] of the vehicle at the dispenser."""
    if vehicle.started == 0:
        return demand.volume, demand.finish
    return demand.next_volume, demand.next_finish


@inlined
def _mean(shrink: float, period: float) -> float:
    """Mean of a difference over `period` one-second steps, each of which takes the share `shrink` of it."""
    return 1.0 - shrink * (period - 1.0) / 2.0 * (1.0 - shrink * (period - 2.0) / 3.0)


@inlined
def _given(
    pressure: float, vehicle_pressure: float, shrink: float, period: float, most: float, model: Model
) -> tuple[float, float]:
    """Share of a step an outlet is open, and its mean flow [g/s]: Eq. (7.12) closes it when the gap has fallen so far.

    The gap loses the share `shrink` a second; where enough is left at the end of the step no division has to say so.
    A flow that is held at `most` [g/s] stays there.
    """
    gap = pressure - vehicle_pressure
    share = 1.0
    flow = outlet_flow(pressure, vehicle_pressure, model)
    if flow > most:
        shrink *= most / flow
    if gap * (1.0 - shrink * period) < model.limits.outlet_gap_min:
        share = min(1.0, (1.0 + (1.0 - model.limits.outlet_gap_min / gap) / shrink) / period)
    if flow > most:
        return share, share * most
    return share, share * flow * _mean(shrink, share * period)


@inlined
def rest(buffer: int, temperature: float, seconds: float, step: float, model: Model) -> float:
    """Temperature [deg C] of a closed buffer after a block."""
    left = seconds
    while left > 0.0:
        period = min(step, left)
        temperature = buffer_temperature(buffer, temperature, 0.0, 0.0, model, period)
        left -= period
    return temperature


@inlined
def fill(
    buffer: int, tank: Tank, was_open: bool, seconds: float, step: float, model: Model
) -> tuple[Tank, float, bool]:
    """A buffer after a block with its inlet commanded open: tank, effort of the seconds open, whether it ends open."""
    mass, temperature = tank
    spent = 0.0
    left = seconds
    while left > 0.0:
        period = min(step, left)
        pressure = gas_pressure(mass, temperature, model.buffer_volume[buffer], model)
        was_open = inlet_limit(buffer, pressure, temperature, was_open, True, model, period) == 0
        inlet = 0.0
        if was_open:
            inlet = 1.0
            spent += period * effort(pressure, model)
            flow = inlet_flow(pressure, model) * _mean(
                closing(model.inlet_coefficient, pressure, mass, model.buffer_volume[buffer], model), period
            )
            mass = next_mass(mass, flow, 0.0, period)
        temperature = buffer_temperature(buffer, temperature, inlet, 0.0, model, period)
        left -= period
    return Tank(mass, temperature), spent, was_open


@inlined
def serve(
    buffer: int, tank: Tank, vehicle: Vehicle, time: float, seconds: float, step: float, waiting: int,
    coming: np.ndarray, demand: Demand, prices: Prices, model: Model,
) -> tuple[Tank, Vehicle, float]:  # fmt: skip
    """A buffer (-1: none) and the dispenser after a block with this outlet commanded open, and what it cost.

    `time` is the block's begin after the plan's, `waiting` the vehicles that waited at the plan's begin, `coming` the
    times at which more are expected [s].
    """
    mass, temperature = tank
    vehicle_mass, vehicle_heat, connected, started = vehicle
    volume, finish = vehicle_tank(vehicle, demand)
    before = gas_pressure(vehicle_mass, vehicle_heat, volume, model)
    cost = 0.0
    arrived = waiting
    place = 0
    left = seconds
    while left > 0.0:
        period = min(step, left)
        while place < coming.size and coming[place] <= time:
            place += 1
        arrived = waiting + place
        if not connected and arrived > started:
            connected = True
            started += 1
            vehicle_mass = gas_mass(demand.next_pressure, demand.next_temperature, demand.next_volume, model)
            vehicle_heat = demand.next_temperature
            volume, finish = demand.next_volume, demand.next_finish
            before = gas_pressure(vehicle_mass, vehicle_heat, volume, model)
        outlet = 0.0
        if connected:
            flow = 0.0
            if buffer >= 0:
                pressure = gas_pressure(mass, temperature, model.buffer_volume[buffer], model)
                if outlet_limit(buffer, pressure, temperature, True, before, vehicle_heat, model, period) == 0:
                    shrink = model.outlet_coefficient * (
                        stiffness(pressure, mass, model.buffer_volume[buffer], model)
                        + stiffness(before, vehicle_mass, volume, model)
                    )
                    most = most_dispensed(vehicle_mass, vehicle_heat, before, volume, model, period)
                    outlet, flow = _given(pressure, before, shrink, period, most, model)
                    mass = next_mass(mass, 0.0, flow, period)
            vehicle_heat = vehicle_temperature(vehicle_heat, outlet, vehicle_mass, flow, volume, model, period)
            vehicle_mass = next_mass(vehicle_mass, flow, 0.0, period)
            after = gas_pressure(vehicle_mass, vehicle_heat, volume, model)
            share = 1.0
            if after >= finish:
                connected = False
                if after > before:
                    share = max(0.0, min(1.0, (finish - before) / (after - before)))
            before = after
            cost += period * share * (outlet * prices.dispensing + prices.occupancy)
        cost += period * (prices.waiting if arrived > started else 0.0)
        if buffer >= 0:
            temperature = buffer_temperature(buffer, temperature, 0.0, outlet, model, period)
        time += period
        left -= period
    return Tank(mass, temperature), Vehicle(vehicle_mass, vehicle_heat, connected, started), cost
