"""The closed loop: queue, dispenser, controller, shield, plant. One kernel advances one second for every caller."""

from __future__ import annotations

from time import perf_counter
from typing import NamedTuple, cast

import numpy as np
from numba import types

from station.compiled import callback, entry, inlined, numba_type
from station.controller import (
    DECIDE,
    DECISION,
    NEVER,
    OBSERVATION,
    SAMPLE_PLANT,
    CompiledController,
    Controller,
    Decision,
    Observation,
    Status,
)
from station.errors import ControllerError
from station.limits import ALL_VALVES, CLOSED, INLETS, OUTLETS, Admission, admissible_part, limits_at, refusal
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

# Columns of the record's blocks, in the order of the tables in record.py.
_TIME, _PRESSURE, _TEMPERATURE, _MASS = 0, 1, 5, 9
_FLOW_COMPRESSOR, _FLOW_DISPENSER, _COST, _BOUND = 13, 14, 15, 16
_REFUSED, _STATUS = 6, 12
_ARRIVAL, _CONNECTED, _FINISHED, _VOLUME, _START_PRESSURE, _START_TEMPERATURE = range(6)
_FINISH_PRESSURE, _FINAL_PRESSURE, _DELIVERED = 6, 7, 8

# Entries of Run.state (tanks high, medium, low, vehicle) and of Run.counters.
_P, _T, _M, _READING, _CLOCK = 0, 4, 8, 12, 14
_ROW, _ARRIVED, _NEXT, _CURRENT, _PREVIOUS = range(5)

PERIOD = 1.0
"""Sampling period of the plant and its controllers, Sec. 7.4 [s]."""

CHUNK = 50_000
"""Rows added to a record when it is full: a 12-hour day fits without growing."""


class Run(NamedTuple):
    """The state of a run in progress, and the record it writes."""

    state: np.ndarray  # (15,) pressures [bar], temperatures [deg C], masses [g], first reading, clock [s]
    counters: np.ndarray  # (5,) row, vehicles arrived, next to connect, connected, previous command
    vehicles: np.ndarray  # (len(VEHICLE_COLUMNS), n)
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


# Kernels take the arrays of a Run one by one: taking them out of the tuple in each would count references, which
# costs more than the second they advance.


@inlined
def _begin(
    state: np.ndarray, counters: np.ndarray, vehicles: np.ndarray, values: np.ndarray, counts: np.ndarray,
    rules: Rules,
) -> bool:  # fmt: skip
    """Let vehicles arrive and connect, and start the record's row; False when the run is over.

    A run is over when every vehicle has left and the compressor has stopped, or at the time limit.
    """
    time = state[_CLOCK]
    total = vehicles.shape[1]
    while counters[_ARRIVED] < total and vehicles[_ARRIVAL, counters[_ARRIVED]] <= time:
        counters[_ARRIVED] += 1
    if counters[_CURRENT] < 0 and counters[_NEXT] < counters[_ARRIVED]:
        new = counters[_NEXT]
        counters[_NEXT] += 1
        counters[_CURRENT] = new
        vehicles[_CONNECTED, new] = time
        pressure, temperature = vehicles[_START_PRESSURE, new], vehicles[_START_TEMPERATURE, new]
        state[_P + VEHICLE], state[_T + VEHICLE] = pressure, temperature
        state[_M + VEHICLE] = gas_mass(pressure, temperature, vehicles[_VOLUME, new])
        state[_READING], state[_READING + 1] = pressure, temperature
    row = counters[_ROW]
    current = counters[_CURRENT]
    values[_TIME, row] = time
    for tank in range(4):
        present = tank != VEHICLE or current >= 0
        values[_PRESSURE + tank, row] = state[_P + tank] if present else np.nan
        values[_TEMPERATURE + tank, row] = state[_T + tank] if present else np.nan
        values[_MASS + tank, row] = state[_M + tank] if present else np.nan
    counts[0, row] = current
    counts[1, row] = counters[_ARRIVED] - counters[_NEXT]
    served = current < 0 and counters[_NEXT] == total
    return not (time >= rules.time_limit or (served and counters[_PREVIOUS] & INLETS == 0))


