"""Kernels that advance many runs by a second in one call, and what a program that learns is shown of each.

Commands come from outside, an array with one for each run. The seconds are those of `station.kernels`: the same
functions advance them.
"""

from __future__ import annotations

import numpy as np
from numba import types

from station.arrivals import COUNT_MAX, PERIOD_MAX
from station.compiled import entry, inlined, uncounted
from station.control_model import ControlModel
from station.controller import NEVER, OBSERVATION, PLANT, CompiledController, Decision, Observation, Status
from station.geometry import BUFFERS, CLOSED, INLETS, KELVIN, OUTLETS, VALVES
from station.kernels import CONTROLLER, PARAMETERS
from station.plants.interface import metered, timed_valves
from station.quantities import PRESSURE_MAX, VOLUME_MAX
from station.run import (
    ARRIVAL,
    ARRIVED,
    CLOCK,
    CURRENT,
    FLOW_DISPENSER,
    NEXT,
    PERIOD,
    PREVIOUS,
    REFUSED,
    ROW,
    STATUS,
    RunParameters,
)
from station.shield import valve_limits
from station.step import apply_decision, apply_unshielded, begin_second, close_record, observation_of
from station.valves import admitted_valves, count_inlets, shield

_LIVENESS = int(Status.LIVENESS)

TEMPERATURE_MAX = 1000.0
"""No tank that is filled without a shield is shown warmer [deg C]."""

NONE_COMING = 86_400.0
"""Shown of the next arrival where nobody has announced one: as long as vehicles can announce themselves before [s]."""

OBSERVED: dict[str, tuple[str, float, float]] = {
    "time": ("s", 0.0, 3.0 * PERIOD_MAX),
    **{f"pressure_{buffer}": ("bar", 0.0, PRESSURE_MAX) for buffer in BUFFERS},
    **{f"temperature_{buffer}": ("degC", -KELVIN, TEMPERATURE_MAX) for buffer in BUFFERS},
    "vehicle": ("1", 0.0, 1.0),
    "pressure_vehicle": ("bar", 0.0, PRESSURE_MAX),
    "temperature_vehicle": ("degC", -KELVIN, TEMPERATURE_MAX),
    "volume_vehicle": ("m3", 0.0, VOLUME_MAX),
    "finish_pressure": ("bar", 0.0, PRESSURE_MAX),
    "queue_length": ("vehicles", 0.0, float(COUNT_MAX)),
    **dict.fromkeys(VALVES, ("1", 0.0, 1.0)),
    "next_arrival": ("s", 0.0, NONE_COMING),
}
"""Entries of an observation as a vector: unit, least and greatest value. Valves are those of the second before.

Without a vehicle its pressure and temperature are 0; `next_arrival` is the time until the first vehicle arrives that
has announced itself.
"""

COSTS = {
    "waiting": "s",
    "compressor": "s",
    "dispensing": "s",
    "delivered": "g",
    "energy": "kWh",
    "refused": "valves",
    "liveness": "s",
}
"""Cost components of a step and their units; over a run they sum to the figures of its metrics.

`waiting` is vehicle-seconds in the queue, `compressor` seconds times compressors at work, `dispensing` seconds with an
outlet open, `energy` what the plant's meter counted (NaN where it has none), `refused` valves that a limit refused,
`liveness` seconds in which the liveness rule decided.
"""

WAITING, COMPRESSOR, DISPENSING, DELIVERED, ENERGY, REFUSALS, STOOD_IN = range(len(COSTS))
RUNNING, SERVED, TIME_OVER = 0, 1, 2

_LOW = np.array([low for _, low, _ in OBSERVED.values()])
_HIGH = np.array([high for _, _, high in OBSERVED.values()])
_VALVES_AT = list(OBSERVED).index(VALVES[0])


@inlined
def _write(observation: Observation, out: np.ndarray) -> None:
    """Write an observation as a vector, (len(OBSERVED),)."""
    connected = observation.vehicle >= 0
    out[0] = observation.time
    for buffer in range(3):
        out[1 + buffer] = observation.pressure[buffer]
        out[4 + buffer] = observation.temperature[buffer]
    out[7] = 1.0 if connected else 0.0
    out[8] = observation.vehicle_pressure if connected else 0.0
    out[9] = observation.vehicle_temperature if connected else 0.0
    out[10] = observation.vehicle_volume
    out[11] = observation.finish_pressure
    out[12] = observation.queue_length
    for valve in range(6):
        out[_VALVES_AT + valve] = observation.previous >> valve & 1
    out[_VALVES_AT + 6] = observation.announced[0] - observation.time
    for place in range(out.shape[0]):
        out[place] = min(max(out[place], _LOW[place]), _HIGH[place])


