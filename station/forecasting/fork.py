"""Forks: a station's state at a time, from which futures begin."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.faults.plant import PlantFaults
from station.run import ARRIVAL, ARRIVED, CLOCK, NEXT, PERIOD, RunParameters

Floats = NDArray[np.float64]


class Fork(NamedTuple):
    """A run at the begin of a second, without its record. Futures leave its arrays as they are."""

    state: Floats  # as RunState.state
    counters: NDArray[np.int64]  # as RunState.counters
    vehicles: Floats  # (vehicle columns, n): those that have arrived, and those that are known to come
    parameters: RunParameters  # of a healthy plant
    faults: PlantFaults = PlantFaults([])

    @property
    def time(self) -> float:
        """When the futures begin [s]."""
        return float(self.state[CLOCK])

    def known(self, announcement: float) -> Fork:
        """The same without vehicles to come that have not announced themselves within `announcement` [s] by now."""
        coming = np.arange(self.vehicles.shape[1]) >= self.counters[ARRIVED]
        told = self.vehicles[ARRIVAL] <= self.time + announcement
        return self._replace(vehicles=np.ascontiguousarray(self.vehicles[:, ~coming | told]))

    def of_seconds(self, horizon: float) -> Fork:
        """The same with a row a second, that ends after `horizon` [s] and not before."""
        parameters = self.parameters._replace(idle_period=PERIOD, time_limit=self.time + horizon)
        return self._replace(parameters=parameters)

    @property
    def waiting(self) -> int:
        """Vehicles in the queue."""
        return int(self.counters[ARRIVED] - self.counters[NEXT])
