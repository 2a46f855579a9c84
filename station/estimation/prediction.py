"""How well a control model predicts: a day replayed from many of its seconds, under the commands that it holds."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.compiled import kernel
from station.control_model import ControlModel, advance, gas_mass
from station.estimation.interface import SHARED_STATES, Followed
from station.frames import Frames
from station.geometry import TANKS, VALVES, VEHICLE
from station.plants.interface import M, P, T
from station.record import Record
from station.sensor_names import ANALOG

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

BUFFER_HORIZONS = (60, 300, 900)
"""After so long buffers are compared [s]."""

VEHICLE_HORIZONS = (60, 120, 180)
"""After so long the vehicle is [s]."""

BUFFER_EVERY, VEHICLE_EVERY = 900, 30
"""Predictions begin so far apart [s]; those of a vehicle within its stay."""


class Day(NamedTuple):
    """A day as a record tells it, one entry a second."""

    pressure: Floats  # (4, seconds) [bar]
    temperature: Floats  # (4, seconds) [deg C]
    command: Ints  # (seconds,) bits of Valve
    vehicle: Ints  # (seconds,) -1: none
    volume: Floats  # (seconds,) of its tank [m3], 0 where there is none
    flow: Floats  # (2, seconds) out of the compressor and to the vehicle [g/s]; NaN where it is not known

    def part(self, first: int, last: int) -> Day:
        """The seconds from `first` up to `last`."""
        seconds = slice(first, last)
        return Day(
            self.pressure[:, seconds], self.temperature[:, seconds], self.command[seconds], self.vehicle[seconds],
            self.volume[seconds], self.flow[:, seconds],
        )  # fmt: skip


def day_of(record: Record) -> Day:
    """The day of a record.

    Raises
    ------
    ValueError
        if its rows are not a second apart.
    """
    if np.any(np.diff(record["time"]) != 1.0):
        raise ValueError("rows must be a second apart (idle_period_s = 1)")
    vehicle = record["vehicle"].astype(np.int64)
    volume = np.where(vehicle >= 0, record.vehicles["volume"][vehicle], 0.0)
    command = np.zeros(len(record), np.int64)
    for place, valve in enumerate(VALVES):
        command |= record[valve].astype(np.int64) << place
    return Day(
        np.stack([record[f"pressure_{tank}"] for tank in TANKS]),
        np.stack([record[f"temperature_{tank}"] for tank in TANKS]),
        command,
        vehicle,
        volume,
        np.stack((record["flow_compressor"], record["flow_dispenser"])),
    )


def day_of_followed(frames: Frames, followed: Followed, volume: float) -> Day:
    """The day of a measured record, as a filter followed it: what it expected to read, and temperatures of the gas.

    `volume` [m3] is that of a vehicle whose tank is not told.

    Raises
    ------
    ValueError
        if a pressure, a valve or the vehicles are measured nowhere in it.
    """
    needed = (*(f"pressure_{tank}" for tank in TANKS), *VALVES, "vehicle")
    missing = [name for name in needed if not np.isfinite(frames[name]).any()]
    if missing:
        raise ValueError(f"must measure {', '.join(missing)}")
    vehicle = _held(frames["vehicle"], -1.0).astype(np.int64)
    edges = [0, *(np.flatnonzero(np.diff(vehicle)) + 1).tolist(), len(frames)]
    command = np.zeros(len(frames), np.int64)
    for place, valve in enumerate(VALVES):
        command |= (_held(frames[valve], 0.0) > 0.5).astype(np.int64) << place
    pressure, temperature = np.zeros((2, len(TANKS), len(frames)))
    for place, tank in enumerate(TANKS):
        read = frames[f"pressure_{tank}"]
        error = followed.errors[:, ANALOG.index(f"pressure_{tank}")]
        stretches = edges if place == VEHICLE else [0, len(frames)]
        for first, last in pairwise(stretches):
            expected = read[first:last] - np.nan_to_num(error[first:last])
            pressure[place, first:last] = _between(expected)
            temperature[place, first:last] = _between(
                followed.states[first:last, SHARED_STATES.index(f"temperature_{tank}")]
            )
    return Day(
        pressure,
        temperature,
        command,
        vehicle,
        np.where(vehicle >= 0, _held(frames["vehicle_volume"], volume), 0.0),
        np.stack((frames["flow_compressor"], frames["flow_dispenser"])),
    )


def _held(values: Floats, before: float) -> Floats:
    """Values with the last one known in place of those that are not."""
    last = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(values.size), -1))
    return np.where(last >= 0, values[last], before)


def _between(values: Floats) -> Floats:
    """Values with a straight line in place of those that are not known; 0 where none is."""
    known = np.flatnonzero(np.isfinite(values))
    return np.interp(np.arange(values.size), known, values[known]) if known.size else np.zeros(values.size)


@kernel
def _set(tank: int, row: int, volume: float, day: Day, state: np.ndarray, model: ControlModel) -> None:
    """Let a tank of the model hold what the record says."""
    state[P + tank], state[T + tank] = day.pressure[tank, row], day.temperature[tank, row]
    state[M + tank] = gas_mass(state[P + tank], state[T + tank], volume, model)


@kernel
def replay(day: Day, begins: Ints, horizons: Ints, model: ControlModel) -> Floats:
    """Pressures [bar] and temperatures [deg C] of the model after each horizon [s]: (begins, horizons, 2, 4).

    A vehicle that comes is told as the record has it. NaN where the day ends before, and of the vehicle where it is
    not the one that was there at the begin.
    """
    found = np.full((begins.size, horizons.size, 2, 4), np.nan)
    state = np.zeros(12)
    for number in range(begins.size):
        begin = begins[number]
        for buffer in range(3):
            _set(buffer, begin, model.buffer_volume[buffer], day, state, model)
        present = -1
        place = 0
        for row in range(begin, min(begin + horizons[-1], day.command.size - 1)):
            if day.vehicle[row] != present:
                present = day.vehicle[row]
                if present >= 0:
                    _set(VEHICLE, row, day.volume[row], day, state, model)
            advance(state, day.volume[row], day.command[row], 1.0, model)
            if row + 1 - begin == horizons[place]:
                for tank in range(4):
                    found[number, place, 0, tank] = state[P + tank]
                    found[number, place, 1, tank] = state[T + tank]
                if present < 0 or present != day.vehicle[begin] or day.vehicle[row + 1] != present:
                    found[number, place, :, VEHICLE] = np.nan
                place += 1
    return found


def buffer_begins(day: Day) -> Ints:
    """Seconds at which predictions of the buffers begin."""
    return np.arange(0, day.command.size - 1, BUFFER_EVERY)


def vehicle_begins(day: Day) -> Ints:
    """Seconds at which predictions of the vehicle begin: its first, and others of its stay."""
    there = np.flatnonzero(day.vehicle >= 0)
    if there.size == 0:
        return there
    first = np.r_[True, np.diff(day.vehicle[there]) != 0]
    since = there - np.maximum.accumulate(np.where(first, there, 0))
    return there[since % VEHICLE_EVERY == 0]


class Residuals(NamedTuple):
    """Predicted less recorded."""

    buffers: Floats  # (begins, horizons, 2, 3) [bar], [K]
    vehicle: Floats  # (begins, horizons, 2) [bar], [K]


def residuals(day: Day, model: ControlModel) -> Residuals:
    """Errors of every prediction of a day; NaN where there is nothing to compare with."""
    parts = []
    for begins, horizons in ((buffer_begins(day), BUFFER_HORIZONS), (vehicle_begins(day), VEHICLE_HORIZONS)):
        ahead = np.array(horizons)
        rows = np.minimum(begins[:, None] + ahead, day.command.size - 1)
        real = np.stack((day.pressure[:, rows], day.temperature[:, rows]))  # (2, 4, begins, horizons)
        parts.append(replay(day, begins, ahead, model) - real.transpose(2, 3, 0, 1))
    return Residuals(parts[0][..., :VEHICLE], parts[1][..., VEHICLE])


class PredictionErrors(NamedTuple):
    """Root mean squares of the errors of pressure [bar] after each horizon."""

    buffers: tuple[float, ...]  # BUFFER_HORIZONS
    vehicle: tuple[float, ...]  # VEHICLE_HORIZONS


def prediction_errors(days: Sequence[Day], model: ControlModel) -> PredictionErrors:
    """How far a model's predictions lie from what happened on these days; NaN where none could be compared."""
    found = [residuals(day, model) for day in days]
    buffers = np.concatenate([each.buffers[:, :, 0] for each in found])
    vehicle = np.concatenate([each.vehicle[:, :, 0] for each in found])
    return PredictionErrors(
        tuple(_rms(buffers[:, place]) for place in range(len(BUFFER_HORIZONS))),
        tuple(_rms(vehicle[:, place]) for place in range(len(VEHICLE_HORIZONS))),
    )


def _rms(errors: Floats) -> float:
    there = errors[np.isfinite(errors)]
    return float(np.sqrt(np.mean(there**2))) if there.size else float("nan")
