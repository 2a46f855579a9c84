"""The kernels Python calls: one second in three steps, a decision, a whole run; compiled for every plant there is."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import types

from station.compiled import callback, entry, inlined, numba_type
from station.control_model import SAMPLE_MODEL, ControlModel
from station.controller import DECIDE, DECISION, NEVER, OBSERVATION, CompiledController, Decision, Observation
from station.faults.plant import Rates
from station.leaks import leak
from station.plants.interface import samples
from station.plants.thesis import SAMPLE_CONSTANTS
from station.run import CLOCK, ROW, RunParameters, RunState
from station.sensors import OFF, SensorModel
from station.step import apply_decision, begin_second, close_record, observation_of

_SAMPLE_RUN = RunState(
    np.zeros(1), np.zeros(1, np.int64), np.zeros((1, 1)), np.zeros((1, 1)), np.zeros((1, 1), np.uint8),
    np.zeros((1, 1), np.int32),
)  # fmt: skip
_RUN = numba_type(_SAMPLE_RUN)
_SENSORS = SensorModel(OFF, 0, *(1.0,) * 5, SAMPLE_CONSTANTS)
PARAMETERS = [numba_type(RunParameters(plant, 1.0, 1.0, True, *(1.0,) * 5, _SENSORS)) for plant in samples()]
"""Numba types of the parameters of a run, one for each plant."""

_NO_VECTOR = np.zeros(0)


@callback(DECIDE, counted=False)
def _decide_closed(  # a controller with nothing to see
    _observation: Observation, _model: ControlModel, _settings: np.ndarray, _memory: np.ndarray
) -> Decision:
    return Decision(0, 0, np.nan, np.nan)


CLOSED_CONTROLLER = CompiledController(_decide_closed, SAMPLE_MODEL, _NO_VECTOR, _NO_VECTOR, obeys_hold=True)
"""Keeps every valve closed: what is asked where a controller has no fallback."""

CONTROLLER = numba_type(CLOSED_CONTROLLER)
"""Numba type of a CompiledController."""

_TRIPLE = numba_type(NEVER)
RATES = numba_type((0.0,) * 7)
"""Type of `station.faults.plant.Rates`."""


@entry(*(types.boolean(_RUN, each) for each in PARAMETERS))
def begin(run: RunState, parameters: RunParameters) -> bool:
    """Let vehicles arrive and connect; False when the run is over and its record is closed."""
    going = begin_second(run.state, run.counters, run.vehicles, run.values, run.counts, parameters)
    if not going:
        close_record(run.counters[ROW], run.values, run.codes, parameters.plant)
    return going


@entry(*(types.void(_RUN, each, RATES) for each in PARAMETERS))
def leak_second(run: RunState, parameters: RunParameters, rates: Rates) -> None:
    """Take out of the buffers what leaks at these rates in the second that is over."""
    leak(run.state, run.counters, run.vehicles, run.values, rates, parameters)


@entry(*(OBSERVATION(_RUN, each) for each in PARAMETERS))
def observe(run: RunState, parameters: RunParameters) -> Observation:
    """Observation of this second, as the controller is given it."""
    return observation_of(run.state, run.counters, run.vehicles, parameters)


@entry(*(types.void(_RUN, each, OBSERVATION, DECISION, types.boolean, _TRIPLE, CONTROLLER) for each in PARAMETERS))
def apply(
    run: RunState, parameters: RunParameters, observation: Observation, decision: Decision, obeys_hold: bool,
    wake_pressure: tuple[float, float, float], fallback: CompiledController,
) -> None:  # fmt: skip
    """Shield and apply one decision, and record it."""
    apply_decision(
        run.state, run.counters, run.vehicles, run.values, run.codes, parameters, observation, decision, obeys_hold,
        wake_pressure, fallback,
    )  # fmt: skip


@entry(DECISION(CONTROLLER, OBSERVATION))
def ask(controller: CompiledController, observation: Observation) -> Decision:
    """One decision of a compiled controller."""
    return controller.decide(observation, controller.model, controller.settings, controller.memory)


@inlined
def advance_second(
    state: np.ndarray, counters: np.ndarray, vehicles: np.ndarray, values: np.ndarray, codes: np.ndarray,
    counts: np.ndarray, parameters: RunParameters, decide: Callable[..., Decision], model: ControlModel,
    settings: np.ndarray, memory: np.ndarray, obeys_hold: bool, wake_pressure: tuple[float, float, float],
    fallback: CompiledController,
) -> bool:  # fmt: skip
    """One second under a compiled controller; False when the run is over and its record is closed."""
    if not begin_second(state, counters, vehicles, values, counts, parameters):
        close_record(counters[ROW], values, codes, parameters.plant)
        return False
    observation = observation_of(state, counters, vehicles, parameters)
    decision = decide(observation, model, settings, memory)
    apply_decision(
        state, counters, vehicles, values, codes, parameters, observation, decision, obeys_hold, wake_pressure, fallback
    )  # fmt: skip
    return True


@entry(*(types.boolean(_RUN, each, CONTROLLER, CONTROLLER) for each in PARAMETERS))
def run_to_end(
    run: RunState, parameters: RunParameters, controller: CompiledController, fallback: CompiledController
) -> bool:
    """Run until the end (True) or until the record is full (False)."""
    state, counters, vehicles, values, codes, counts = run
    decide, model, settings, memory, obeys_hold, wake_pressure = controller
    while counters[ROW] < values.shape[1]:
        if not advance_second(
            state, counters, vehicles, values, codes, counts, parameters, decide, model, settings, memory, obeys_hold,
            wake_pressure, fallback,
        ):  # fmt: skip
            return True
    return False


@entry(*(types.boolean(_RUN, each, CONTROLLER, CONTROLLER, types.float64, RATES) for each in PARAMETERS))
def run_leaking(
    run: RunState, parameters: RunParameters, controller: CompiledController, fallback: CompiledController,
    until: float, rates: Rates,
) -> bool:  # fmt: skip
    """Run until the end (True), or until a time [s] or until the record is full (False); what leaks is lost."""
    state, counters, vehicles, values, codes, counts = run
    decide, model, settings, memory, obeys_hold, wake_pressure = controller
    while counters[ROW] < values.shape[1] and state[CLOCK] < until:
        if not advance_second(
            state, counters, vehicles, values, codes, counts, parameters, decide, model, settings, memory, obeys_hold,
            wake_pressure, fallback,
        ):  # fmt: skip
            return True
        leak(state, counters, vehicles, values, rates, parameters)
    return False
