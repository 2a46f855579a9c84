"""The switched controller: plans by beam search when something has happened, and keeps to the plan's first command."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from controllers.arrivals import (
    ARRIVALS_SIZE,
    expected_arrivals,
    mean_demand,
    mean_gap,
    vehicles_seen,
    watch_arrivals,
    watch_demand,
)
from controllers.base import CompiledBase
from controllers.estimate import ESTIMATE_SIZE, estimate_vehicle, use_station_prediction
from controllers.switched.bound import plan_bound
from controllers.switched.parts import (
    COMMAND,
    CONNECTED,
    MASS,
    SIZE,
    TEMPERATURE,
    VEHICLE_MASS,
    VEHICLE_TEMPERATURE,
    Task,
    longest_step,
)
from controllers.switched.peak import METER_SIZE, PEAK_SIZE, is_barred, peak_in, watch_meter
from controllers.switched.search import plan
from controllers.switched.settings import FOLLOW_MAX, SwitchedSettings
from controllers.switched.vector import (
    BLOCK,
    BOUNDED,
    FOLLOW,
    OFF,
    ON,
    PEAK,
    WIDTH,
    blocks_of,
    commands_of,
    demand_of,
    fills_of,
    first_gap_of,
    pace_of,
    prices_of,
    settings_vector,
    terminal_costs_of,
    usual_demand_of,
)
from station.compiled import callback, kernel
from station.control_model import ControlModel, as_thesis, is_thesis
from station.controller import DECIDE, CompiledController, Decision, Observation, Status
from station.geometry import INLETS, OUTLETS
from station.planning import Model, gas_mass
from station.valves import admitted_valves

EXPECTED = 16
"""Arrivals a plan looks ahead to: two horizons of a busy station."""

_NONE = -1.0  # in place of a command that no plan has
_STEP = 6.0  # longest step of a plan's model [s]
_FEASIBLE = int(Status.FEASIBLE)

# Entries of memory behind the estimate's and the arrivals'.
_OWN = ESTIMATE_SIZE + ARRIVALS_SIZE
_BEGUN, _PLANNED, _COMMAND, _ALLOWED, _VEHICLE, _QUEUE, _COST, _BOUND, _NEXT, _DUE = range(_OWN, _OWN + 10)
_AGE = _OWN + 10  # seconds since each valve last moved
_LATER = _AGE + 6  # the plan's commands, as many as can be followed; those that it has not are none
_METER = _LATER + FOLLOW_MAX
MEMORY_SIZE = _METER + METER_SIZE
"""Entries of memory `decide_with` uses."""

STATES_IN_TIME = 20_000
"""States kept by a plan that is made within some 50 ms."""

LONG_AGO = 1e9
"""Age of a valve before it has moved [s]."""


class Look(NamedTuple):
    """Inputs of a plan that a second shows."""

    start: np.ndarray  # the state a plan starts from; empty where there is none to make
    bound: int  # valves that must stay as they are
    allowed: int  # valves that no limit on the state forbids, nor the peak
    happened: bool  # whether there is a reason to plan anew


@kernel
def _allowed(observation: Observation, vehicle: tuple[float, float], model: Model) -> int:
    """Valves that no limit on the state forbids, as bits."""
    p, t = observation.pressure, observation.temperature
    return admitted_valves(
        (p[0], p[1], p[2], vehicle[0]), (t[0], t[1], t[2], vehicle[1]), observation.vehicle >= 0,
        observation.previous, model, observation.period,
    )  # fmt: skip


@kernel
def _bound_valves(observation: Observation, settings: np.ndarray, memory: np.ndarray) -> int:
    """Valves that must stay as they are: their minimum on or off time is not over."""
    bound = 0
    for valve in range(6):
        least = settings[ON] if observation.previous >> valve & 1 else settings[OFF]
        bound |= (1 << valve) if memory[_AGE + valve] < least else 0
    return bound


@kernel
def _follow(observation: Observation, allowed: int, settings: np.ndarray, memory: np.ndarray) -> bool:
    """Go on to the plan's next command, if it has one that still holds: False if it has not."""
    place = int(memory[_NEXT])
    if place >= int(settings[FOLLOW]) or observation.time > memory[_DUE]:
        return False
    command = int(memory[_LATER + place])
    if command < 0:
        return False
    moved = command ^ int(memory[_COMMAND])
    if command & ~allowed != 0 or moved & _bound_valves(observation, settings, memory) != 0:
        return False
    memory[_NEXT] += 1.0
    memory[_PLANNED], memory[_COMMAND] = observation.time, command
    return True


