"""The closed loop: queue, dispenser, controller, shield, plant. One kernel advances one second for every caller."""

from __future__ import annotations

from time import perf_counter
from typing import Any, NamedTuple

import numba
import numpy as np
from numba import types

from station.arrivals import Vehicles
from station.compiled import callback, entry, kernel
from station.controller import (
    DECIDE,
    DECISION,
    OBSERVATION,
    SAMPLE_PLANT,
    CompiledController,
    Controller,
    Decision,
    Observation,
    Status,
)
from station.errors import ControllerError
from station.limits import ALL_VALVES, CLOSED, INLETS, OUTLETS, limits_at, shield
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
from station.record import CODES, COUNTS, VALUES, VEHICLE_COLUMNS, Record, Timing
from station.scenario import Scenario

# Columns of the record's blocks.
_TIME, _PRESSURE, _TEMPERATURE, _MASS = 0, 1, 5, 9
_FLOW_COMPRESSOR, _FLOW_DISPENSER, _COST, _BOUND = 13, 14, 15, 16
_REFUSED, _STATUS = 6, 12

# Entries of Run.counters.
_ROW, _ARRIVED, _NEXT, _CURRENT, _PREVIOUS = range(5)

CHUNK = 50_000
"""Rows added to a record when it is full: a 12-hour day fits without growing."""


class Run(NamedTuple):
    """The state of a run in progress, and the record it writes."""

    vehicles: Vehicles
    connected: np.ndarray  # (n,) [s]
    finished: np.ndarray  # (n,) [s]
    final_pressure: np.ndarray  # (n,) [bar]
    delivered: np.ndarray  # (n,) [g]
    pressure: np.ndarray  # (4,) [bar]
    temperature: np.ndarray  # (4,) [deg C]
    mass: np.ndarray  # (4,) [g]
    reading: np.ndarray  # (2,) pressure [bar] and temperature [deg C] of the vehicle at connection
    clock: np.ndarray  # (1,) [s]
    counters: np.ndarray  # (5,) row, vehicles arrived, next to connect, connected, previous command
    values: np.ndarray  # (len(VALUES), rows)
    codes: np.ndarray  # (len(CODES), rows)
    counts: np.ndarray  # (len(COUNTS), rows)


class Rules(NamedTuple):
    """What stays the same during a run."""

    plant: PlantConstants
    usual_volume: float  # the tank a controller assumes without communication [m3]
    communication: bool
    idle_period: float  # [s]
    time_limit: float  # [s]


@kernel
def _write_state(run: Run) -> None:
    """Start the current row with time, state and queue."""
    row = run.counters[_ROW]
    current = run.counters[_CURRENT]
    run.values[_TIME, row] = run.clock[0]
    for tank in range(4):
        present = tank != VEHICLE or current >= 0
        run.values[_PRESSURE + tank, row] = run.pressure[tank] if present else np.nan
        run.values[_TEMPERATURE + tank, row] = run.temperature[tank] if present else np.nan
        run.values[_MASS + tank, row] = run.mass[tank] if present else np.nan
    run.counts[0, row] = current
    run.counts[1, row] = run.counters[_ARRIVED] - run.counters[_NEXT]


@kernel
def begin(run: Run, rules: Rules) -> bool:
    """Let vehicles arrive and connect; False when the run is over.

    A run is over when every vehicle has left and the compressor has stopped, or at the time limit.
    """
    time = run.clock[0]
    vehicles = run.vehicles
    total = vehicles.arrival.size
    while run.counters[_ARRIVED] < total and vehicles.arrival[run.counters[_ARRIVED]] <= time:
        run.counters[_ARRIVED] += 1
    if run.counters[_CURRENT] < 0 and run.counters[_NEXT] < run.counters[_ARRIVED]:
        new = run.counters[_NEXT]
        run.counters[_NEXT] += 1
        run.counters[_CURRENT] = new
        run.connected[new] = time
        run.pressure[VEHICLE] = vehicles.start_pressure[new]
        run.temperature[VEHICLE] = vehicles.start_temperature[new]
        run.mass[VEHICLE] = gas_mass(run.pressure[VEHICLE], run.temperature[VEHICLE], vehicles.volume[new])
        run.reading[0] = run.pressure[VEHICLE]
        run.reading[1] = run.temperature[VEHICLE]
    _write_state(run)
    served = run.counters[_CURRENT] < 0 and run.counters[_NEXT] == total
    return not (time >= rules.time_limit or (served and run.counters[_PREVIOUS] & INLETS == 0))


