"""Forks: a station's state at a time, from which futures begin."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.faults.plant import PlantFaults
from station.run import ARRIVAL, ARRIVED, CLOCK, CURRENT, NEXT, PERIOD, RunParameters

Floats = NDArray[np.float64]


class Fork(NamedTuple):
    """A run at the begin of a second, without its record. Futures leave its arrays as they are."""

    state: Floats  # as RunState.state
    counters: NDArray[np.int64]  # as RunState.counters
    vehicles: Floats  # (vehicle columns, n): those that have arrived, and those that are known to come
    parameters: RunParameters  # of a healthy plant
    faults: PlantFaults = PlantFaults([])
    gone: int = 0  # vehicles that came before the first of these, and are not kept

    @property
    def time(self) -> float:
        """When the futures begin [s]."""
        return float(self.state[CLOCK])

    def known(self, announcement: float) -> Fork:
        """The same without vehicles to come that have not announced themselves within `announcement` [s] by now."""
        coming = np.arange(self.vehicles.shape[1]) >= self.counters[ARRIVED]
        told = self.vehicles[ARRIVAL] <= self.time + announcement
        return self._replace(vehicles=np.ascontiguousarray(self.vehicles[:, ~coming | told]))

    def numbered(self) -> Fork:
        """The same with vehicles counted from the run's first one, as controllers are shown them."""
        counters = self.counters.copy()
        counters[[ARRIVED, NEXT]] += self.gone
        if counters[CURRENT] >= 0:
            counters[CURRENT] += self.gone
        nobody = np.full((len(self.vehicles), self.gone), np.nan)
        return self._replace(counters=counters, vehicles=np.hstack((nobody, self.vehicles)), gone=0)

    def here(self) -> Fork:
        """The same with the vehicles at the dispenser and in the queue alone: none that left, none to come."""
        arrived, current = int(self.counters[ARRIVED]), int(self.counters[CURRENT])
        first = current if current >= 0 else int(self.counters[NEXT])
        counters = self.counters.copy()
        counters[[ARRIVED, NEXT]] -= first
        counters[CURRENT] = 0 if current >= 0 else -1
        vehicles = np.ascontiguousarray(self.vehicles[:, first:arrived])
        return self._replace(counters=counters, vehicles=vehicles, gone=self.gone + first)

    def of_seconds(self, horizon: float) -> Fork:
        """The same with a row a second, that ends after `horizon` [s] and not before."""
        parameters = self.parameters._replace(idle_period=PERIOD, time_limit=self.time + horizon)
        return self._replace(parameters=parameters)

    @property
    def waiting(self) -> int:
        """Vehicles in the queue."""
        return int(self.counters[ARRIVED] - self.counters[NEXT])


def fork_arrays(fork: Fork) -> dict[str, np.ndarray]:
    """A fork as arrays, but for what follows from its scenario."""
    gone = np.array(fork.gone)
    return {"state": fork.state, "counters": fork.counters, "vehicles": fork.vehicles, "gone": gone}