@kernel
def _happened(observation: Observation, allowed: int, settings: np.ndarray, memory: np.ndarray) -> bool:
    """Whether there is a reason to plan anew: a block over, a vehicle come or gone, a valve barred or freed."""
    command = int(memory[_COMMAND])
    stuck = observation.vehicle >= 0 and command & OUTLETS == 0
    freed = allowed & ~int(memory[_ALLOWED]) & OUTLETS != 0
    return bool(
        memory[_BEGUN] == 0.0
        or (
            observation.time - memory[_PLANNED] >= settings[BLOCK]
            and not _follow(observation, allowed, settings, memory)
        )
        or observation.vehicle != memory[_VEHICLE]
        or observation.queue_length != memory[_QUEUE]
        or command & ~allowed != 0
        or (stuck and freed)
    )


@kernel
def _start_of(observation: Observation, command: int, vehicle: tuple[float, float], model: Model) -> np.ndarray:
    """The state a plan starts from, in which the valves of `command` are open."""
    start = np.zeros(SIZE)
    for buffer in range(3):
        pressure, temperature = observation.pressure[buffer], observation.temperature[buffer]
        start[MASS + buffer] = gas_mass(pressure, temperature, model.buffer_volume[buffer], model)
        start[TEMPERATURE + buffer] = temperature
    if observation.vehicle >= 0:
        start[CONNECTED] = 1.0
        start[VEHICLE_MASS] = gas_mass(vehicle[0], vehicle[1], observation.vehicle_volume, model)
        start[VEHICLE_TEMPERATURE] = vehicle[1]
    start[COMMAND] = command
    return start


@kernel
def task_of(observation: Observation, model: Model, settings: np.ndarray, memory: np.ndarray, due: np.ndarray) -> Task:
    """The problem of this second, with vehicles to come in `due` [s]; `memory` is `look`'s."""
    arrivals = memory[ESTIMATE_SIZE:_OWN]
    asked = mean_demand(arrivals)
    pace = pace_of(settings, mean_gap(arrivals) / asked, vehicles_seen(arrivals), asked)
    demand = demand_of(observation.vehicle_volume, observation.finish_pressure, asked, settings)
    return Task(
        model,
        demand,
        prices_of(settings, pace),
        observation.queue_length,
        due,
        blocks_of(settings),
        _STEP,
        terminal_costs_of(demand, model, settings),
        fills_of(settings, pace),
        gas_mass(demand.next_finish, demand.next_temperature, demand.next_volume, model),
        commands_of(settings),
    )


@kernel
def bound_of(start: np.ndarray, task: Task) -> float:
    """A lower bound on the cost of every plan for a problem."""
    return plan_bound(
        (start[MASS], start[MASS + 1], start[MASS + 2]),
        (start[TEMPERATURE], start[TEMPERATURE + 1], start[TEMPERATURE + 2]),
        start[VEHICLE_MASS], start[VEHICLE_TEMPERATURE], start[CONNECTED] != 0.0, task.waiting, task.coming,
        task.terminal, np.sum(task.blocks), longest_step(np.max(task.blocks), task.step), task.demand, task.prices,
        task.model,
    )  # fmt: skip


@kernel
def told_bound(start: np.ndarray, task: Task, settings: np.ndarray) -> float:
    """The lower bound that a decision tells; NaN where it is not wanted."""
    return bound_of(start, task) if settings[BOUNDED] != 0.0 else np.nan


@kernel
def look(observation: Observation, known: Model, model: Model, settings: np.ndarray, memory: np.ndarray) -> Look:
    """Inputs of a plan at this second. Limits are asked of the station as `known`; `memory` is (MEMORY_SIZE,)."""
    watch_arrivals(observation, first_gap_of(settings), memory[ESTIMATE_SIZE:_OWN])
    usual, finish = usual_demand_of(settings)
    watch_demand(observation, usual, finish, memory[ESTIMATE_SIZE:_OWN])
    vehicle = estimate_vehicle(observation, model, memory)
    allowed, barred = _allowed(observation, vehicle, known), 0
    if settings[PEAK] < np.inf:
        entries, meter = settings[PEAK : PEAK + PEAK_SIZE], memory[_METER:MEMORY_SIZE]
        watch_meter(observation, peak_in(entries), meter)
        if is_barred(observation, entries, meter):
            barred = INLETS
            allowed &= ~barred
    if memory[_BEGUN] == 0.0:
        memory[_AGE : _AGE + 6] = LONG_AGO
    happened = _happened(observation, allowed, settings, memory)
    bound = _bound_valves(observation, settings, memory) | barred
    start = _start_of(observation, observation.previous & ~barred, vehicle, model) if happened else np.empty(0)
    return Look(start, bound, allowed, happened)