@inlined
def _observe(state: np.ndarray, counters: np.ndarray, vehicles: np.ndarray, rules: Rules) -> Observation:
    """What the controller sees of this second."""
    current = counters[_CURRENT]
    pressure, temperature, volume = np.nan, np.nan, rules.usual_volume
    if current >= 0:
        pressure, temperature = state[_READING], state[_READING + 1]
        if rules.communication:
            pressure, temperature = state[_P + VEHICLE], state[_T + VEHICLE]
            volume = vehicles[_VOLUME, current]
    return Observation(
        state[_CLOCK],
        PERIOD,
        (state[_P], state[_P + 1], state[_P + 2]),
        (state[_T], state[_T + 1], state[_T + 2]),
        current,
        pressure,
        temperature,
        volume,
        rules.communication,
        counters[_ARRIVED] - counters[_NEXT],
        counters[_PREVIOUS],
    )


@inlined
def _limits(state: np.ndarray, connected: bool, previous: int, obeys_hold: bool, plant: PlantConstants) -> Admission:
    """The limit on each valve in the true state."""
    return limits_at(
        (state[_P], state[_P + 1], state[_P + 2], state[_P + 3]),
        (state[_T], state[_T + 1], state[_T + 2], state[_T + 3]),
        connected,
        previous,
        obeys_hold,
        plant,
        PERIOD,
    )


@inlined
def _ask_fallback(
    kept: int, refused: int, state: np.ndarray, plant: PlantConstants, observation: Observation,
    fallback: CompiledController,
) -> int:  # fmt: skip
    """`kept` and what the fallback opens beside it on the sides where a valve was refused."""
    asked = (INLETS if refused & INLETS else 0) | (OUTLETS if refused & OUTLETS else 0)
    answer = fallback.decide(observation, fallback.model, fallback.settings, fallback.memory)
    limits = _limits(state, observation.vehicle >= 0, observation.previous, fallback.obeys_hold, plant)
    return admissible_part(answer.command & asked, kept, limits, plant.compressor_count)[0]


@inlined
def _advance(
    state: np.ndarray, counters: np.ndarray, vehicles: np.ndarray, values: np.ndarray, codes: np.ndarray,
    plant: PlantConstants,
    command: int,
) -> None:  # fmt: skip
    """Apply a command for one second, Eqs (7.1)-(7.10); write flows and valves to the record."""
    row = counters[_ROW]
    current = counters[_CURRENT]
    compressed = 0.0
    dispensed = 0.0
    outlets = 0.0
    for buffer in range(3):
        inlet = command >> buffer & 1
        outlet = command >> (3 + buffer) & 1
        codes[buffer, row] = inlet
        codes[3 + buffer, row] = outlet
        pressure = state[_P + buffer]
        inflow = inlet_flow(pressure, plant) if inlet else 0.0
        outflow = outlet_flow(pressure, state[_P + VEHICLE], plant) if outlet else 0.0
        compressed += inflow
        dispensed += outflow
        outlets += outlet
        mass = next_mass(state[_M + buffer], inflow, outflow, PERIOD)
        temperature = buffer_temperature(buffer, state[_T + buffer], inlet, outlet, plant, PERIOD)
        state[_M + buffer], state[_T + buffer] = mass, temperature
        state[_P + buffer] = gas_pressure(mass, temperature, plant.buffer_volume[buffer])
    if current >= 0:
        mass = next_mass(state[_M + VEHICLE], dispensed, 0.0, PERIOD)
        temperature = vehicle_temperature(state[_T + VEHICLE], outlets, plant, PERIOD)
        state[_M + VEHICLE], state[_T + VEHICLE] = mass, temperature
        state[_P + VEHICLE] = gas_pressure(mass, temperature, vehicles[_VOLUME, current])
        vehicles[_DELIVERED, current] += PERIOD * dispensed
        vehicles[_FINAL_PRESSURE, current] = state[_P + VEHICLE]
    values[_FLOW_COMPRESSOR, row] = compressed
    values[_FLOW_DISPENSER, row] = dispensed


