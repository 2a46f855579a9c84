"""The closed loop: any controller on one replication of a scenario, and the record it leaves."""

from __future__ import annotations

from time import perf_counter
from typing import cast

import numpy as np

from station.columns import CODES, COUNTS, VALUES, VEHICLE_COLUMNS
from station.controller import NEVER, CompiledController, Controller, Decision, Observation, Status
from station.entry_points import EntryPoint
from station.errors import ControllerError, StationError
from station.faults.plant import PlantFaults
from station.geometry import ALL_VALVES
from station.kernels import CLOSED_CONTROLLER, apply, begin, leak_second, observe, run_leaking, run_to_end
from station.parameters import Station
from station.plants.interface import begin as begin_tank
from station.plants.interface import plant_named
from station.record import Record, Timing, vehicle_columns
from station.run import (
    ARRIVAL,
    CLOCK,
    CURRENT,
    DELIVERED,
    FINISH_PRESSURE,
    ROW,
    START_PRESSURE,
    START_TEMPERATURE,
    VOLUME,
    RunParameters,
    RunState,
    ailing,
)
from station.scenario import Scenario
from station.sensors import state_size
from station.starts import starts_for

CHUNK = 50_000
"""Rows added to a record when it is full: a 12-hour day fits without growing."""


def vehicle_table(scenario: Scenario, replication: int, seed: int) -> np.ndarray:
    """Table of the vehicles of a replication before any arrives, (columns of `vehicle_columns`, vehicles)."""
    arriving = scenario.vehicles(replication, seed)
    figures = plant_named(scenario.station.plant).figures
    vehicles = np.full((len(VEHICLE_COLUMNS) + len(figures), len(arriving.arrival)), np.nan)
    vehicles[[ARRIVAL, START_PRESSURE, START_TEMPERATURE, VOLUME, FINISH_PRESSURE]] = arriving
    vehicles[DELIVERED] = 0.0
    return vehicles


def start_run(scenario: Scenario, replication: int = 0, seed: int = 0) -> tuple[RunState, RunParameters]:
    """A run of `scenario` before its first second."""
    station = scenario.station
    sensors = scenario.sensor_model(replication)
    plant, constants = plant_named(station.plant), scenario.plant(replication)
    state = np.zeros(state_size(sensors.kind, plant.own))
    for buffer, tank in enumerate(station.buffers.all):
        pressure, temperature = tank.initial_pressure_bar, tank.initial_temperature_c
        begin_tank(state, buffer, pressure, temperature, tank.volume_m3, np.nan, constants)
    counters = np.zeros(5, np.int64)
    counters[CURRENT] = -1
    run = RunState(
        state, counters, vehicle_table(scenario, replication, seed), np.empty((len(VALUES) + len(plant.columns), 0)),
        np.empty((len(CODES), 0), np.uint8), np.empty((len(COUNTS), 0), np.int32),
    )  # fmt: skip
    known = constants if scenario.disturbance is None else scenario.known_station.constants()
    parameters = RunParameters(
        constants, station.vehicle.volume_m3, station.vehicle.finish_pressure_bar,
        scenario.communication, float(scenario.announcement_s), float(scenario.idle_period_s), scenario.time_limit_s,
        np.inf, station.slot.incomplete_s, sensors,
        starts=starts_for(scenario.emptiest, known, station.thermal.ambient_temperature_c),
    )  # fmt: skip
    return run, parameters


def longer_run(run: RunState) -> RunState:
    """The same run, with room for CHUNK more rows of its record."""

    def grown(block: np.ndarray) -> np.ndarray:
        new = np.empty((block.shape[0], block.shape[1] + CHUNK), block.dtype)
        new[:, : block.shape[1]] = block
        return new

    return run._replace(values=grown(run.values), codes=grown(run.codes), counts=grown(run.counts))


def liveness_of(controller: object, station: Station) -> float:
    """For how long a vehicle may be given nothing before logic stands in [s]; infinite: for ever.

    A controller's own `liveness_s` goes before the station's; None and a missing one say nothing.
    """
    own = getattr(controller, "liveness_s", None)
    seconds = station.slot.liveness_s if own is None else float(own)
    return seconds if seconds > 0.0 else np.inf


def wake_of(controller: object) -> tuple[float, float, float]:
    """Pressures [bar] below which a longer idle period ends, as a controller says; without them it lasts."""
    high, medium, low = getattr(controller, "wake_pressure", NEVER)
    return float(high), float(medium), float(low)


