"""Futures of a fork under a controller, run by the compiled loop, and what each became."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.columns import CODES, COUNTS, VALUES
from station.controller import CompiledController
from station.entry_points import EntryPoint
from station.forecasting.accounts import Account
from station.forecasting.fork import Fork
from station.forecasting.kernel import COMPRESSING, SHORTAGE, Futures, Row, Tally, run_futures
from station.geometry import BUFFERS
from station.kernels import CLOSED_CONTROLLER
from station.plants.interface import M, plant_of
from station.run import ARRIVAL, ARRIVED, CONNECTED, CURRENT, DELIVERED, FINISHED, NEXT, ailing

Floats = NDArray[np.float64]

GRID = 60
"""Pressures are told each so many seconds [s]."""

AT_ONCE = 20
"""So many futures are run by one call: with more a job that is to end would not hear of it for long."""


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
    """Runs futures of one fork, some at a time."""

    def __init__(self, fork: Fork, horizon: int, account: Account) -> None:
        self._fork, self._account, self._horizon = fork.of_seconds(horizon), account, horizon
        plant = plant_of(type(fork.parameters.plant))
        self._notes, columns = plant.notes, len(VALUES) + len(plant.columns)
        self._row = Row(
            np.empty((columns, 1)), np.zeros((len(CODES), 1), np.uint8), np.empty((len(COUNTS), 1), np.int32)
        )
        self._run = EntryPoint(run_futures)

    def run(self, contender: Contender, states: Sequence[Floats], tables: Sequence[Floats]) -> Outcomes:
        """A future for each state and table of vehicles."""
        pressures = np.empty((len(tables), self._horizon // GRID + 1, len(BUFFERS)))
        figures = np.empty((len(tables), len(UNITS)))
        for first in range(0, len(tables), AT_ONCE):
            some = slice(first, first + AT_ONCE)
            futures = self._begun(contender, states[some], tables[some])
            tally = self._account.tally(pressures[some])
            self._run_on(contender, futures, tally)
            figures[some] = self._told(futures, tally)
        return Outcomes(contender.name, figures, pressures)

    def _begun(self, contender: Contender, states: Sequence[Floats], tables: Sequence[Floats]) -> Futures:
        count, sizes = len(tables), np.array([table.shape[1] for table in tables])
        vehicles = np.full((count, len(self._fork.vehicles), sizes.max()), np.nan)
        for number, table in enumerate(tables):
            vehicles[number, :, : sizes[number]] = table
        begun = np.zeros((count, len(self._fork.state) + self._notes))
        begun[:, : len(self._fork.state)] = states
        return Futures(
            begun, np.tile(self._fork.counters, (count, 1)), vehicles, sizes,
            np.tile(contender.controller.memory, (count, 1)), np.tile(contender.fallback.memory, (count, 1)),
        )  # fmt: skip

    def _run_on(self, contender: Contender, futures: Futures, tally: Tally) -> None:
        """Run futures to their end, anew from where a fault of the plant begins or ends."""
        parameters = self._fork.parameters._replace(liveness=contender.liveness)
        faults, healthy, time = self._fork.faults, parameters.plant, self._fork.time
        while time <= parameters.time_limit:
            until = faults.next_change(time)
            parameters = ailing(parameters, faults.constants(healthy, time), faults.stuck(time))
            self._run(
                futures, parameters, contender.controller, contender.fallback, until, faults.rates(time),
                self._account.meter, GRID, tally, self._row,
            )  # fmt: skip
            time = until

    def _told(self, futures: Futures, tally: Tally) -> Floats:
        """Figures of each future in the order of Future, (futures, len(UNITS))."""
        begun = self._fork.counters
        first = int(begun[CURRENT] if begun[CURRENT] >= 0 else begun[NEXT])
        given = self._delivered(first)
        services = [
            _service(table, counters, first, self._fork.time + self._horizon)
            for table, counters in zip(futures.vehicles, futures.counters, strict=True)
        ]
        delivered = np.array([(each.delivered - given) / 1000 for each in services])
        bill = self._account.bill(tally.spent, futures.states[:, M : M + len(BUFFERS)], delivered)
        counted = tally.counts[:, [SHORTAGE, COMPRESSING]].astype(np.float64)
        served = np.array([each[:-1] for each in services], np.float64)
        return np.column_stack((served, counted[:, 0], delivered, counted[:, 1], bill.energy, bill.cost))

    def _delivered(self, first: int) -> float:
        """Hydrogen that the vehicle that is connected had been given before [g]."""
        return float(self._fork.vehicles[DELIVERED, first]) if self._fork.counters[CURRENT] >= 0 else 0.0


class _Service(NamedTuple):
    """What became of the vehicles of a future: the first entries of Future, and what they were given."""

    wait: float
    vehicles: int
    served: int
    incomplete: int
    waiting: int
    delivered: float  # [g]


def _service(table: Floats, counters: NDArray[np.int64], first: int, end: float) -> _Service:
    """The service of a future that has ended, by its table of vehicles, of which those from `first` on were there."""
    arrived, following, connected = int(counters[ARRIVED]), int(counters[NEXT]), bool(counters[CURRENT] >= 0)
    there = table[:, first:arrived]
    left = max(following - first - connected, 0)
    full = int(np.count_nonzero(np.isfinite(there[FINISHED, :left])))
    waits = np.where(np.isnan(there[CONNECTED]), end, there[CONNECTED]) - there[ARRIVAL]
    return _Service(
        float(waits.mean()) if len(waits) else 0.0, there.shape[1], full, left - full, arrived - following,
        float(there[DELIVERED].sum()),
    )  # fmt: skip
