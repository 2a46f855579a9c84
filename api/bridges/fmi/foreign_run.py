"""A scenario at a foreign unit in the plant's place: vehicles, controller, limits and record are ours."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter
from typing import Any

import numpy as np

from api.bridges.fmi.foreign_unit import Assignments, ForeignUnit
from api.bridges.fmi.unit_map import CONNECTED, NUMBER
from station.columns import CODES, COUNTS, VALUES
from station.controller import Controller
from station.entry_points import EntryPoint
from station.errors import ControllerError, InputError, StationError
from station.geometry import BUFFERS, CLOSED, TANKS, VALVES, VEHICLE
from station.kernels import CLOSED_CONTROLLER, apply, begin, observe
from station.plants.interface import COMPLETE, GOES_ON, M, P, T, fill_end, plant_named
from station.plants.thesis import refuse_others
from station.record import Record, Timing
from station.run import (
    CLOCK,
    CURRENT,
    DELIVERED,
    DRY,
    FINAL_PRESSURE,
    FINISH_PRESSURE,
    FINISHED,
    FLOW_COMPRESSOR,
    FLOW_DISPENSER,
    PERIOD,
    PREVIOUS,
    ROW,
    START_PRESSURE,
    START_TEMPERATURE,
    VOLUME,
)
from station.scenario import Scenario
from station.sensors import OFF
from station.simulation import checked, liveness_of, longer_run, record_of, start_run, wake_of

Row = dict[str, float]
"""A row of the record by column."""

Told = Callable[[Row], None]


def _ignore(_row: Row) -> None:
    """Tell nobody."""


class ForeignRun:
    """A run of a scenario whose plant is a foreign unit.

    The kernels of `simulate` let vehicles arrive and connect, observe, keep the limits and write the record; after each
    second the state that they go on from is what the unit shows, and a vehicle leaves by that.

    Parameters
    ----------
    scenario
        Its station says which limits are kept and what the controller believes; initial values are the unit's.
    controller
        Decides.
    unit
        The plant, not begun yet.
    replication
        0 is the pattern, others are drawn.
    seed
        Of the replications that are drawn.

    Raises
    ------
    PlantError
        if the station's plant is another than the thesis's, whose limits alone need nothing that a unit does not show.
    InputError
        if the scenario has disturbances or faults of the plant.
    """

    def __init__(
        self, scenario: Scenario, controller: Controller, unit: ForeignUnit, replication: int = 0, seed: int = 0
    ) -> None:
        refuse_others(scenario.station.plant, "a foreign unit in the plant's place")
        run, parameters = start_run(scenario, replication, seed)
        if parameters.sensors.kind != OFF or scenario.plant_faults:
            field = "faults" if scenario.plant_faults else "disturbance"
            message = "must be left out: what is disturbed or fails at a foreign unit is the unit's own"
            raise InputError(f"scenario {scenario.name}", [(field, message)])
        self._scenario, self._controller, self._unit = scenario, controller, unit
        self._replication, self._seed = replication, seed
        liveness = liveness_of(controller, scenario.station)
        self._run, self._parameters = run, parameters._replace(idle_period=PERIOD, liveness=liveness)
        self._held = plant_named(scenario.station.plant).held
        self._volumes = [tank.volume_m3 for tank in scenario.station.buffers.all]
        self._vehicle = -1  # that the unit was told of

    def run(self, tell: Told = _ignore) -> Record:
        """Run to the end; `tell` is given each row when its second has passed. The record, a row a second.

        Flows that the unit does not show are NaN in it.

        Raises
        ------
        UnitError
            if the unit refuses, crashes or hangs, or shows what cannot be.
        ControllerError
            if the controller fails or answers what is no decision.
        """
        controller = self._controller
        controller.start(self._scenario.known_station)
        behind: Any = getattr(controller, "fallback", None)
        fallback = CLOSED_CONTROLLER
        if behind is not None:
            behind.start(self._scenario.known_station)
            fallback = behind.compiled()
        wake_pressure = wake_of(controller)
        begin_second, observed, applied = EntryPoint(begin), EntryPoint(observe), EntryPoint(apply)
        began = perf_counter()
        self._take(self._unit.begin(self._inputs(CLOSED, -1)), BUFFERS)
        self._run = longer_run(self._run)
        while begin_second(self._run, self._parameters):
            run, row, current = self._run, int(self._run.counters[ROW]), int(self._run.counters[CURRENT])
            table = run.vehicles[:, max(current, 0)].copy()  # the kernel's own second tells nothing of the unit's
            observation = observed(run, self._parameters)
            decision = checked(self._decided(observation), controller.name, observation)
            applied(run, self._parameters, observation, decision, bool(controller.obeys_hold), wake_pressure, fallback)
            flows = self._second(int(run.counters[PREVIOUS]), current)
            run.values[FLOW_COMPRESSOR, row], run.values[FLOW_DISPENSER, row] = flows
            if current >= 0:
                self._fill(current, table, flows[1])
            tell(self._row(row))
            if run.counters[ROW] == run.values.shape[1]:
                self._run = longer_run(run)
        timing = Timing(perf_counter() - began)
        return record_of(self._scenario, controller.name, self._replication, self._seed, self._run, timing)

    def _decided(self, observation: Any) -> object:
        try:
            return self._controller.decide(observation)
        except StationError:
            raise
        except Exception as error:
            message = f"controller {self._controller.name!r} failed at {observation.time:g} s: {error!r}"
            raise ControllerError(message) from error

    def _inputs(self, command: int, vehicle: int) -> Assignments:
        """What the unit is given for a second, by quantity; valves before vehicles."""
        given = [(name, float(command >> place & 1)) for place, name in enumerate(VALVES)]
        if vehicle >= 0:
            figures = self._run.vehicles[:, vehicle]
            starts = (START_PRESSURE, START_TEMPERATURE, VOLUME)
            names = ("vehicle_start_pressure", "vehicle_start_temperature", "vehicle_volume")
            given += zip(names, figures[list(starts)].tolist(), strict=True)
        return [*given, (NUMBER, float(vehicle + 1)), (CONNECTED, float(vehicle >= 0))]

    def _second(self, command: int, vehicle: int) -> tuple[float, float]:
        """Let the unit pass a second, and take what it shows as the state; the flows of compressor and dispenser."""
        left = self._vehicle >= 0 and vehicle != self._vehicle
        before = [(NUMBER, 0.0), (CONNECTED, 0.0)] if left else []
        self._vehicle = vehicle
        shown = self._unit.step(before, self._inputs(command, vehicle))
        self._take(shown, TANKS if vehicle >= 0 else BUFFERS)
        return shown.get("flow_compressor", np.nan), shown.get("flow_dispenser", np.nan)

    def _take(self, shown: dict[str, float], tanks: tuple[str, ...]) -> None:
        """Let the state of these tanks be what the unit shows; masses that it does not follow from the volumes."""
        state = self._run.state
        for place, tank in enumerate(tanks):
            state[P + place] = pressure = shown[f"pressure_{tank}"]
            state[T + place] = temperature = shown[f"temperature_{tank}"]
            mass = shown.get(f"mass_{tank}")
            if mass is None:
                volume = self._run.vehicles[VOLUME, self._vehicle] if place == VEHICLE else self._volumes[place]
                mass = float(self._held(pressure, temperature, volume))
            state[M + place] = mass

    def _fill(self, vehicle: int, table: np.ndarray, dispensed: float) -> None:
        """What a second gave to a vehicle, and whether it leaves, by what the unit shows; see `station.step`."""
        state, counters, vehicles = self._run.state, self._run.counters, self._run.vehicles
        vehicles[:, vehicle] = table
        vehicles[DELIVERED, vehicle] += PERIOD * dispensed
        vehicles[FINAL_PRESSURE, vehicle] = state[P + VEHICLE]
        counters[CURRENT] = vehicle
        end = fill_end(state, vehicles[FINISH_PRESSURE, vehicle], self._parameters.plant)
        if end == COMPLETE:
            vehicles[FINISHED, vehicle] = state[CLOCK]
        if end != GOES_ON or state[DRY] >= self._parameters.incomplete:
            counters[CURRENT] = -1

    def _row(self, row: int) -> Row:
        """A row of the record by column."""
        run = self._run
        return {
            **dict(zip(VALUES, run.values[:, row].tolist(), strict=True)),
            **dict(zip(CODES, run.codes[:, row].tolist(), strict=True)),
            **dict(zip(COUNTS, run.counts[:, row].tolist(), strict=True)),
        }
