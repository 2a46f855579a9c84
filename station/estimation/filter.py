"""An extended Kalman filter of the thesis's plant with augmented states, one pass over a record of seconds.

Jazwinski 1970, *Stochastic Processes and Filtering Theory*, ch. 8 (extended filter); Friedland 1969,
doi:10.1109/TAC.1969.1099223 (biases as states); scalar measurements one after another after Bierman 1977,
*Factorization Methods for Discrete Sequential Estimation*. The equations are those of `station.plants.thesis`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.errors import InputError
from station.estimation.filter_kernel import (
    AMBIENT,
    KC,
    KD,
    LEAK,
    PLANT_STATES,
    STATES,
    N,
    Scratch,
    Tuning,
    run_pass,
    scratch,
)
from station.geometry import KELVIN, VEHICLE
from station.measurement import ANALOG, Frames
from station.parameters import Station
from station.plants.thesis import THESIS, PlantConstants, gas_mass

__all__ = ["ROBUST", "STATES", "STIFF", "Followed", "Tuning", "follow", "refuse_unfollowed"]

STIFF = Tuning(mass=0.02, temperature=0.002, leak=0.0, factor=0.0, ambient=0.0, gate=6.0)
"""For a calibrated station: the plant's equations hold."""

ROBUST = Tuning(mass=0.5, temperature=0.01, leak=4e-3, factor=1e-3, ambient=3e-3, gate=6.0)
"""For the states of health: parameters may be half a percent off."""

FIRST_SECONDS = 60
"""So many seconds are read before the first is followed: of them the first reading of each tank is taken."""

_FIRST = (0.03, 0.02, 5.0)  # standard deviations at the beginning: leak [g/s], factors [1], ambient [K]


@dataclass(frozen=True)
class Followed:
    """Estimates of the filter, second by second."""

    states: NDArray[
        np.float64
    ]  # (seconds, len(STATES)) after the second's readings; NaN of a vehicle that is not there
    deviations: NDArray[np.float64]  # (seconds, len(STATES)) standard deviations
    innovations: NDArray[np.float64]  # (seconds, len(ANALOG)) in standard deviations; NaN where nothing was read
    errors: NDArray[np.float64]  # (seconds, len(ANALOG)) in the sensor's unit
    gate: float

    @property
    def used(self) -> NDArray[np.float64]:
        """The innovations of the readings that were used; NaN elsewhere."""
        with np.errstate(invalid="ignore"):
            return np.where(np.abs(self.innovations) <= self.gate, self.innovations, np.nan)


def refuse_unfollowed(station: Station) -> None:
    """Refuse a station whose plant is not followed yet.

    Raises
    ------
    InputError
        naming the plant.
    """
    if station.plant != THESIS.name:
        raise InputError(
            "station", [("plant", f"must be {THESIS.name!r}: no other is followed yet; given {station.plant!r}")]
        )


def follow(frames: Frames, station: Station, tuning: Tuning = ROBUST, plant: PlantConstants | None = None) -> Followed:
    """Follow a record with the filter; robust where the tuning lets a leak be, else the plant's own states alone.

    `plant`: constants instead of the station's own.

    Raises
    ------
    InputError
        if the station's plant is not followed.
    """
    constants = plant or station.constants()
    s = begin(frames, station, tuning, constants)
    return advance(frames, len(frames), s, station, tuning, constants)


def begin(frames: Frames, station: Station, tuning: Tuning, constants: PlantConstants) -> Scratch:
    """The state of the filter before the first second, from the first minute's readings.

    Raises
    ------
    InputError
        if the station's plant is not followed.
    """
    refuse_unfollowed(station)
    s = scratch()
    x, cov = s.x, s.cov
    s.volume[:VEHICLE], s.volume[VEHICLE] = constants.buffer_volume, station.vehicle.volume_m3
    x[KC] = x[KD] = 1.0
    size = _size(tuning)
    for b, buffer in enumerate(station.buffers.all):
        p, sp = _first(frames, b, buffer.initial_pressure_bar, 100.0)
        t, st = _first(frames, 4 + b, constants.ambient_temperature, 15.0)
        x[b], x[3 + b] = gas_mass(p, t, constants.buffer_volume[b]), t
        cov[b, b] = (x[b] * sp / p) ** 2 + (x[b] * st / (t + KELVIN)) ** 2
        cov[3 + b, 3 + b] = st * st
        cov[b, 3 + b] = cov[3 + b, b] = -x[b] * st * st / (t + KELVIN)
        if size == N:
            cov[LEAK + b, LEAK + b] = _FIRST[0] ** 2
    if size == N:
        cov[KC, KC] = cov[KD, KD] = _FIRST[1] ** 2
        cov[AMBIENT, AMBIENT] = _FIRST[2] ** 2
    return s


def advance(
    frames: Frames, rows: int, s: Scratch, station: Station, tuning: Tuning, constants: PlantConstants
) -> Followed:
    """Follow the first `rows` seconds and leave in `s` what is known after them; the second after them is looked at."""
    usual = (station.vehicle.start_pressure_bar, station.vehicle.start_temperature_c, station.vehicle.volume_m3)
    found = Followed(
        np.empty((rows, N)),
        np.empty((rows, N)),
        np.full((rows, len(ANALOG)), np.nan),
        np.full((rows, len(ANALOG)), np.nan),
        tuning.gate,
    )
    values, noise = np.ascontiguousarray(frames.values), np.ascontiguousarray(frames.noise)
    run_pass(
        values, noise, frames.relative, s, _size(tuning), constants, usual, tuning, found.states, found.deviations,
        found.innovations, found.errors,
    )  # fmt: skip
    return found


def _size(tuning: Tuning) -> int:
    """How many states the filter has."""
    return N if tuning.leak > 0 else PLANT_STATES


def _first(frames: Frames, channel: int, otherwise: float, spread: float) -> tuple[float, float]:
    """The first reading of a channel within a minute and twice its noise, or what to assume."""
    early = frames.values[:FIRST_SECONDS, channel]
    read = np.flatnonzero(np.isfinite(early))
    return (float(early[read[0]]), 2.0 * float(frames.noise[read[0], channel])) if len(read) else (otherwise, spread)