@entry(types.void(OBSERVATION, types.float32[::1]))
def write_observation(observation: Observation, out: np.ndarray) -> None:
    """Write what a controller is shown as the vector of `OBSERVED`, (len(OBSERVED),) float32."""
    _write(observation, out)


@entry(types.int64(OBSERVATION, PLANT))
def admitted_by_model(observation: Observation, model: ControlModel) -> int:
    """The valves that a controller's model says may open, as bits of Valve."""
    pressure, temperature = observation.pressure, observation.temperature
    return admitted_valves(
        (pressure[0], pressure[1], pressure[2], observation.vehicle_pressure),
        (temperature[0], temperature[1], temperature[2], observation.vehicle_temperature),
        observation.vehicle >= 0,
        observation.previous,
        model,
        observation.period,
    )


@inlined
def _mask(
    observation: Observation, state: np.ndarray, obeys_hold: bool, parameters: RunParameters, commands: np.ndarray,
    mask: np.ndarray,
) -> None:  # fmt: skip
    """Write which of `commands` pass the shield as they are: 1, or 0."""
    plant = parameters.plant
    limits = valve_limits(state, observation, obeys_hold, parameters)
    kept = shield(timed_valves(state, plant)[0], CLOSED, limits, plant.compressor_count)[0]
    admitted = 0
    for buffer in range(3):
        admitted |= (1 << buffer) if limits.inlet[buffer] == 0 else 0
        admitted |= (8 << buffer) if limits.outlet[buffer] == 0 else 0
    for place in range(commands.shape[0]):
        command = commands[place]
        mask[place] = 1 if command & ~admitted == 0 and command & kept == kept else 0


@inlined
def _begin(
    state: np.ndarray, counters: np.ndarray, vehicles: np.ndarray, values: np.ndarray, codes: np.ndarray,
    counts: np.ndarray, parameters: RunParameters, costs: np.ndarray,
) -> int:  # fmt: skip
    """Begin the second of a run; RUNNING, or why it is over. What vehicles waited before they were seen is counted."""
    before = counters[ARRIVED]
    going = begin_second(state, counters, vehicles, values, counts, parameters)
    close_record(counters[ROW], values, codes, parameters.plant)  # of the run as it stands, whoever asks for it
    for vehicle in range(before, counters[ARRIVED]):
        costs[WAITING] += state[CLOCK] - vehicles[ARRIVAL, vehicle]
    if going:
        return RUNNING
    served = counters[CURRENT] < 0 and counters[NEXT] == vehicles.shape[1] and counters[PREVIOUS] & INLETS == 0
    return SERVED if served else TIME_OVER


@inlined
def _account(
    state: np.ndarray, counters: np.ndarray, values: np.ndarray, codes: np.ndarray, row: int, began: float,
    energy: float, queue: int, parameters: RunParameters, costs: np.ndarray,
) -> None:  # fmt: skip
    """Write the cost components of the step whose row was `row` and which began at `began` [s]."""
    span, command = state[CLOCK] - began, counters[PREVIOUS]
    costs[WAITING] = queue * span
    costs[COMPRESSOR] = count_inlets(command) * span
    costs[DISPENSING] = span if command & OUTLETS else 0.0
    costs[DELIVERED] = values[FLOW_DISPENSER, row] * PERIOD
    costs[ENERGY] = metered(state, parameters.plant) - energy
    refused = 0.0
    for valve in range(6):
        refused += 1.0 if codes[REFUSED + valve, row] != 0 else 0.0
    costs[REFUSALS] = refused
    costs[STOOD_IN] = span if codes[STATUS, row] == _LIVENESS else 0.0


@uncounted
def _begin_all(
    states: np.ndarray, counters: np.ndarray, vehicles: np.ndarray, sizes: np.ndarray, values: np.ndarray,
    codes: np.ndarray, counts: np.ndarray, parameters: RunParameters, obeys_hold: bool, commands: np.ndarray,
    shown: np.ndarray, masks: np.ndarray, costs: np.ndarray, over: np.ndarray,
) -> None:  # fmt: skip
    for run in range(states.shape[0]):
        state, counter, table = states[run], counters[run], vehicles[run][:, : sizes[run]]
        over[run] = _begin(state, counter, table, values[run], codes[run], counts[run], parameters, costs[run])
        observation = observation_of(state, counter, table, parameters)
        _write(observation, shown[run])
        _mask(observation, state, obeys_hold, parameters, commands, masks[run])


