"""What happens in one second of a run: arrivals, the shield, the plant, the record. Kernels for every caller."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from station.compiled import inlined
from station.controller import CompiledController, Decision, Observation
from station.limits import CLOSED, INLETS, OUTLETS, VALVES, Admission, admissible_part, limits_at, refusal
from station.plant import (
    VEHICLE,
    PlantConstants,
    buffer_temperature,
    gas_mass,
    gas_pressure,
    inlet_flow,
    next_mass,
    outlet_flow,
    vehicle_temperature,
)
from station.record import CODES, COUNTS, VALUES, VEHICLE_COLUMNS
from station.sensing import OFF, Sensing, advance_tube, cautious_limits, connect_tube, sensed


def _places(table: dict[str, str], *names: str) -> list[int]:
    """Where columns of a block of the record stand."""
    return [list(table).index(name) for name in names]


_TIME, _PRESSURE, _TEMPERATURE, _MASS = _places(VALUES, "time", "pressure_high", "temperature_high", "mass_high")
_FLOW_COMPRESSOR, _FLOW_DISPENSER = _places(VALUES, "flow_compressor", "flow_dispenser")
_COST, _BOUND = _places(VALUES, "decision_cost", "decision_bound")
_REFUSED, _STATUS = _places(CODES, f"refused_{VALVES[0]}", "decision_status")
_VEHICLE, _QUEUE = _places(COUNTS, "vehicle", "queue_length")
ARRIVAL, _CONNECTED, _FINISHED = _places(VEHICLE_COLUMNS, "arrival", "connected", "finished")
VOLUME, START_PRESSURE, START_TEMPERATURE, FINISH_PRESSURE = _places(
    VEHICLE_COLUMNS, "volume", "start_pressure", "start_temperature", "finish_pressure"
)
_FINAL_PRESSURE, DELIVERED = _places(VEHICLE_COLUMNS, "final_pressure", "delivered")

# Entries of Run.state (tanks high, medium, low, vehicle) and of Run.counters.
P, T, M, _READING, CLOCK = 0, 4, 8, 12, 14
ROW, ARRIVED, NEXT, CURRENT, _PREVIOUS = range(5)

PERIOD = 1.0
"""Sampling period of the plant and its controllers, Sec. 7.4 [s]."""


class Run(NamedTuple):
    """The state of a run in progress, and the record it writes."""

    state: np.ndarray  # (15,) pressures [bar], temperatures [deg C], masses [g], first reading, clock [s]; see sensing
    counters: np.ndarray  # (5,) row, vehicles arrived, next to connect, connected, previous command
    vehicles: np.ndarray  # (len(VEHICLE_COLUMNS), n)
    values: np.ndarray  # (len(VALUES), rows)
    codes: np.ndarray  # (len(CODES), rows)
    counts: np.ndarray  # (len(COUNTS), rows)


class Rules(NamedTuple):
    """What stays the same during a run."""

    plant: PlantConstants
    usual_volume: float  # the tank a controller assumes without communication [m3]
    usual_finish: float  # and the pressure at which it leaves [bar]
    communication: bool
    announcement: float  # how long before they arrive vehicles say so [s]
    idle_period: float  # [s]
    time_limit: float  # [s]
    sensing: Sensing  # what a disturbed run knows of `plant`


# Kernels take the arrays of a Run one by one: taking them out of the tuple in each would count references, which
# costs more than the second they advance.


@inlined
def begin_second(
    state: np.ndarray, counters: np.ndarray, vehicles: np.ndarray, values: np.ndarray, counts: np.ndarray,
    rules: Rules,
) -> bool:  # fmt: skip
    """Let vehicles arrive and connect, and start the record's row; False when the run is over.

    A run is over when every vehicle has left and the compressor has stopped, or at the time limit.
    """
    time = state[CLOCK]
    total = vehicles.shape[1]
    while counters[ARRIVED] < total and vehicles[ARRIVAL, counters[ARRIVED]] <= time:
        counters[ARRIVED] += 1
    if counters[CURRENT] < 0 and counters[NEXT] < counters[ARRIVED]:
        new = counters[NEXT]
        counters[NEXT] += 1
        counters[CURRENT] = new
        vehicles[_CONNECTED, new] = time
        pressure, temperature = vehicles[START_PRESSURE, new], vehicles[START_TEMPERATURE, new]
        state[P + VEHICLE], state[T + VEHICLE] = pressure, temperature
        state[M + VEHICLE] = gas_mass(pressure, temperature, vehicles[VOLUME, new])
        state[_READING], state[_READING + 1] = pressure, temperature
    row = counters[ROW]
    current = counters[CURRENT]
    values[_TIME, row] = time
    for tank in range(4):
        present = tank != VEHICLE or current >= 0
        values[_PRESSURE + tank, row] = state[P + tank] if present else np.nan
        values[_TEMPERATURE + tank, row] = state[T + tank] if present else np.nan
        values[_MASS + tank, row] = state[M + tank] if present else np.nan
    counts[_VEHICLE, row] = current
    counts[_QUEUE, row] = counters[ARRIVED] - counters[NEXT]
    served = current < 0 and counters[NEXT] == total
    return not (time >= rules.time_limit or (served and counters[_PREVIOUS] & INLETS == 0))


@inlined
def _announced(place: int, state: np.ndarray, counters: np.ndarray, vehicles: np.ndarray, rules: Rules) -> float:
    """When the vehicle at `place` among those still to come arrives [s], if it has said so by now."""
    coming = counters[ARRIVED] + place
    if coming < vehicles.shape[1] and vehicles[ARRIVAL, coming] - state[CLOCK] <= rules.announcement:
        return float(vehicles[ARRIVAL, coming])
    return np.inf


@inlined
def observation_of(state: np.ndarray, counters: np.ndarray, vehicles: np.ndarray, rules: Rules) -> Observation:
    """What the controller sees of this second."""
    current = counters[CURRENT]
    pressure, temperature, volume, finish = np.nan, np.nan, rules.usual_volume, rules.usual_finish
    if current >= 0:
        pressure, temperature = state[_READING], state[_READING + 1]
        if rules.communication:
            pressure, temperature = state[P + VEHICLE], state[T + VEHICLE]
            volume, finish = vehicles[VOLUME, current], vehicles[FINISH_PRESSURE, current]
    true = Observation(
        state[CLOCK],
        PERIOD,
        (state[P], state[P + 1], state[P + 2]),
        (state[T], state[T + 1], state[T + 2]),
        current,
        pressure,
        temperature,
        volume,
        rules.communication,
        counters[ARRIVED] - counters[NEXT],
        counters[_PREVIOUS],
        finish,
        (
            _announced(0, state, counters, vehicles, rules),
            _announced(1, state, counters, vehicles, rules),
            _announced(2, state, counters, vehicles, rules),
            _announced(3, state, counters, vehicles, rules),
        ),
    )
    if rules.sensing.kind == OFF:
        return true
    predicted = not rules.communication and current >= 0 and vehicles[_CONNECTED, current] < state[CLOCK]
    return sensed(state, true, predicted, rules.sensing)


@inlined
def _limits(state: np.ndarray, connected: bool, previous: int, obeys_hold: bool, plant: PlantConstants) -> Admission:
    """The limit on each valve in the true state."""
    return limits_at(
        (state[P], state[P + 1], state[P + 2], state[P + 3]),
        (state[T], state[T + 1], state[T + 2], state[T + 3]),
        connected,
        previous,
        obeys_hold,
        plant,
        PERIOD,
    )


@inlined
def _shield(state: np.ndarray, observation: Observation, obeys_hold: bool, rules: Rules) -> Admission:
    """The limit on each valve: in the true state, or with margins at what the sensors report of it."""
    if rules.sensing.kind == OFF:
        return _limits(state, observation.vehicle >= 0, observation.previous, obeys_hold, rules.plant)
    return cautious_limits(state, observation, obeys_hold, rules.sensing)


@inlined
def _ask_fallback(
    kept: int, refused: int, state: np.ndarray, rules: Rules, observation: Observation,
    fallback: CompiledController,
) -> int:  # fmt: skip
    """`kept` and what the fallback opens beside it on the sides where a valve was refused."""
    asked = (INLETS if refused & INLETS else 0) | (OUTLETS if refused & OUTLETS else 0)
    answer = fallback.decide(observation, fallback.model, fallback.settings, fallback.memory)
    limits = _shield(state, observation, fallback.obeys_hold, rules)
    return admissible_part(answer.command & asked, kept, limits, rules.plant.compressor_count)[0]


@inlined
def advance_tanks(
    state: np.ndarray, connected: bool, volume: float, plant: PlantConstants, command: int
) -> tuple[float, float]:
    """Apply a command for one second, Eqs (7.1)-(7.10); what flows out of the compressor and to the vehicle [g/s].

    `volume`: of the vehicle's tank [m3], where one is connected.
    """
    compressed = 0.0
    dispensed = 0.0
    outlets = 0.0
    for buffer in range(3):
        inlet = command >> buffer & 1
        outlet = command >> (3 + buffer) & 1
        pressure = state[P + buffer]
        inflow = inlet_flow(pressure, plant) if inlet else 0.0
        outflow = outlet_flow(pressure, state[P + VEHICLE], plant) if outlet else 0.0
        compressed += inflow
        dispensed += outflow
        outlets += outlet
        mass = next_mass(state[M + buffer], inflow, outflow, PERIOD)
        temperature = buffer_temperature(buffer, state[T + buffer], inlet, outlet, plant, PERIOD)
        state[M + buffer], state[T + buffer] = mass, temperature
        state[P + buffer] = gas_pressure(mass, temperature, plant.buffer_volume[buffer])
    if connected:
        mass = next_mass(state[M + VEHICLE], dispensed, 0.0, PERIOD)
        temperature = vehicle_temperature(state[T + VEHICLE], outlets, plant, PERIOD)
        state[M + VEHICLE], state[T + VEHICLE] = mass, temperature
        state[P + VEHICLE] = gas_pressure(mass, temperature, volume)
    return compressed, dispensed


@inlined
def _advance(
    state: np.ndarray, counters: np.ndarray, vehicles: np.ndarray, values: np.ndarray, codes: np.ndarray,
    plant: PlantConstants,
    command: int,
) -> None:  # fmt: skip
    """Apply a command for one second; write flows and valves to the record."""
    row = counters[ROW]
    current = counters[CURRENT]
    for valve in range(6):
        codes[valve, row] = command >> valve & 1
    volume = vehicles[VOLUME, current] if current >= 0 else 0.0
    compressed, dispensed = advance_tanks(state, current >= 0, volume, plant, command)
    if current >= 0:
        vehicles[DELIVERED, current] += PERIOD * dispensed
        vehicles[_FINAL_PRESSURE, current] = state[P + VEHICLE]
    values[_FLOW_COMPRESSOR, row] = compressed
    values[_FLOW_DISPENSER, row] = dispensed


@inlined
def _below(state: np.ndarray, pressure: tuple[float, float, float]) -> tuple[bool, bool, bool]:
    """Which buffers lie below these pressures [bar]."""
    return state[P] < pressure[0], state[P + 1] < pressure[1], state[P + 2] < pressure[2]


@inlined
def _rest(
    state: np.ndarray,
    counters: np.ndarray,
    vehicles: np.ndarray,
    rules: Rules,
    obeys_hold: bool,
    wake_pressure: tuple[float, float, float],
    limits: Admission,
    below: tuple[bool, bool, bool],
) -> None:
    """Let seconds pass that nobody decides: closed buffers go on towards ambient temperature.

    The rest ends with the idle period, with an arrival, and when something differs from the second of the decision:
    a limit forbids a valve or no longer does, or a buffer has fallen below the controller's `wake_pressure`.
    """
    plant = rules.plant
    until = min(state[CLOCK] - PERIOD + rules.idle_period, rules.time_limit)
    if counters[ARRIVED] < vehicles.shape[1]:
        until = min(until, vehicles[ARRIVAL, counters[ARRIVED]])
    while state[CLOCK] < until:
        if _limits(state, False, CLOSED, obeys_hold, plant) != limits or _below(state, wake_pressure) != below:
            break
        for buffer in range(3):
            temperature = buffer_temperature(buffer, state[T + buffer], 0.0, 0.0, plant, PERIOD)
            state[T + buffer] = temperature
            state[P + buffer] = gas_pressure(state[M + buffer], temperature, plant.buffer_volume[buffer])
        state[CLOCK] += PERIOD


@inlined
def apply_decision(
    state: np.ndarray, counters: np.ndarray, vehicles: np.ndarray, values: np.ndarray, codes: np.ndarray,
    rules: Rules, observation: Observation, decision: Decision, obeys_hold: bool,
    wake_pressure: tuple[float, float, float], fallback: CompiledController,
) -> None:  # fmt: skip
    """Shield a decision, apply it, record it, move the clock, and let a filled vehicle leave."""
    row = counters[ROW]
    plant = rules.plant
    unseen = rules.sensing.kind != OFF and not rules.communication and counters[CURRENT] >= 0
    if unseen and vehicles[_CONNECTED, counters[CURRENT]] == state[CLOCK]:
        connect_tube(state, observation, rules.sensing)
    limits = _shield(state, observation, obeys_hold, rules)
    command, refusals = admissible_part(decision.command, CLOSED, limits, plant.compressor_count)
    for valve in range(6):
        codes[_REFUSED + valve, row] = refusal(refusals, valve)
    refused = decision.command & ~command
    if refused != 0:
        command = _ask_fallback(command, refused, state, rules, observation, fallback)
        if unseen and refused & OUTLETS and command & OUTLETS == 0:  # nobody else knows what the interval admits
            command = admissible_part(OUTLETS, command, limits, plant.compressor_count)[0]
    values[_COST, row] = decision.cost
    values[_BOUND, row] = decision.bound
    codes[_STATUS, row] = decision.status
    resting = command == CLOSED and counters[CURRENT] < 0 and rules.idle_period > PERIOD
    below = _below(state, wake_pressure)
    if resting:
        limits = _limits(state, False, CLOSED, obeys_hold, plant)
    if unseen:
        advance_tube(state, observation, command, rules.sensing)
    _advance(state, counters, vehicles, values, codes, plant, command)
    state[CLOCK] += PERIOD
    if resting:
        _rest(state, counters, vehicles, rules, obeys_hold, wake_pressure, limits, below)
    counters[_PREVIOUS] = command
    counters[ROW] = row + 1
    current = counters[CURRENT]
    if current >= 0 and state[P + VEHICLE] >= vehicles[FINISH_PRESSURE, current]:
        vehicles[_FINISHED, current] = state[CLOCK]
        counters[CURRENT] = -1


@inlined
def close_record(row: int, values: np.ndarray, codes: np.ndarray) -> None:
    """Fill the row of the final state: every valve closed, nothing flows."""
    for column in range(codes.shape[0]):
        codes[column, row] = 0
    values[_FLOW_COMPRESSOR, row] = 0.0
    values[_FLOW_DISPENSER, row] = 0.0
    values[_COST, row] = np.nan
    values[_BOUND, row] = np.nan