@kernel
def note_plan(time: float, command: int, cost: float, bound: float, memory: np.ndarray) -> None:
    """Put a plan in force: its first command, its cost and what no plan undercuts."""
    memory[_BEGUN], memory[_PLANNED] = 1.0, time
    memory[_COMMAND], memory[_COST], memory[_BOUND] = command, cost, bound


@kernel
def planned_command(allowed: int, memory: np.ndarray) -> Decision:
    """Command of the plan in force for this second; a valve that a limit forbids is closed."""
    return Decision(int(memory[_COMMAND]) & allowed, _FEASIBLE, memory[_COST], memory[_BOUND])


@kernel
def note_command(observation: Observation, command: int, allowed: int, memory: np.ndarray) -> None:
    """Note what is done in this second."""
    memory[_COMMAND], memory[_ALLOWED] = command, allowed
    memory[_VEHICLE], memory[_QUEUE] = observation.vehicle, observation.queue_length
    for valve in range(6):
        moved = (command ^ observation.previous) >> valve & 1
        memory[_AGE + valve] = observation.period if moved else memory[_AGE + valve] + observation.period


@kernel
def carry_on(observation: Observation, allowed: int, memory: np.ndarray) -> Decision:
    """The decision of this second by the plan in force."""
    decision = planned_command(allowed, memory)
    note_command(observation, decision.command, allowed, memory)
    return decision


@kernel
def leave_plan(memory: np.ndarray) -> None:
    """Follow the plan in force no further than its command of now."""
    memory[_NEXT] = FOLLOW_MAX


@kernel
def note_sequence(commands: np.ndarray, due: float, memory: np.ndarray) -> None:
    """Note with which commands the plan in force goes on, block by block, unless `due` [s] passes before."""
    memory[_NEXT], memory[_DUE] = 1.0, due
    kept = min(FOLLOW_MAX, commands.size)
    memory[_LATER : _LATER + kept] = commands[:kept]
    memory[_LATER + kept : _METER] = _NONE


@kernel
def plan_anew(observation: Observation, seen: Look, model: Model, settings: np.ndarray, memory: np.ndarray) -> None:
    """Search a plan from what a second shows, and put it in force."""
    due = np.empty(EXPECTED)
    expected_arrivals(observation, memory[ESTIMATE_SIZE:_OWN], due)
    task = task_of(observation, model, settings, memory, due)
    commands = np.empty(task.blocks.size, np.int64)
    cost, _ = plan(seen.start, seen.bound, seen.allowed, task, int(settings[WIDTH]), commands)
    note_plan(observation.time, commands[0], cost, told_bound(seen.start, task, settings), memory)
    note_sequence(commands, observation.time + due[0], memory)


@kernel
def decide_with(
    observation: Observation, known: Model, model: Model, settings: np.ndarray, memory: np.ndarray
) -> Decision:
    """The first command of the plan in force; a new plan where something has happened.

    Limits are asked of the station as `known`, plans are made with `model`. `memory` is (MEMORY_SIZE,).
    """
    seen = look(observation, known, model, settings, memory)
    if seen.happened:
        plan_anew(observation, seen, model, settings, memory)
    return carry_on(observation, seen.allowed, memory)


@callback(DECIDE, counted=False)
def decide_switched(
    observation: Observation, model: ControlModel, settings: np.ndarray, memory: np.ndarray
) -> Decision:
    """The command of the controller that plans with the station's own constants."""
    if is_thesis(model):
        thesis = as_thesis(model)
        return decide_with(observation, thesis, thesis, settings, memory)
    return decide_with(observation, model, model, settings, memory)


class Switched(CompiledBase):
    """Minimises compressor-seconds, dispensing and waiting at the prices of its `patience` over the next minutes.

    A plan is a sequence of commands, a block each; a beam search over the model keeps the sequences that have cost
    least and whose ends are worth most: compressor-seconds to restore the buffers, and what the rest of the fills
    will take at least. Minimum on and off times hold unless a limit closes a valve.
    """

    name = "switched"
    about = "MPC over switching signals: a beam search minutes ahead; patience from serving fast to compressing little"
    settings_type = SwitchedSettings
    settings_key = "switched"

    @property
    def bounded_time(self) -> bool:
        """Whether a plan is sure to come within some 50 ms: one of the usual width and length takes 5 ms."""
        settings: SwitchedSettings = self.settings_for(self.station)
        return settings.beam(self.station) * settings.blocks <= STATES_IN_TIME

    def compiled(self) -> CompiledController:
        """This controller for the compiled loop, with fresh memory."""
        settings: SwitchedSettings = self.settings_for(self.station)
        vector = settings_vector(settings, self.station)
        memory = use_station_prediction(self.station, np.zeros(MEMORY_SIZE))
        return CompiledController(decide_switched, self.station.control_constants(), vector, memory, self.obeys_hold)