@inlined
def _below(state: np.ndarray, pressure: tuple[float, float, float]) -> tuple[bool, bool, bool]:
    """Which buffers lie below these pressures [bar]."""
    return state[_P] < pressure[0], state[_P + 1] < pressure[1], state[_P + 2] < pressure[2]


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
    until = min(state[_CLOCK] - PERIOD + rules.idle_period, rules.time_limit)
    if counters[_ARRIVED] < vehicles.shape[1]:
        until = min(until, vehicles[_ARRIVAL, counters[_ARRIVED]])
    while state[_CLOCK] < until:
        if _limits(state, False, CLOSED, obeys_hold, plant) != limits or _below(state, wake_pressure) != below:
            break
        for buffer in range(3):
            temperature = buffer_temperature(buffer, state[_T + buffer], 0.0, 0.0, plant, PERIOD)
            state[_T + buffer] = temperature
            state[_P + buffer] = gas_pressure(state[_M + buffer], temperature, plant.buffer_volume[buffer])
        state[_CLOCK] += PERIOD


@inlined
def _apply(
    state: np.ndarray, counters: np.ndarray, vehicles: np.ndarray, values: np.ndarray, codes: np.ndarray,
    rules: Rules, observation: Observation, decision: Decision, obeys_hold: bool,
    wake_pressure: tuple[float, float, float], fallback: CompiledController,
) -> None:  # fmt: skip
    """Shield a decision, apply it, record it, move the clock, and let a filled vehicle leave."""
    row = counters[_ROW]
    plant = rules.plant
    limits = _limits(state, observation.vehicle >= 0, observation.previous, obeys_hold, plant)
    command, refusals = admissible_part(decision.command, CLOSED, limits, plant.compressor_count)
    for valve in range(6):
        codes[_REFUSED + valve, row] = refusal(refusals, valve)
    refused = decision.command & ~command
    if refused != 0:
        command = _ask_fallback(command, refused, state, plant, observation, fallback)
    values[_COST, row] = decision.cost
    values[_BOUND, row] = decision.bound
    codes[_STATUS, row] = decision.status
    resting = command == CLOSED and counters[_CURRENT] < 0 and rules.idle_period > PERIOD
    below = _below(state, wake_pressure)
    if resting:
        limits = _limits(state, False, CLOSED, obeys_hold, plant)
    _advance(state, counters, vehicles, values, codes, plant, command)
    state[_CLOCK] += PERIOD
    if resting:
        _rest(state, counters, vehicles, rules, obeys_hold, wake_pressure, limits, below)
    counters[_PREVIOUS] = command
    counters[_ROW] = row + 1
    current = counters[_CURRENT]
    if current >= 0 and state[_P + VEHICLE] >= vehicles[_FINISH_PRESSURE, current]:
        vehicles[_FINISHED, current] = state[_CLOCK]
        counters[_CURRENT] = -1


@inlined
def _close(row: int, values: np.ndarray, codes: np.ndarray) -> None:
    """Fill the row of the final state: every valve closed, nothing flows."""
    for column in range(codes.shape[0]):
        codes[column, row] = 0
    values[_FLOW_COMPRESSOR, row] = 0.0
    values[_FLOW_DISPENSER, row] = 0.0
    values[_COST, row] = np.nan
    values[_BOUND, row] = np.nan


_SAMPLE_RUN = Run(
    np.zeros(1), np.zeros(1, np.int64), np.zeros((1, 1)), np.zeros((1, 1)), np.zeros((1, 1), np.uint8),
    np.zeros((1, 1), np.int32),
)  # fmt: skip
_RUN = numba_type(_SAMPLE_RUN)
_SAMPLE_RULES = Rules(SAMPLE_PLANT, 1.0, True, 1.0, 1.0)
_RULES = numba_type(_SAMPLE_RULES)
_NO_VECTOR = np.zeros(0)


@callback(DECIDE)
def _decide_closed(  # a controller with nothing to see
    _observation: Observation, _model: PlantConstants, _settings: np.ndarray, _memory: np.ndarray
) -> Decision:
    return Decision(0, 0, np.nan, np.nan)


CLOSED_CONTROLLER = CompiledController(_decide_closed, _SAMPLE_RULES.plant, _NO_VECTOR, _NO_VECTOR, obeys_hold=True)
"""Keeps every valve closed: what is asked where a controller has no fallback."""

_CONTROLLER = numba_type(CLOSED_CONTROLLER)
_TRIPLE = numba_type(NEVER)


@entry(types.boolean(_RUN, _RULES))
def begin(run: Run, rules: Rules) -> bool:
    """Let vehicles arrive and connect; False when the run is over and its record is closed."""
    going = _begin(run.state, run.counters, run.vehicles, run.values, run.counts, rules)
    if not going:
        _close(run.counters[_ROW], run.values, run.codes)
    return going