@uncounted
def _apply_all(
    states: np.ndarray, counters: np.ndarray, vehicles: np.ndarray, sizes: np.ndarray, values: np.ndarray,
    codes: np.ndarray, parameters: RunParameters, obeys_hold: bool, asked: np.ndarray, active: np.ndarray,
    shielded: bool, keeping: bool, fallback: CompiledController, memories: np.ndarray, costs: np.ndarray,
) -> None:  # fmt: skip
    for run in range(states.shape[0]):
        if not active[run]:
            continue
        state, counter, table = states[run], counters[run], vehicles[run][:, : sizes[run]]
        observation = observation_of(state, counter, table, parameters)
        began, row, queue = state[CLOCK], counter[ROW], counter[ARRIVED] - counter[NEXT]
        energy = metered(state, parameters.plant)
        decision = Decision(asked[run], 0, np.nan, np.nan)
        if shielded:
            own = CompiledController(
                fallback.decide, fallback.model, fallback.settings, memories[run], fallback.obeys_hold,
                fallback.wake_pressure,
            )  # fmt: skip
            apply_decision(
                state, counter, table, values[run], codes[run], parameters, observation, decision, obeys_hold, NEVER,
                own,
            )  # fmt: skip
        else:
            apply_unshielded(
                state, counter, table, values[run], codes[run], parameters, observation, decision, obeys_hold
            )  # fmt: skip
        _account(state, counter, values[run], codes[run], row, began, energy, queue, parameters, costs[run])
        if not keeping:
            counter[ROW] = 0


_FLAG, _NUMBERS, _WHOLE = types.boolean, types.float64, types.int64
_RUNS = _NUMBERS[:, ::1], _WHOLE[:, ::1], _NUMBERS[:, :, ::1], _WHOLE[::1], _NUMBERS[:, :, ::1], types.uint8[:, :, ::1]


@entry(
    *(
        types.void(
            *_RUNS, types.int32[:, :, ::1], each, _FLAG, _WHOLE[::1], types.float32[:, ::1], types.int8[:, ::1],
            _NUMBERS[:, ::1], _WHOLE[::1],
        )
        for each in PARAMETERS
    )
)  # fmt: skip
def begin_runs(
    states: np.ndarray, counters: np.ndarray, vehicles: np.ndarray, sizes: np.ndarray, values: np.ndarray,
    codes: np.ndarray, counts: np.ndarray, parameters: RunParameters, obeys_hold: bool, commands: np.ndarray,
    shown: np.ndarray, masks: np.ndarray, costs: np.ndarray, over: np.ndarray,
) -> None:  # fmt: skip
    """Begin a second of every run; write what is shown of each, its mask, and RUNNING or why it is over.

    Arrays have a run in each entry of their first axis: those of a RunState, `vehicles` with room for more than the
    `sizes` that there are; `shown` is (runs, len(OBSERVED)), `masks` (runs, commands), `costs` (runs, len(COSTS)).
    """
    _begin_all(
        states, counters, vehicles, sizes, values, codes, counts, parameters, obeys_hold, commands, shown, masks, costs,
        over,
    )  # fmt: skip


@entry(
    *(
        types.void(
            *_RUNS, each, _FLAG, _WHOLE[::1], types.boolean[::1], _FLAG, _FLAG, CONTROLLER, _NUMBERS[:, ::1],
            _NUMBERS[:, ::1],
        )
        for each in PARAMETERS
    )
)  # fmt: skip
def apply_runs(
    states: np.ndarray, counters: np.ndarray, vehicles: np.ndarray, sizes: np.ndarray, values: np.ndarray,
    codes: np.ndarray, parameters: RunParameters, obeys_hold: bool, asked: np.ndarray, active: np.ndarray,
    shielded: bool, keeping: bool, fallback: CompiledController, memories: np.ndarray, costs: np.ndarray,
) -> None:  # fmt: skip
    """Apply the command `asked` of each run that is `active`, and write what its step cost.

    `memories` (runs, entries) are the fallback's, one for each run. Without `keeping` a run's row is written over by
    the next.
    """
    _apply_all(
        states, counters, vehicles, sizes, values, codes, parameters, obeys_hold, asked, active, shielded, keeping,
        fallback, memories, costs,
    )  # fmt: skip
