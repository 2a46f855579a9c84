"""The data that figures of merit are computed from."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from station.scenario import Scenario


class RecordedRun(Protocol):
    """Data that figures are computed from: the columns and vehicles of a `station.record.Record`."""

    @property
    def scenario(self) -> Scenario:
        """The scenario that was run."""

    @property
    def columns(self) -> dict[str, str]:
        """Name and unit of every column."""

    @property
    def vehicles(self) -> dict[str, NDArray[np.float64]]:
        """VEHICLE_COLUMNS, each (vehicles,)."""

    def __getitem__(self, column: str) -> NDArray[Any]:
        """The column of that name, one entry a row."""
