"""Settings of the scenario controller: those of `switched`, and how many futures and candidates."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from controllers.switched.settings import Price, SwitchedSettings
from controllers.switched.vector import settings_vector
from station.compiled import kernel
from station.parameters import Station
from station.whole import WHOLE
from theory.paths.scenario_bounds import ViolationBound, by_choice

FUTURES_MAX = 200
CANDIDATES_MAX = 8
WINDOW_MAX = 60
SEED_MAX = 2**53 - 1

QUANTILES = 0.35, 0.1, 0.7
"""Of the next arrival not announced, typical, early and late: rather too soon than too late, or vehicles wait."""

BRANCH_SHARE = 0.07
"""States kept of each early or late branch, of which every candidate has two, by those kept of the typical one."""


class ScenarioSettings(SwitchedSettings):
    """Settings of `scenario`."""

    futures: Annotated[int, Field(ge=1, le=FUTURES_MAX, description="Futures drawn for a decision"), WHOLE] = 24
    candidates: Annotated[int, Field(ge=1, le=CANDIDATES_MAX, description="First commands compared in them"), WHOLE] = 4
    window: Annotated[
        int,
        Field(ge=1, le=WINDOW_MAX, description="Blocks of a plan in which futures are searched for shortages"),
        WHOLE,
    ] = 8
    margin: Annotated[
        Price, Field(description="How much dearer than the cheapest a candidate may be that has no shortage")
    ] = 5.0
    seed: Annotated[int, Field(ge=0, le=SEED_MAX, description="Of the futures"), WHOLE] = 0

    @property
    def chance(self) -> ViolationBound:
        """Bound on the chance that a decision is covered and falls short in a future like those drawn."""
        return by_choice(self.candidates, self.futures)


class Numbers(NamedTuple):
    """First entries of the vector of settings."""

    futures: int
    candidates: int
    window: int  # [blocks]
    margin: float  # [s of compressor]
    seed: int
    trunk: int  # states kept of the typical branch
    branch: int  # of each other one
    spread: float  # half-width of start pressures [bar]


OWN = len(Numbers._fields)
"""Entries before those of `switched`."""


def scenario_vector(settings: ScenarioSettings, station: Station) -> np.ndarray:
    """The settings the compiled controller reads: Numbers, then those of `switched`."""
    width = settings.beam(station)
    numbers = Numbers(
        settings.futures,
        settings.candidates,
        settings.window,
        settings.margin,
        settings.seed,
        max(settings.candidates, width),
        max(1, round(BRANCH_SHARE * width)),
        station.vehicle.start_pressure_spread_bar,
    )
    return np.concatenate((numbers, settings_vector(settings, station)))


@kernel
def numbers_of(vector: np.ndarray) -> Numbers:
    """The numbers in the vector."""
    return Numbers(
        int(vector[0]),
        int(vector[1]),
        int(vector[2]),
        vector[3],
        int(vector[4]),
        int(vector[5]),
        int(vector[6]),
        vector[7],
    )