@kernel
def observe(run: Run, rules: Rules) -> Observation:
    """What the controller sees of this second."""
    current = run.counters[_CURRENT]
    period = 1.0
    if current < 0:
        period = min(rules.idle_period, max(1.0, rules.time_limit - run.clock[0]))
        if run.counters[_ARRIVED] < run.vehicles.arrival.size:
            period = min(period, run.vehicles.arrival[run.counters[_ARRIVED]] - run.clock[0])
    pressure, temperature, volume = np.nan, np.nan, rules.usual_volume
    if current >= 0:
        pressure, temperature = run.reading[0], run.reading[1]
        if rules.communication:
            pressure, temperature = run.pressure[VEHICLE], run.temperature[VEHICLE]
            volume = run.vehicles.volume[current]
    return Observation(
        run.clock[0],
        period,
        (run.pressure[0], run.pressure[1], run.pressure[2]),
        (run.temperature[0], run.temperature[1], run.temperature[2]),
        current,
        pressure,
        temperature,
        volume,
        rules.communication,
        run.counters[_ARRIVED] - run.counters[_NEXT],
        run.counters[_PREVIOUS],
    )


@kernel
def _admit(
    run: Run,
    plant: PlantConstants,
    observation: Observation,
    decision: Decision,
    obeys_hold: bool,
    fallback: CompiledController,
) -> int:
    """Close the valves that a limit forbids; on the side of a closed valve ask the fallback. Records the limits."""
    row = run.counters[_ROW]
    for column in range(run.codes.shape[0]):
        run.codes[column, row] = 0
    connected = run.counters[_CURRENT] >= 0
    limits = limits_at(
        run.pressure, run.temperature, connected, observation.previous, obeys_hold, plant, observation.period
    )
    refusals = run.codes[_REFUSED:_STATUS, row]
    command = shield(decision.command, CLOSED, limits, plant.compressor_count, refusals)
    refused = decision.command & ~command
    if refused != 0:
        asked = (INLETS if refused & INLETS else 0) | (OUTLETS if refused & OUTLETS else 0)
        answer = fallback.decide(observation, fallback.model, fallback.settings, fallback.memory)
        limits = limits_at(
            run.pressure, run.temperature, connected, observation.previous, fallback.obeys_hold, plant,
            observation.period,
        )
        unused = np.zeros(6, dtype=np.uint8)
        command = shield(answer.command & asked, command, limits, plant.compressor_count, unused)
    return command


@kernel
def _advance(run: Run, plant: PlantConstants, command: int, period: float) -> None:
    """Apply a command for `period` seconds, Eqs (7.1)-(7.10); write flows and valves to the record."""
    row = run.counters[_ROW]
    current = run.counters[_CURRENT]
    compressed = 0.0
    dispensed = 0.0
    outlets = 0.0
    for buffer in range(3):
        inlet = command >> buffer & 1
        outlet = command >> (3 + buffer) & 1
        run.codes[buffer, row] = inlet
        run.codes[3 + buffer, row] = outlet
        inflow = inlet_flow(run.pressure[buffer], plant) if inlet else 0.0
        outflow = outlet_flow(run.pressure[buffer], run.pressure[VEHICLE], plant) if outlet else 0.0
        compressed += inflow
        dispensed += outflow
        outlets += outlet
        run.mass[buffer] = next_mass(run.mass[buffer], inflow, outflow, period)
        run.temperature[buffer] = buffer_temperature(
            buffer, run.temperature[buffer], inlet, outlet, plant, period
        )
    for buffer in range(3):
        run.pressure[buffer] = gas_pressure(
            run.mass[buffer], run.temperature[buffer], plant.buffer_volume[buffer]
        )
    if current >= 0:
        run.mass[VEHICLE] = next_mass(run.mass[VEHICLE], dispensed, 0.0, period)
        run.temperature[VEHICLE] = vehicle_temperature(run.temperature[VEHICLE], outlets, plant, period)
        run.pressure[VEHICLE] = gas_pressure(
            run.mass[VEHICLE], run.temperature[VEHICLE], run.vehicles.volume[current]
        )
        run.delivered[current] += period * dispensed
        run.final_pressure[current] = run.pressure[VEHICLE]
    run.values[_FLOW_COMPRESSOR, row] = compressed
    run.values[_FLOW_DISPENSER, row] = dispensed


