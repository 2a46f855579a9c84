"""Many runs of one scenario, each waiting for its command, advanced together by compiled code."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from station.columns import CODES, COUNTS
from station.controller import CompiledController
from station.entry_points import EntryPoint
from station.errors import InputError
from station.kernels import CLOSED_CONTROLLER, leak_second
from station.plants.interface import plant_named
from station.record import Record, Timing, value_columns, vehicle_columns
from station.run import CLOCK, ROW, RunState, ailing
from station.scenario import Scenario
from station.simulation import start_run, vehicle_table
from station.valves import commands
from station.vector_kernels import COMPRESSOR, COSTS, DISPENSING, ENERGY, OBSERVED, RUNNING, apply_runs, begin_runs

ROWS = 4096
"""Rows of a record that is kept, at first; it doubles when it is full."""


class VectorRun:
    """Runs of one scenario that differ in their replications, stepped together.

    `begin` shows each run's second, `apply` gives each its command, and so on in turn. The seconds are those of
    `simulate`, bit for bit, under a controller that gives the same commands and has the same `fallback` and
    `liveness`. With `shielded` False limits refuse nothing (`station.step.apply_unshielded`).

    Parameters
    ----------
    scenario
        That all runs are of.
    number
        How many runs.
    shielded
        Whether limits hold.
    obeys_hold
        Whether Eq. (7.16) binds.
    fallback
        Asked where the shield closes a valve; every run has a memory of its own, which begins as this one's.
    liveness
        It stands in when a vehicle has been given nothing for so long [s]; infinite: never.
    keeping
        Whether records are kept, for `record`.

    Attributes
    ----------
    commands
        Those that the station's valves admit, as bits of Valve, (commands,) int64.
    shown
        Observations, (number, len(OBSERVED)) float32.
    masks
        Which commands pass the shield as they are, (number, commands) int8.
    costs
        Cost components of the last step, (number, len(COSTS)); `energy` is NaN where nobody knows it.
    over
        RUNNING, SERVED or TIME_OVER, (number,) int64.

    Raises
    ------
    InputError
        if more runs than one have a disturbance or faults of the plant, which change the plant of each by itself, or
        the shield is off where a disturbance lets sensors err.
    """

    def __init__(
        self, scenario: Scenario, number: int, *, shielded: bool = True, obeys_hold: bool = True,
        fallback: CompiledController = CLOSED_CONTROLLER, liveness: float = math.inf, keeping: bool = False,
    ) -> None:  # fmt: skip
        _check(scenario, number, shielded=shielded)
        self.scenario = scenario
        self.number = number
        self._shielded, self._obeys_hold, self._keeping = shielded, obeys_hold, keeping
        self._fallback, self._liveness = fallback, liveness
        run, parameters = start_run(scenario)
        self._parameters = parameters._replace(liveness=liveness)
        self._faults, self._healthy = scenario.plant_faults, parameters.plant
        self._first_state, self._first_counters = run.state, run.counters
        self._started = [(0, 0)] * number
        station = scenario.station
        self.commands = np.array(commands(station.compressor.count), np.int64)
        self._powers = None if plant_named(station.plant).powers else station.powers  # None: it has a meter
        self._states = np.tile(run.state, (number, 1))
        self._counters = np.tile(run.counters, (number, 1))
        self._vehicles = np.tile(run.vehicles, (number, 1, 1))
        self._sizes = np.full(number, run.vehicles.shape[1], np.int64)
        rows = ROWS if keeping else 1
        self._values = np.full((number, len(value_columns(station.plant)), rows), np.nan)
        self._codes = np.zeros((number, len(CODES), rows), np.uint8)
        self._counts = np.zeros((number, len(COUNTS), rows), np.int32)
        self._memories = np.tile(fallback.memory, (number, 1))
        self.shown = np.zeros((number, len(OBSERVED)), np.float32)
        self.masks = np.zeros((number, len(self.commands)), np.int8)
        self.costs = np.zeros((number, len(COSTS)))
        self.over = np.full(number, RUNNING, np.int64)
        self._begin, self._apply = EntryPoint(begin_runs), EntryPoint(apply_runs)
        self._leak = EntryPoint(leak_second)

    def start(self, place: int, replication: int = 0, seed: int = 0) -> None:
        """Start a run anew, with the vehicles of a replication; `begin` shows its first second.

        What a disturbance draws is the replication's, too.
        """
        if self.scenario.disturbance is not None:
            run, parameters = start_run(self.scenario, replication, seed)
            self._parameters = parameters._replace(liveness=self._liveness)
            self._healthy, self._first_state, vehicles = parameters.plant, run.state, run.vehicles
        else:
            vehicles = vehicle_table(self.scenario, replication, seed)
        count = vehicles.shape[1]
        if count > self._vehicles.shape[2]:
            longer = np.full((self.number, len(vehicles), count), np.nan)
            longer[:, :, : self._vehicles.shape[2]] = self._vehicles
            self._vehicles = longer
        self._vehicles[place, :, :count] = vehicles
        self._sizes[place] = count
        self._states[place] = self._first_state
        self._counters[place] = self._first_counters
        self._memories[place] = self._fallback.memory
        self._started[place] = replication, seed
        self.costs[place] = 0.0
        self.over[place] = RUNNING

    def begin(self) -> None:
        """Let vehicles arrive and connect; write `shown`, `masks` and `over`, and what arrivals add to `costs`."""
        if self._faults:
            time = float(self._states[0, CLOCK])
            plant = self._faults.constants(self._healthy, time)
            self._parameters = ailing(self._parameters, plant, self._faults.stuck(time))
        if self._keeping and self._counters[:, ROW].max() == self._values.shape[2]:
            self._values, self._codes, self._counts = map(_doubled, (self._values, self._codes, self._counts))
        self._begin(
            self._states, self._counters, self._vehicles, self._sizes, self._values, self._codes, self._counts,
            self._parameters, self._obeys_hold, self.commands, self.shown, self.masks, self.costs, self.over,
        )  # fmt: skip

    def apply(self, asked: NDArray[np.int64], active: NDArray[np.bool_]) -> None:
        """Give each run that is `active` its command, and write `costs` of the second.

        Parameters
        ----------
        asked
            Commands as bits of Valve, each one of `commands`, (number,).
        active
            Runs that are stepped, (number,); none that is over.
        """
        began = float(self._states[0, CLOCK])
        self._apply(
            self._states, self._counters, self._vehicles, self._sizes, self._values, self._codes, self._parameters,
            self._obeys_hold, asked, active, self._shielded, self._keeping, self._fallback, self._memories, self.costs,
        )  # fmt: skip
        if self._faults:
            only = RunState(
                *(each[0] for each in (self._states, self._counters, self._vehicles)),
                *(each[0] for each in (self._values, self._codes, self._counts)),
            )
            self._leak(only, self._parameters, self._faults.rates(began))
        compressor, precooler = self._powers or (None, None)
        if compressor is not None and precooler is not None:
            seconds = compressor * self.costs[:, COMPRESSOR] + precooler * self.costs[:, DISPENSING]
            self.costs[:, ENERGY] = seconds / 3600

    def times(self) -> NDArray[np.float64]:
        """Simulated time of each run [s], (number,)."""
        return self._states[:, CLOCK].copy()

    @property
    def knows_energy(self) -> bool:
        """Whether `energy` is known: the plant has a meter, or the station says its powers."""
        return self._powers is None or None not in self._powers

    def record(self, name: str, place: int = 0) -> Record:
        """The record of a run as far as it has come: that of `simulate` with a controller called `name`.

        Raises
        ------
        InputError
            if records are not kept.
        """
        if not self._keeping:
            raise InputError("vector run", [("keeping", "must be true where a record is asked for")])
        rows = int(self._counters[place, ROW]) + 1
        table = self._vehicles[place, :, : self._sizes[place]].copy()
        columns = vehicle_columns(self.scenario.station.plant)
        return Record(
            self.scenario, name, *self._started[place], self._values[place, :, :rows].copy(),
            self._codes[place, :, :rows].copy(), self._counts[place, :, :rows].copy(),
            dict(zip(columns, table, strict=True)), Timing(math.nan),
        )  # fmt: skip


def _check(scenario: Scenario, number: int, *, shielded: bool) -> None:
    """Raise InputError for what runs stepped together cannot have."""
    if number < 1:
        raise InputError("vector run", [("number", f"must be at least 1; given {number}")])
    if number > 1 and (scenario.disturbance is not None or scenario.plant_faults):
        field = "faults" if scenario.disturbance is None else "disturbance"
        message = f"must be left out where more runs than one are stepped together, here {number}: their plants differ"
        raise InputError(f"scenario {scenario.name}", [(field, message)])
    if not shielded and scenario.disturbance is not None:
        message = "must be left out without a shield: only the shield knows what sensors that err admit"
        raise InputError(f"scenario {scenario.name}", [("disturbance", message)])


def _doubled(block: NDArray[Any]) -> NDArray[Any]:
    """A block of records with room for twice as many rows."""
    longer: NDArray[Any] = np.empty((*block.shape[:2], 2 * block.shape[2]), block.dtype)
    longer[:, :, : block.shape[2]] = block
    return longer
