"""One second of a run: arrivals, the shield, the plant, the record. Kernels for every caller."""

from __future__ import annotations

import numpy as np

from station.columns import VALUES, VEHICLE_COLUMNS
from station.compiled import inlined
from station.controller import NEVER, CompiledController, Decision, Observation, Status
from station.geometry import CLOSED, INLETS, OUTLETS, VEHICLE
from station.limits import compressor_margin
from station.liveness import kept_alive
from station.plants.interface import (
    COMPLETE,
    GOES_ON,
    OWN,
    Constants,
    M,
    P,
    T,
    advance,
    begin,
    fill_end,
    leave,
    leaves_at,
    metered,
    outlet_flow,
    own_columns,
    reads_nozzle,
    rest,
    timed_valves,
)
from station.run import (
    ARRIVAL,
    ARRIVED,
    BOUND,
    CLOCK,
    CONNECTED,
    CONNECTED_VEHICLE,
    COST,
    CURRENT,
    DELIVERED,
    DRY,
    FINAL_PRESSURE,
    FINISH_PRESSURE,
    FINISHED,
    FLOW_COMPRESSOR,
    FLOW_DISPENSER,
    MASS,
    NEAREST,
    NEXT,
    PERIOD,
    PRESSURE,
    PREVIOUS,
    QUEUE,
    READING,
    REFUSED,
    ROW,
    STALLED,
    START_PRESSURE,
    START_TEMPERATURE,
    STATUS,
    TEMPERATURE,
    TIME,
    VOLUME,
    RunParameters,
    kept_closed,
)
from station.sensors import OFF, advance_tube, connect_tube, measure
from station.shield import limits_of, shielded_command, valve_limits
from station.valves import ValveLimits, refused_limit, shield

_LIVENESS = int(Status.LIVENESS)
_VALUES, _COLUMNS = len(VALUES), len(VEHICLE_COLUMNS)

FAR = -1e6
"""How near a buffer has been to giving gas when a vehicle comes [bar]: none has."""

# Kernels take the arrays of a RunState one by one: taking them out of the tuple in each would count references, which
# costs more than the second they advance.


