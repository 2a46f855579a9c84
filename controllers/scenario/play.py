"""Outcome of commands in one future, by the parts of `switched`'s model: cost, end, and whether there is a shortage."""

from __future__ import annotations

import numpy as np

from controllers.switched.model import Demand, Tank, Vehicle, fill, rest, serve, vehicle_tank
from controllers.switched.parts import (
    COMMAND,
    CONNECTED,
    COST,
    MASS,
    STARTED,
    TEMPERATURE,
    VEHICLE_MASS,
    VEHICLE_TEMPERATURE,
    Task,
    fills_to_do,
    longest_step,
    price_of_delay,
    vehicle_of,
)
from controllers.switched.search import arrived_by
from controllers.switched.value import fill_end_pressure, fill_end_time, restore, terminal_cost
from station.compiled import inlined, uncounted
from station.geometry import INLETS, OUTLETS
from station.limits import gap_margin
from station.planning import gas_pressure


@inlined
def _short(state: np.ndarray, vehicle: Vehicle, task: Task) -> bool:
    """Whether a vehicle is connected and every buffer is closer than the dispenser's least gap."""
    if not vehicle.connected:
        return False
    model = task.model
    pressure = gas_pressure(vehicle.mass, vehicle.temperature, vehicle_tank(vehicle, task.demand)[0], model)
    for buffer in range(3):
        stored = gas_pressure(state[MASS + buffer], state[TEMPERATURE + buffer], model.buffer_volume[buffer], model)
        if gap_margin(stored, pressure, model) >= 0.0:
            return False
    return True


@inlined
def _outlet(command: int) -> int:
    """The buffer a command gives from, -1 for none."""
    outlet = -1
    for buffer in range(3):
        outlet = buffer if command & (8 << buffer) else outlet
    return outlet


@inlined
def _opening(opened: int, price: float) -> float:
    """What it costs to open these valves."""
    cost = 0.0
    for valve in range(6):
        cost += price if opened >> valve & 1 else 0.0
    return cost


@inlined
def _demand(vehicle: Vehicle, pressure: np.ndarray, demand: Demand) -> Demand:
    """The demand with the start pressure of the vehicle that is connected next."""
    start = pressure[min(vehicle.started, pressure.size - 1)]
    return Demand(
        demand.volume, demand.finish, demand.next_volume, demand.next_finish, start, demand.next_temperature
    )  # fmt: skip


@uncounted
def play_block(
    state: np.ndarray, command: int, time: float, seconds: float, task: Task, coming: np.ndarray, pressure: np.ndarray
) -> bool:
    """Carry `state` through a block with this command; whether there was a shortage at the end of one of its steps.

    `time` is the block's begin after the plan's, `coming` are the arrivals [s], `pressure` the start pressures of the
    vehicles connected after the plan began [bar]. A valve that a limit forbids is closed for a step.
    """
    model = task.model
    was = int(state[COMMAND])
    cost, short = _opening(command & ~was, task.prices.start), False
    vehicle = vehicle_of(state)
    outlet = _outlet(command)
    step, left = longest_step(seconds, task.step), seconds
    opened = was & INLETS
    while left > 0.0:
        period = min(step, left)
        demand = _demand(vehicle, pressure, task.demand)
        if outlet < 0:
            _, vehicle, spent = serve(
                -1, Tank(0.0, 0.0), vehicle, time, period, period, task.waiting, coming, demand, task.prices, model
            )
            cost += spent
        for buffer in range(3):
            tank = Tank(state[MASS + buffer], state[TEMPERATURE + buffer])
            if buffer == outlet:
                tank, vehicle, spent = serve(
                    buffer, tank, vehicle, time, period, period, task.waiting, coming, demand, task.prices, model
                )
                cost += spent
            elif command & (1 << buffer):
                held = opened & (1 << buffer) != 0
                tank, spent, held = fill(buffer, tank, held, period, period, model)
                opened = opened | (1 << buffer) if held else opened & ~(1 << buffer)
                cost += spent
            else:
                tank = Tank(tank.mass, rest(buffer, tank.temperature, period, period, model))
            state[MASS + buffer], state[TEMPERATURE + buffer] = tank
        short = short or _short(state, vehicle, task)
        time += period
        left -= period
    state[COST] += cost
    state[COMMAND] = (command & OUTLETS) | (opened & command)
    state[VEHICLE_MASS], state[VEHICLE_TEMPERATURE] = vehicle.mass, vehicle.temperature
    state[CONNECTED], state[STARTED] = (1.0 if vehicle.connected else 0.0), vehicle.started
    return short


@uncounted
def plan_terminal_cost(state: np.ndarray, coming: np.ndarray, task: Task) -> float:
    """Worth of a plan's last state, as the search counts it [s of compressor]."""
    model = task.model
    target = fill_end_pressure(task.demand, model)
    vehicle = vehicle_of(state)
    arrived = arrived_by(np.sum(task.blocks), task.waiting, coming)
    total = fills_to_do(vehicle, arrived, task)
    lift = np.inf
    for buffer in range(3):
        mass = state[MASS + buffer]
        missing = restore(mass, task.terminal[buffer], buffer, model)
        total += terminal_cost(
            mass, missing, task.terminal[buffer], target, task.waiting, task.prices.gas, buffer, model
        )
        lift = min(lift, fill_end_time(mass, state[TEMPERATURE + buffer], target, buffer, model))
    return total + price_of_delay(vehicle, arrived, task) * lift
