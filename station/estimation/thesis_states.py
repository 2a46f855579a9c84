"""States and working arrays of the filter of the thesis's plant."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from station.compiled import inlined
from station.estimation.drifting import drifts_of_nothing
from station.estimation.interface import MV, SHARED_STATES, TV
from station.estimation.jumps import jumps_of_nothing
from station.estimation.noise import usual_noise
from station.estimation.put_right import PUT
from station.estimation.resting import runs_of_nothing
from station.estimation.sudden import DOUBT
from station.geometry import BUFFERS, VEHICLE
from station.sensor_names import ANALOG, SENSORS

PLANT_STATES = 9
"""The first of them, the plant's own and the air; the others are the robust form's."""

N = len(SHARED_STATES)

DRIFT = 0.57
"""A pressure sensor drifts that is off by so much [bar]: healthy ones of calibrated stations are by less."""

BIASED = N + len(BUFFERS)
"""Of the form for sensors that drift: what pressures are off takes the leaks' places, thermometers' comes behind N."""


class Scratch(NamedTuple):
    """Working arrays of one pass; all float64."""

    x: np.ndarray  # (BIASED,) the states
    cov: np.ndarray  # (BIASED, BIASED) their covariance
    half: np.ndarray  # (BIASED, BIASED)
    drift: np.ndarray  # (PLANT_STATES, BIASED) slopes of what a second adds to the plant's states
    h: np.ndarray  # (BIASED,) slopes of a reading
    column: np.ndarray  # (BIASED,)
    pressure: np.ndarray  # (4,) of the tanks [bar]
    by_mass: np.ndarray  # (4,) its slope [bar/g]
    by_heat: np.ndarray  # (4,) and by temperature [bar/K]
    volume: np.ndarray  # (4,) [m3]
    valve: np.ndarray  # (6,) 1: open, as last known
    unseen: np.ndarray  # (6,) 1: nobody told, and the meter does not say
    moving: np.ndarray  # (6,) how often each valve moves from one second to the next [1]
    moved: np.ndarray  # (6,) how likely one that nobody told is not as it was [1]
    nothing: np.ndarray  # (len(SENSORS),) a second of which nothing was told: NaN
    flow: np.ndarray  # (6,) through each valve, were it open [g/s]
    slope: np.ndarray  # (6, BIASED) its slopes
    vehicle: np.ndarray  # (1,) the vehicle connected, as last known; -1: none
    blind: np.ndarray  # (4,) seconds in a row in which nobody told what a tank gave and was given
    anew: np.ndarray  # (4,) 1: begun anew in this second
    runs: np.ndarray  # (len(ANALOG), ENTRIES) of `station.estimation.resting`
    heard: np.ndarray  # (len(SENSORS),) a second's readings, but those of sensors that are stuck
    tag_noise: np.ndarray  # (len(ANALOG),) a second's noise by tags and steps
    loud: np.ndarray  # (len(ANALOG), ENTRIES) of `station.estimation.noise`
    noise: np.ndarray  # (len(ANALOG),) a second's noise as the filter takes it
    relative: np.ndarray  # (len(ANALOG),) and its relative part
    doubt: np.ndarray  # (DOUBT,) of `station.estimation.sudden`
    put: np.ndarray  # (2, PUT) of `station.estimation.put_right`
    drifts: np.ndarray  # (len(BANK_SENSORS) + 1, ENTRIES) of `station.estimation.drifting`
    jumps: np.ndarray  # (len(ANALOG), JUMP) of `station.estimation.jumps`
    behind: np.ndarray  # (4,) of `station.estimation.thermometers` [K]
    before: np.ndarray  # (4,) temperatures of the tanks before the second [deg C]


def scratch() -> Scratch:
    """All of it 0, and no vehicle."""
    n = BIASED
    return Scratch(
        np.zeros(n), np.zeros((n, n)), np.zeros((n, n)), np.zeros((PLANT_STATES, n)), np.zeros(n), np.zeros(n),
        np.zeros(4), np.zeros(4), np.zeros(4), np.zeros(4), np.zeros(6), np.zeros(6), np.zeros(6),
        np.zeros(6), np.full(len(SENSORS), np.nan), np.zeros(6), np.zeros((6, n)),
        np.full(1, -1.0), np.zeros(4), np.zeros(4), runs_of_nothing(len(ANALOG)), np.zeros(len(SENSORS)),
        np.zeros(len(ANALOG)), usual_noise(len(ANALOG)), np.zeros(len(ANALOG)), np.zeros(len(ANALOG)),
        np.zeros(DOUBT), np.zeros((2, PUT)), drifts_of_nothing(DRIFT), jumps_of_nothing(), np.zeros(4),
        np.zeros(4),
    )  # fmt: skip


@inlined
def places_of(tank: int) -> tuple[int, int]:
    """The places of mass and temperature of a tank among the states."""
    return (MV, TV) if tank == VEHICLE else (tank, 3 + tank)