@inlined
def begin_second(
    state: np.ndarray, counters: np.ndarray, vehicles: np.ndarray, values: np.ndarray, counts: np.ndarray,
    parameters: RunParameters,
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
        vehicles[CONNECTED, new] = time
        pressure, temperature = vehicles[START_PRESSURE, new], vehicles[START_TEMPERATURE, new]
        volume, finish = vehicles[VOLUME, new], vehicles[FINISH_PRESSURE, new]
        begin(state, VEHICLE, pressure, temperature, volume, finish, parameters.plant)
        state[READING], state[READING + 1] = pressure, temperature
        state[STALLED], state[DRY], state[NEAREST] = 0.0, 0.0, FAR
    row = counters[ROW]
    current = counters[CURRENT]
    values[TIME, row] = time
    for tank in range(4):
        present = tank != VEHICLE or current >= 0
        values[PRESSURE + tank, row] = state[P + tank] if present else np.nan
        values[TEMPERATURE + tank, row] = state[T + tank] if present else np.nan
        values[MASS + tank, row] = state[M + tank] if present else np.nan
    rates, levels, _ = own_columns(parameters.plant)
    for place in range(rates, rates + levels):
        values[_VALUES + place, row] = state[OWN + place]
    counts[CONNECTED_VEHICLE, row] = current
    counts[QUEUE, row] = counters[ARRIVED] - counters[NEXT]
    served = current < 0 and counters[NEXT] == total
    return not (time >= parameters.time_limit or (served and counters[PREVIOUS] & INLETS == 0))


@inlined
def _announced(
    place: int, state: np.ndarray, counters: np.ndarray, vehicles: np.ndarray, parameters: RunParameters
) -> float:
    """When the vehicle at `place` among those still to come arrives [s], if it has said so by now."""
    coming = counters[ARRIVED] + place
    if coming < vehicles.shape[1] and vehicles[ARRIVAL, coming] - state[CLOCK] <= parameters.announcement:
        return float(vehicles[ARRIVAL, coming])
    return np.inf


@inlined
def _told(seen: Observation, parameters: RunParameters) -> Observation:
    """An observation that tells of the inlet, too, which the slot keeps closed."""
    closed = kept_closed(seen, parameters)
    if closed == 0:
        return seen
    return Observation(
        seen.time, seen.period, seen.pressure, seen.temperature, seen.vehicle, seen.vehicle_pressure,
        seen.vehicle_temperature, seen.vehicle_volume, seen.communication, seen.queue_length, seen.previous,
        seen.finish_pressure, seen.announced, seen.energy, (seen.timed[0], seen.timed[1] | closed),
    )  # fmt: skip


@inlined
def observation_of(
    state: np.ndarray, counters: np.ndarray, vehicles: np.ndarray, parameters: RunParameters
) -> Observation:
    """Observation of this second, as the controller is given it."""
    current = counters[CURRENT]
    live = parameters.communication or reads_nozzle(parameters.plant)
    pressure, temperature, volume, finish = np.nan, np.nan, parameters.usual_volume, parameters.usual_finish
    if current >= 0:
        pressure, temperature = state[READING], state[READING + 1]
        if parameters.communication:
            temperature = state[T + VEHICLE]
            volume = vehicles[VOLUME, current]
        if live:
            pressure = state[P + VEHICLE]
            finish = leaves_at(state, vehicles[FINISH_PRESSURE, current], parameters.plant)
    true = Observation(
        state[CLOCK],
        PERIOD,
        (state[P], state[P + 1], state[P + 2]),
        (state[T], state[T + 1], state[T + 2]),
        current,
        pressure,
        temperature,
        volume,
        live,
        counters[ARRIVED] - counters[NEXT],
        counters[PREVIOUS],
        finish,
        (
            _announced(0, state, counters, vehicles, parameters),
            _announced(1, state, counters, vehicles, parameters),
            _announced(2, state, counters, vehicles, parameters),
            _announced(3, state, counters, vehicles, parameters),
        ),
        metered(state, parameters.plant),
        timed_valves(state, parameters.plant),
    )
    if parameters.sensors.kind == OFF:
        return _told(true, parameters)
    predicted = not parameters.communication and current >= 0 and vehicles[CONNECTED, current] < state[CLOCK]
    return _told(measure(state, true, predicted, parameters.sensors), parameters)


@inlined
def _fed_instead(command: int, stuck: int, state: np.ndarray, plant: Constants) -> int:
    """The inlets through which gas flows where the one in `stuck` is open whatever it is told.

    What is compressed flows into the buffer of less pressure: it is taken from the fullest of those that are told to be
    filled. A compressor that does not work fills none.
    """
    for buffer in range(3):
        if stuck & ~command & 1 << buffer and compressor_margin(buffer, state[P + buffer], plant) > 0.0:
            fullest = -1
            for other in range(3):
                if command & 1 << other and state[P + other] > state[P + (buffer if fullest < 0 else fullest)]:
                    fullest = other
            if fullest >= 0:
                command = command & ~(1 << fullest) | 1 << buffer
    return command


@inlined
def opened_by(command: int, state: np.ndarray, connected: bool, parameters: RunParameters) -> int:
    """The valves through which gas flows under a command: those that stick stay as they are."""
    stuck = parameters.stuck_open
    if stuck | parameters.stuck_closed == 0:
        return command
    moved = command & ~parameters.stuck_closed
    moved = _fed_instead(moved, stuck & INLETS, state, parameters.plant)
    return moved | possible_part(stuck & OUTLETS, state, connected, parameters.plant)


@inlined
def _advance(
    state: np.ndarray, counters: np.ndarray, vehicles: np.ndarray, values: np.ndarray, codes: np.ndarray,
    parameters: RunParameters,
    command: int,
) -> None:  # fmt: skip
    """Apply a command for one second; write flows and valves, as they are told, to the record."""
    row, plant = counters[ROW], parameters.plant
    current = counters[CURRENT]
    for valve in range(6):
        codes[valve, row] = command >> valve & 1
    volume = vehicles[VOLUME, current] if current >= 0 else 0.0
    spent = advance(state, volume, opened_by(command, state, current >= 0, parameters), PERIOD, plant)
    rates, levels, figures = own_columns(plant)
    if current >= 0:
        vehicles[DELIVERED, current] += PERIOD * spent.dispensed
        vehicles[FINAL_PRESSURE, current] = state[P + VEHICLE]
        for place in range(figures):
            vehicles[_COLUMNS + place, current] = state[OWN + rates + levels + place]
    for place in range(rates):
        values[_VALUES + place, row] = state[OWN + place]
    values[FLOW_COMPRESSOR, row] = spent.compressed
    values[FLOW_DISPENSER, row] = spent.dispensed


@inlined
def _below(state: np.ndarray, pressure: tuple[float, float, float]) -> tuple[bool, bool, bool]:
    """Which buffers lie below these pressures [bar]."""
    return state[P] < pressure[0], state[P + 1] < pressure[1], state[P + 2] < pressure[2]


@inlined
def _rest(
    state: np.ndarray,
    counters: np.ndarray,
    vehicles: np.ndarray,
    parameters: RunParameters,
    obeys_hold: bool,
    wake_pressure: tuple[float, float, float],
    limits: ValveLimits,
    below: tuple[bool, bool, bool],
) -> None:
    """Let seconds pass that nobody decides: closed buffers go on towards ambient temperature.

    The rest ends with the idle period, with an arrival, and when something differs from the second of the decision:
    a limit forbids a valve or no longer does, or a buffer has fallen below the controller's `wake_pressure`.
    """
    plant = parameters.plant
    until = min(state[CLOCK] - PERIOD + parameters.idle_period, parameters.time_limit)
    if counters[ARRIVED] < vehicles.shape[1]:
        until = min(until, vehicles[ARRIVAL, counters[ARRIVED]])
    while state[CLOCK] < until:
        if limits_of(state, False, CLOSED, obeys_hold, plant) != limits or _below(state, wake_pressure) != below:
            break
        rest(state, PERIOD, plant)
        state[CLOCK] += PERIOD


@inlined
def apply_decision(
    state: np.ndarray, counters: np.ndarray, vehicles: np.ndarray, values: np.ndarray, codes: np.ndarray,
    parameters: RunParameters, observation: Observation, decision: Decision, obeys_hold: bool,
    wake_pressure: tuple[float, float, float], fallback: CompiledController,
) -> None:  # fmt: skip
    """Shield a decision, apply it, record it, move the clock, and let a vehicle leave.

    It leaves when it is filled, when a limit ends its fill, or (`RunParameters.incomplete`) when nothing could be given
    to it for too long.
    """
    row = counters[ROW]
    unseen = parameters.sensors.kind != OFF and not parameters.communication and counters[CURRENT] >= 0
    if unseen and vehicles[CONNECTED, counters[CURRENT]] == state[CLOCK]:
        connect_tube(state, observation, parameters.sensors)
    limits = valve_limits(state, observation, obeys_hold, parameters)
    own = shielded_command(state, decision, unseen, limits, parameters, observation, fallback, codes, row)
    command = own
    if counters[CURRENT] >= 0 and parameters.liveness < np.inf:
        command = kept_alive(own, state, limits, parameters, observation, fallback)
    values[COST, row] = decision.cost
    values[BOUND, row] = decision.bound
    codes[STATUS, row] = decision.status if command == own else _LIVENESS
    _execute(
        state, counters, vehicles, values, codes, parameters, observation, command, unseen, obeys_hold, wake_pressure,
        limits,
    )  # fmt: skip


@inlined
def possible_part(command: int, state: np.ndarray, connected: bool, plant: Constants) -> int:
    """The valves of a command through which gas can flow the right way; the others have nothing to give, or nobody to.

    An inlet is closed of a buffer that is not below the pressure to which it is filled, an outlet where no vehicle is
    connected or its pressure is not below the buffer's.
    """
    for buffer in range(3):
        if not compressor_margin(buffer, state[P + buffer], plant) > 0.0:
            command &= ~(1 << buffer)
        if not connected or not outlet_flow(state[P + buffer], state[P + VEHICLE], plant) > 0.0:
            command &= ~(8 << buffer)
    return command


@inlined
def apply_unshielded(
    state: np.ndarray, counters: np.ndarray, vehicles: np.ndarray, values: np.ndarray, codes: np.ndarray,
    parameters: RunParameters, observation: Observation, decision: Decision, obeys_hold: bool,
) -> None:  # fmt: skip
    """Apply a decision of an undisturbed run as it stands, record it, move the clock, and let a vehicle leave.

    Limits hold nothing back; the record's refused valves are those that they would have refused.
    """
    row, plant = counters[ROW], parameters.plant
    limits = valve_limits(state, observation, obeys_hold, parameters)
    refusals = shield(decision.command, CLOSED, limits, plant.compressor_count)[1]
    for valve in range(6):
        codes[REFUSED + valve, row] = refused_limit(refusals, valve)
    values[COST, row] = decision.cost
    values[BOUND, row] = decision.bound
    codes[STATUS, row] = decision.status
    command = possible_part(decision.command, state, counters[CURRENT] >= 0, plant)
    _execute(
        state, counters, vehicles, values, codes, parameters, observation, command, False, obeys_hold, NEVER, limits
    )  # fmt: skip


@inlined
def _execute(
    state: np.ndarray, counters: np.ndarray, vehicles: np.ndarray, values: np.ndarray, codes: np.ndarray,
    parameters: RunParameters, observation: Observation, command: int, unseen: bool, obeys_hold: bool,
    wake_pressure: tuple[float, float, float], limits: ValveLimits,
) -> None:  # fmt: skip
    """Let a second pass under a command, move the clock, and let a vehicle leave."""
    row, plant = counters[ROW], parameters.plant
    resting = command == CLOSED and counters[CURRENT] < 0 and parameters.idle_period > PERIOD
    below = _below(state, wake_pressure)
    if resting:
        limits = limits_of(state, False, CLOSED, obeys_hold, plant)
    if unseen:
        advance_tube(state, observation, command, parameters.sensors)
    _advance(state, counters, vehicles, values, codes, parameters, command)
    state[CLOCK] += PERIOD
    if resting:
        _rest(state, counters, vehicles, parameters, obeys_hold, wake_pressure, limits, below)
    counters[PREVIOUS] = command
    counters[ROW] = row + 1
    current = counters[CURRENT]
    if current >= 0:
        end = fill_end(state, vehicles[FINISH_PRESSURE, current], plant)
        if end == COMPLETE:
            vehicles[FINISHED, current] = state[CLOCK]
        if end != GOES_ON or state[DRY] >= parameters.incomplete:
            counters[CURRENT] = -1
            leave(state, plant)


@inlined
def close_record(row: int, values: np.ndarray, codes: np.ndarray, plant: Constants) -> None:
    """Fill the row of the final state: every valve closed, nothing flows."""
    for place in range(own_columns(plant)[0]):
        values[_VALUES + place, row] = 0.0
    for column in range(codes.shape[0]):
        codes[column, row] = 0
    values[FLOW_COMPRESSOR, row] = 0.0
    values[FLOW_DISPENSER, row] = 0.0
    values[COST, row] = np.nan
    values[BOUND, row] = np.nan
