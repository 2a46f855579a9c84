"""Futures of a fork under a controller, run by the compiled loop, and what each became."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.columns import CODES, COUNTS, VALUES
from station.controller import CompiledController
from station.entry_points import EntryPoint
from station.forecasting.accounts import INLETS, OUTLETS, Account
from station.forecasting.fork import Fork
from station.geometry import BUFFERS
from station.kernels import CLOSED_CONTROLLER, run_to_end
from station.plants.interface import M, plant_of
from station.run import (
    ARRIVAL,
    ARRIVED,
    CONNECTED,
    CONNECTED_VEHICLE,
    CURRENT,
    DELIVERED,
    FINISHED,
    NEXT,
    PRESSURE,
    ROW,
    RunState,
)
from station.simulation import run_with_faults

Floats = NDArray[np.float64]

GRID = 60
"""Pressures are told each so many seconds [s]."""


class Contender(NamedTuple):
    """A controller whose futures are wanted. They begin with its memory, which is left as it is."""

    name: str
    controller: CompiledController
    fallback: CompiledController = CLOSED_CONTROLLER  # asked where the shield closes a valve
    liveness: float = np.inf  # logic stands in when a vehicle has been given nothing for so long [s]


class Future(NamedTuple):
    """Figures of a station's future within the horizon."""

    wait: float  # mean wait of the vehicles there were [s]
    vehicles: float  # at the dispenser, in the queue, or arrived since
    served: float  # that left filled
    incomplete: float  # that left before
    waiting: float  # in the queue at the end
    shortage: float  # seconds in which a vehicle was connected and no outlet open
    delivered: float  # [kg]
    compressing: float  # compressor-seconds
    energy: float  # electric [kWh]; NaN where the station does not tell
    cost: float  # of energy and of stock that is missing [EUR]; NaN likewise


UNITS = {
    "wait": "s",
    "vehicles": "1",
    "served": "1",
    "incomplete": "1",
    "waiting": "1",
    "shortage": "s",
    "delivered": "kg",
    "compressing": "s",
    "energy": "kWh",
    "cost": "EUR",
}
"""Unit of each figure of a future."""


@dataclass(frozen=True)
class Outcomes:
    """Futures of one controller."""

    name: str
    figures: Floats  # (futures, len(UNITS)) in the order of Future
    pressures: Floats  # (futures, times, buffers) each GRID seconds from the begin on [bar]

    def __getitem__(self, figure: str) -> Floats:
        """One figure of each future, (futures,)."""
        found: Floats = self.figures[:, Future._fields.index(figure)]
        return found


class Loom:
    """Runs futures of one fork; the arrays that they are written to are used again for each."""

    def __init__(self, fork: Fork, horizon: int, account: Account) -> None:
        self._fork, self._account, self._horizon = fork.of_seconds(horizon), account, horizon
        columns = len(VALUES) + len(plant_of(type(fork.parameters.plant)).columns)
        rows = horizon + 2
        self._values, self._codes = np.empty((columns, rows)), np.zeros((len(CODES), rows), np.uint8)
        self._counts = np.empty((len(COUNTS), rows), np.int32)

    def run(self, contender: Contender, states: Sequence[Floats], tables: Sequence[Floats]) -> Outcomes:
        """A future for each state and table of vehicles."""
        times, run = self._horizon // GRID + 1, EntryPoint(run_to_end)
        pressures = np.empty((len(tables), times, len(BUFFERS)))
        figures = np.empty((len(tables), len(UNITS)))
        for number, (state, vehicles) in enumerate(zip(states, tables, strict=True)):
            figures[number] = self._future(run, contender, state, vehicles)
            pressures[number] = self._values[PRESSURE : PRESSURE + len(BUFFERS), : self._horizon + 1 : GRID].T
        return Outcomes(contender.name, figures, pressures)

    def _future(self, run_on: Any, contender: Contender, state: Floats, vehicles: Floats) -> Future:
        counters = self._fork.counters.copy()
        first = counters[CURRENT] if counters[CURRENT] >= 0 else counters[NEXT]
        counters[ROW] = 0
        run = RunState(state.copy(), counters, vehicles.copy(), self._values, self._codes, self._counts)
        controller = contender.controller._replace(memory=contender.controller.memory.copy())
        fallback = contender.fallback._replace(memory=contender.fallback.memory.copy())
        parameters = self._fork.parameters._replace(liveness=contender.liveness)
        if self._fork.faults:
            run_with_faults(run, parameters, controller, fallback, self._fork.faults)
        else:
            run_on(run, parameters, controller, fallback)
        return self._told(run, first)

    def _told(self, run: RunState, first: int) -> Future:
        """A future from its rows and the table of its vehicles, of which those from `first` on were there."""
        seconds = self._horizon
        codes, connected = self._codes[:, :seconds], self._counts[CONNECTED_VEHICLE, :seconds] >= 0
        end = self._fork.time + seconds
        there = run.vehicles[:, first : run.counters[ARRIVED]]
        left = there[:, : max(int(run.counters[NEXT]) - first - int(run.counters[CURRENT] >= 0), 0)]
        waits = np.where(np.isnan(there[CONNECTED]), end, there[CONNECTED]) - there[ARRIVAL]
        delivered = float(there[DELIVERED].sum() - self._delivered(first)) / 1000
        bill = self._account.bill(self._values[:, :seconds], codes, run.state[M : M + len(BUFFERS)], delivered)
        full = int(np.count_nonzero(~np.isnan(left[FINISHED])))
        return Future(
            wait=float(waits.mean()) if len(waits) else 0.0,
            vehicles=there.shape[1],
            served=full,
            incomplete=left.shape[1] - full,
            waiting=int(run.counters[ARRIVED] - run.counters[NEXT]),
            shortage=float(np.count_nonzero(connected & ~codes[OUTLETS].any(axis=0))),
            delivered=delivered,
            compressing=float(codes[INLETS].sum()),
            energy=bill.energy,
            cost=bill.cost,
        )

    def _delivered(self, first: int) -> float:
        """What the vehicle that is connected had been given before [g]."""
        return float(self._fork.vehicles[DELIVERED, first]) if self._fork.counters[CURRENT] >= 0 else 0.0