@kernel
def _finish_second(run: Run, command: int, period: float) -> None:
    """Move the clock and let a filled vehicle leave."""
    run.clock[0] += period
    run.counters[_PREVIOUS] = command
    run.counters[_ROW] += 1
    current = run.counters[_CURRENT]
    if current >= 0 and run.pressure[VEHICLE] >= run.vehicles.finish_pressure[current]:
        run.finished[current] = run.clock[0]
        run.counters[_CURRENT] = -1


@kernel
def _apply(
    run: Run,
    rules: Rules,
    observation: Observation,
    decision: Decision,
    obeys_hold: bool,
    fallback: CompiledController,
) -> None:
    command = _admit(run, rules.plant, observation, decision, obeys_hold, fallback)
    row = run.counters[_ROW]
    run.values[_COST, row] = decision.cost
    run.values[_BOUND, row] = decision.bound
    run.codes[_STATUS, row] = decision.status
    _advance(run, rules.plant, command, observation.period)
    _finish_second(run, command, observation.period)


@kernel
def _close(run: Run) -> None:
    """Fill the row of the final state: every valve closed, nothing flows."""
    row = run.counters[_ROW]
    for column in range(run.codes.shape[0]):
        run.codes[column, row] = 0
    run.values[_FLOW_COMPRESSOR, row] = 0.0
    run.values[_FLOW_DISPENSER, row] = 0.0
    run.values[_COST, row] = np.nan
    run.values[_BOUND, row] = np.nan


def _sample_run() -> Run:
    one = np.zeros(1)
    return Run(
        Vehicles(one, one, one, one, one), one, one, one, one, one, one, one, one, one, np.zeros(5, np.int64),
        np.zeros((1, 1)), np.zeros((1, 1), np.uint8), np.zeros((1, 1), np.int32),
    )  # fmt: skip


_RUN = numba.typeof(_sample_run())
_SAMPLE_RULES = Rules(SAMPLE_PLANT, 1.0, True, 1.0, 1.0)
_RULES = numba.typeof(_SAMPLE_RULES)
_NO_VECTOR = np.zeros(0)


@callback(DECIDE)
def _decide_closed(observation: Observation, model: PlantConstants, settings: Any, memory: Any) -> Decision:
    return Decision(0, 0, np.nan, np.nan)


CLOSED_CONTROLLER = CompiledController(
    _decide_closed, _SAMPLE_RULES.plant, _NO_VECTOR, _NO_VECTOR, obeys_hold=True
)
"""Keeps every valve closed: what is asked where a controller has no fallback."""

_CONTROLLER = numba.typeof(CLOSED_CONTROLLER)


@entry(types.boolean(_RUN, _RULES))
def _begin(run: Run, rules: Rules) -> bool:
    going = begin(run, rules)
    if not going:
        _close(run)
    return going


@entry(OBSERVATION(_RUN, _RULES))
def _observe(run: Run, rules: Rules) -> Observation:
    return observe(run, rules)


@entry(types.void(_RUN, _RULES, OBSERVATION, DECISION, types.boolean, _CONTROLLER))
def _apply_one(
    run: Run,
    rules: Rules,
    observation: Observation,
    decision: Decision,
    obeys_hold: bool,
    fallback: CompiledController,
) -> None:
    _apply(run, rules, observation, decision, obeys_hold, fallback)


@entry(DECISION(_CONTROLLER, OBSERVATION))
def ask(controller: CompiledController, observation: Observation) -> Decision:
    """One decision of a compiled controller."""
    return controller.decide(observation, controller.model, controller.settings, controller.memory)


@entry(types.boolean(_RUN, _RULES, _CONTROLLER, _CONTROLLER))
def _loop(run: Run, rules: Rules, controller: CompiledController, fallback: CompiledController) -> bool:
    """Run until the end (True) or until the record is full (False)."""
    while run.counters[_ROW] < run.values.shape[1]:
        if not begin(run, rules):
            _close(run)
            return True
        observation = observe(run, rules)
        decision = controller.decide(observation, controller.model, controller.settings, controller.memory)
        _apply(run, rules, observation, decision, controller.obeys_hold, fallback)
    return False


