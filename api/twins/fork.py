"""Forks of live twins, for forecasts of them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from api.http.problems import conflict
from api.twins.messages import Sample
from station import Scenario
from station.forecasting.demand import Seen
from station.forecasting.estimate import Estimated, fork_of
from station.forecasting.fork import Fork
from station.geometry import TANKS


class TwinFork(NamedTuple):
    """A twin between two seconds."""

    scenario: Scenario
    replication: int
    controller: str  # that decides; "" where the twin does not know it
    memory: np.ndarray | None  # what it remembers; None where a solver decides
    fork: Fork
    seen: Seen  # vehicles that came
    events: int  # told so far
    estimated: Estimated | None = None  # of a twin that follows measurements: what is not known of the state


def fork_of_sample(scenario: Scenario, sample: Sample, seen: Seen, events: int) -> TwinFork:
    """The fork of a twin that follows measurements, from the estimates of its newest second.

    Raises
    ------
    ProblemError
        409 where a tank is not known, or holds what none could.
    """
    figures = dict(zip(sample.columns, sample.row, strict=True))

    def of_tanks(name: str) -> np.ndarray:
        return np.array([figures[f"{name}_{tank}"] for tank in TANKS], np.float64)

    volume = figures.get("measured_vehicle_volume", math.nan)
    estimated = Estimated(
        of_tanks("estimate_mass"), of_tanks("estimate_temperature"), of_tanks("deviation_mass"),
        of_tanks("deviation_temperature"), scenario.station.vehicle.volume_m3 if math.isnan(volume) else volume,
    )  # fmt: skip
    try:
        fork = fork_of(scenario, float(sample.seq), estimated)
    except ValueError as error:
        raise conflict(f"the estimates of twin {sample.twin!r} are those of no station: {error}") from None
    return TwinFork(scenario, 0, "", None, fork, seen, events, estimated)