@entry(OBSERVATION(_RUN, _RULES))
def observe(run: Run, rules: Rules) -> Observation:
    """What the controller sees of this second."""
    return _observe(run.state, run.counters, run.vehicles, rules)


@entry(types.void(_RUN, _RULES, OBSERVATION, DECISION, types.boolean, _TRIPLE, _CONTROLLER))
def apply(
    run: Run, rules: Rules, observation: Observation, decision: Decision, obeys_hold: bool,
    wake_pressure: tuple[float, float, float], fallback: CompiledController,
) -> None:  # fmt: skip
    """Shield and apply one decision, and record it."""
    _apply(
        run.state, run.counters, run.vehicles, run.values, run.codes, rules, observation, decision, obeys_hold,
        wake_pressure, fallback,
    )  # fmt: skip


@entry(DECISION(_CONTROLLER, OBSERVATION))
def ask(controller: CompiledController, observation: Observation) -> Decision:
    """One decision of a compiled controller."""
    return controller.decide(observation, controller.model, controller.settings, controller.memory)


@entry(types.boolean(_RUN, _RULES, _CONTROLLER, _CONTROLLER))
def _loop(run: Run, rules: Rules, controller: CompiledController, fallback: CompiledController) -> bool:
    """Run until the end (True) or until the record is full (False)."""
    state, counters, vehicles, values, codes, counts = run
    decide, model, settings, memory, obeys_hold, wake_pressure = controller
    while counters[_ROW] < values.shape[1]:
        if not _begin(state, counters, vehicles, values, counts, rules):
            _close(counters[_ROW], values, codes)
            return True
        observation = _observe(state, counters, vehicles, rules)
        decision = decide(observation, model, settings, memory)
        _apply(
            state, counters, vehicles, values, codes, rules, observation, decision, obeys_hold, wake_pressure, fallback
        )
    return False


def start_run(scenario: Scenario, replication: int = 0, seed: int = 0) -> tuple[Run, Rules]:
    """A run of `scenario` before its first second."""
    station = scenario.station
    plant = station.constants()
    arriving = scenario.vehicles(replication, seed)
    vehicles = np.full((len(VEHICLE_COLUMNS), len(arriving.arrival)), np.nan)
    given = (_ARRIVAL, _START_PRESSURE, _START_TEMPERATURE, _VOLUME, _FINISH_PRESSURE)
    for column, figures in zip(given, arriving, strict=True):
        vehicles[column] = figures
    vehicles[_DELIVERED] = 0.0
    state = np.zeros(15)
    for buffer, tank in enumerate(station.buffers.all):
        pressure, temperature = tank.initial_pressure_bar, tank.initial_temperature_c
        state[_P + buffer], state[_T + buffer] = pressure, temperature
        state[_M + buffer] = gas_mass(pressure, temperature, tank.volume_m3)
    counters = np.zeros(5, np.int64)
    counters[_CURRENT] = -1
    run = Run(
        state, counters, vehicles, np.empty((len(VALUES), 0)), np.empty((len(CODES), 0), np.uint8),
        np.empty((len(COUNTS), 0), np.int32),
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
    second by second; both give the same bytes. Where the shield closes a valve, `controller.fallback` is asked, if
    it has one.

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
    wake_pressure = getattr(controller, "wake_pressure", NEVER)
    run = _longer(run)
    while begin(run, rules):
        observation = observe(run, rules)
        before = perf_counter()
        answer = controller.decide(observation)
        durations.append(perf_counter() - before)
        decision = checked(answer, controller.name, observation)
        apply(run, rules, observation, decision, bool(controller.obeys_hold), wake_pressure, fallback)
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
        command, status, cost, bound = cast("tuple[int, int, float, float]", answer)  # whatever a plug-in returned
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


def _record(scenario: Scenario, name: str, replication: int, seed: int, run: Run, timing: Timing) -> Record:
    rows = int(run.counters[_ROW]) + 1
    return Record(
        scenario, name, replication, seed, run.values[:, :rows], run.codes[:, :rows], run.counts[:, :rows],
        dict(zip(VEHICLE_COLUMNS, run.vehicles, strict=True)), timing,
    )  # fmt: skip