def simulate(
    scenario: Scenario,
    controller: Controller,
    *,
    replication: int = 0,
    seed: int = 0,
    faults: PlantFaults | None = None,
) -> Record:
    """Run `controller` on one replication of `scenario` to its end.

    `faults` are those of the plant in place of the scenario's: a class of one's own may let the air change as well. A
    controller whose `compiled()` gives a CompiledController runs in the compiled loop, any other is called
    second by second; both give the same bytes. Where the shield closes a valve, `controller.fallback` is asked, if it
    has one.

    Raises
    ------
    ControllerError
        if the controller fails or answers what is no decision.
    """
    controller.start(scenario.known_station)
    fallback_controller = getattr(controller, "fallback", None)
    fallback = CLOSED_CONTROLLER
    if fallback_controller is not None:
        fallback_controller.start(scenario.known_station)
        fallback = fallback_controller.compiled()
    run, parameters = start_run(scenario, replication, seed)
    parameters = parameters._replace(liveness=liveness_of(controller, scenario.station))
    began = perf_counter()
    durations = None
    faults = scenario.plant_faults if faults is None else faults
    compiled = controller.compiled() if hasattr(controller, "compiled") else None
    if compiled is not None and faults:
        run = run_with_faults(run, parameters, compiled, fallback, faults)
    elif compiled is not None:
        while not run_to_end(run, parameters, compiled, fallback):
            run = longer_run(run)
    else:
        run, durations = _call_each_second(run, parameters, controller, fallback, faults)
    timing = Timing(perf_counter() - began, durations)
    return record_of(scenario, controller.name, replication, seed, run, timing)


def run_with_faults(
    run: RunState,
    parameters: RunParameters,
    controller: CompiledController,
    fallback: CompiledController,
    faults: PlantFaults,
) -> RunState:
    """The compiled loop to the end of a run, anew from where a fault of the plant begins or ends.

    Parameters
    ----------
    run
        The run; it is given room where its record is full.
    parameters
        Its parameters, with the constants of a healthy plant.
    controller
        Decides.
    fallback
        Asked where the shield closes a valve.
    faults
        The faults of the plant.
    """
    healthy, over = parameters.plant, False
    while not over:
        time = run.state[CLOCK]
        if run.counters[ROW] == run.values.shape[1]:
            run = longer_run(run)
        parameters = ailing(parameters, faults.constants(healthy, time), faults.stuck(time))
        over = run_leaking(run, parameters, controller, fallback, faults.next_change(time), faults.rates(time))
    return run


def _call_each_second(
    run: RunState,
    parameters: RunParameters,
    controller: Controller,
    fallback: CompiledController,
    faults: PlantFaults,
) -> tuple[RunState, np.ndarray]:
    """The loop around a controller that is called from Python, and around faults of the plant."""
    durations, healthy = [], parameters.plant
    wake_pressure = wake_of(controller)
    begin_second, observed, applied = EntryPoint(begin), EntryPoint(observe), EntryPoint(apply)
    leaks = EntryPoint(leak_second)
    run = longer_run(run)
    while begin_second(run, parameters):
        time = run.state[CLOCK]
        if faults:
            parameters = ailing(parameters, faults.constants(healthy, time), faults.stuck(time))
        observation = observed(run, parameters)
        before = perf_counter()
        try:
            answer = controller.decide(observation)
        except StationError:
            raise
        except Exception as error:
            message = f"controller {controller.name!r} failed at {observation.time:g} s: {error!r}"
            raise ControllerError(message) from error
        durations.append(perf_counter() - before)
        decision = checked(answer, controller.name, observation)
        applied(run, parameters, observation, decision, bool(controller.obeys_hold), wake_pressure, fallback)
        if faults:
            leaks(run, parameters, faults.rates(time))
        if run.counters[ROW] == run.values.shape[1]:
            run = longer_run(run)
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


def record_of(scenario: Scenario, name: str, replication: int, seed: int, run: RunState, timing: Timing) -> Record:
    """The record of a run that has ended, under the controller of that name."""
    rows = int(run.counters[ROW]) + 1
    return Record(
        scenario, name, replication, seed, run.values[:, :rows], run.codes[:, :rows], run.counts[:, :rows],
        dict(zip(vehicle_columns(scenario.station.plant), run.vehicles, strict=True)), timing,
    )  # fmt: skip
