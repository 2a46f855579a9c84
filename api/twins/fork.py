"""Forks of live twins, for forecasts of them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from api.http.problems import conflict
from api.twins.messages import Sample
from station import Scenario
from station.estimation.belief import Belief
from station.forecasting.demand import Seen
from station.forecasting.estimate import Estimated, fork_of, fork_of_belief, in_air
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
    spread: np.ndarray | None = None  # of a twin that follows measurements, as `Belief.spread`
    doubt: str = ""  # why faults that were found are not in its scenario; "" where there is no doubt


def fork_of_sample(scenario: Scenario, sample: Sample) -> Fork:
    """The fork of a twin that follows measurements, from the estimates of a second that was kept.

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
        of_tanks("estimate_mass"), of_tanks("estimate_temperature"),
        scenario.station.vehicle.volume_m3 if math.isnan(volume) else volume,
    )  # fmt: skip
    try:
        return fork_of(scenario, float(sample.seq), estimated)
    except ValueError as error:
        raise conflict(f"the estimates of twin {sample.twin!r} are those of no station: {error}") from None


def fork_of_twin(scenario: Scenario, time: float, belief: Belief, seen: Seen, events: int) -> TwinFork:
    """The fork of a twin that follows measurements, before its next second, as its filter believes it.

    Its station stands in the air that the filter believes in.

    Parameters
    ----------
    scenario
        Of the station that is followed.
    time
        Of the next second, since the twin's first [s].
    belief
        What the filter believes before it.
    seen
        Vehicles that came.
    events
        Told so far.

    Raises
    ------
    ProblemError
        409 where a tank is believed to hold what none could, or the air to be as no station's.
    """
    try:
        there = in_air(scenario, belief.ambient)
        fork = fork_of_belief(there, time, belief)
    except ValueError as error:  # an InputError is one
        raise conflict(f"what is believed of the twin is no station: {error}") from None
    return TwinFork(there, 0, "", None, fork, seen, events, belief.spread)
