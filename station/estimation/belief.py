"""A filter's belief before a second: a run's state of the plant, and how what is not known of it varies together."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Belief(NamedTuple):
    """A station before a second, as a filter knows it."""

    state: NDArray[np.float64]  # (n,) a run's state at the mean, without its clock
    spread: NDArray[np.float64]  # (n, k) times k independent standard normals: what is not known of the state
    ambient: float  # by how much the surroundings are warmer than the station's file says [K]
    connected: bool  # whether a vehicle is
    volume: float  # of its tank [m3]
    command: int  # valves that were open in the second before, as bits of Valve


def root_of(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """A root of a covariance, (k, k): times its transpose it gives the covariance, but for what rounding left negative.

    Coordinates are scaled by their standard deviations first: they have units of their own.
    """
    scale = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    unit = np.where(scale > 0.0, scale, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(unit, unit))
    found: NDArray[np.float64] = scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    return found


def command_of(valves: NDArray[np.float64]) -> int:
    """The command of which each valve is open (1) or closed."""
    return sum(1 << valve for valve, opened in enumerate(valves) if opened != 0.0)