def start_run(scenario: Scenario, replication: int = 0, seed: int = 0) -> tuple[Run, Rules]:
    """A run of `scenario` before its first second."""
    station = scenario.station
    plant = station.constants()
    vehicles = scenario.vehicles(replication, seed)
    count = len(vehicles.arrival)
    buffers = station.buffers.all
    pressure = np.array([*(buffer.initial_pressure_bar for buffer in buffers), 0.0])
    temperature = np.array([*(buffer.initial_temperature_c for buffer in buffers), 0.0])
    mass = np.zeros(4)
    for buffer, volume in enumerate(plant.buffer_volume):
        mass[buffer] = gas_mass(pressure[buffer], temperature[buffer], volume)
    counters = np.zeros(5, np.int64)
    counters[_CURRENT] = -1
    run = Run(
        vehicles, np.full(count, np.nan), np.full(count, np.nan), np.full(count, np.nan), np.zeros(count),
        pressure, temperature, mass, np.zeros(2), np.zeros(1), counters,
        np.empty((len(VALUES), 0)), np.empty((len(CODES), 0), np.uint8), np.empty((len(COUNTS), 0), np.int32),
    )  # fmt: skip
    rules = Rules(
        plant, station.vehicle.volume_m3, scenario.communication, float(scenario.idle_period_s),
        scenario.time_limit_s,
    )  # fmt: skip
    return run, rules


def _longer(run: Run) -> Run:
    """The same run with room for CHUNK more rows."""

    def grown(block: np.ndarray) -> np.ndarray:
        new = np.empty((block.shape[0], block.shape[1] + CHUNK), block.dtype)
        new[:, : block.shape[1]] = block
        return new

    return run._replace(values=grown(run.values), codes=grown(run.codes), counts=grown(run.counts))


def simulate(
    scenario: Scenario,
    controller: Controller,
    *,
    replication: int = 0,
    seed: int = 0,
) -> Record:
    """Run `controller` on one replication of `scenario` to its end.

    A controller whose `compiled()` gives a CompiledController runs in the compiled loop, any other is called
    second by second; both give the same bytes. Where the shield closes a valve, `controller.fallback` is asked, if it has one.

    Raises
    ------
    ControllerError
        if the controller answers what is no decision.
    """
    controller.start(scenario.station)
    fallback_controller = getattr(controller, "fallback", None)
    fallback = CLOSED_CONTROLLER
    if fallback_controller is not None:
        fallback_controller.start(scenario.station)
        fallback = fallback_controller.compiled()
    run, rules = start_run(scenario, replication, seed)
    began = perf_counter()
    durations = None
    compiled = controller.compiled() if hasattr(controller, "compiled") else None
    if compiled is not None:
        while not _loop(run, rules, compiled, fallback):
            run = _longer(run)
    else:
        run, durations = _call_each_second(run, rules, controller, fallback)
    timing = Timing(perf_counter() - began, durations)
    return _record(scenario, controller.name, replication, seed, run, timing)


def _call_each_second(
    run: Run, rules: Rules, controller: Controller, fallback: CompiledController
) -> tuple[Run, np.ndarray]:
    """The loop around a controller that is called from Python."""
    durations = []
    run = _longer(run)
    while _begin(run, rules):
        observation = _observe(run, rules)
        before = perf_counter()
        answer = controller.decide(observation)
        durations.append(perf_counter() - before)
        decision = checked(answer, controller.name, observation)
        _apply_one(run, rules, observation, decision, bool(controller.obeys_hold), fallback)
        if run.counters[_ROW] == run.values.shape[1]:
            run = _longer(run)
    return run, np.array(durations)


def checked(answer: object, name: str, observation: Observation) -> Decision:
    """A controller's answer as a Decision of plain numbers.

    Raises
    ------
    ControllerError
        if it is none.
    """
    try:
        command, status, cost, bound = answer  # type: ignore[misc]  # whatever a plug-in returned
        decision = Decision(int(command), int(Status(status)), float(cost), float(bound))
    except (TypeError, ValueError):
        raise ControllerError(
            f"controller {name!r} must answer a station.Decision; at {observation.time:g} s it answered {answer!r}"
        ) from None
    if not 0 <= decision.command <= ALL_VALVES:
        raise ControllerError(
            f"controller {name!r}: command must be 0 to {ALL_VALVES} (bits of station.Valve); "
            f"at {observation.time:g} s it answered {decision.command}"
        )
    return decision


def _record(
    scenario: Scenario, name: str, replication: int, seed: int, run: Run, timing: Timing
) -> Record:
    rows = int(run.counters[_ROW]) + 1
    vehicles = run.vehicles
    table = (
        vehicles.arrival, run.connected, run.finished, vehicles.volume, vehicles.start_pressure,
        vehicles.finish_pressure, run.final_pressure, run.delivered,
    )  # fmt: skip
    return Record(
        scenario, name, replication, seed, run.values[:, :rows], run.codes[:, :rows], run.counts[:, :rows],
        dict(zip(VEHICLE_COLUMNS, table, strict=True)), timing,
    )  # fmt: skip
