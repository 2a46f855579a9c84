"""Readings of the sensors of a live run, second by second, with the faults of sensors and clocks that are there."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from station.columns import CODES, COUNTS, VALUES
from station.faults.kinds import Fault
from station.faults.sensors import ClockSkew, SensorFrozen
from station.measured_day import MISSING, TOLD, misread, noisy
from station.sensor_names import ANALOG

_NOBODY = -1
"""Number of the vehicle where none is connected."""

_VEHICLE = tuple(name for name in ANALOG if name.endswith("_vehicle"))
"""A vehicle's sensors, which read nothing while none is connected."""


_PLACES = {name: place for place, name in enumerate((*VALUES, *CODES, *COUNTS))}
"""Where each column stands in a row that is told."""


class SensorState(NamedTuple):
    """The faults of sensors and clocks that are there in a second."""

    faults: tuple[Fault, ...] = ()
    held: tuple[tuple[str, float], ...] = ()  # what each frozen sensor goes on saying; NaN where it has said nothing

    @property
    def skew(self) -> int:
        """How fast the clock of the sensors is against that of the valves [s]."""
        return sum(fault.skew_s for fault in self.faults if isinstance(fault, ClockSkew))

    def stamp(self, sensor: str, time: float) -> float:
        """The time that a reading of a sensor carries which was taken at a time [s]."""
        return time + self.skew if sensor in ANALOG else time


HEALTHY = SensorState()
"""No sensor fails."""


def measured_second(
    row: Mapping[str, float], seq: int, seed: int = 0, sensors: SensorState = HEALTHY
) -> dict[str, float]:
    """Readings of the sensors in a second of a run, with the noise of `measured_day`.

    Equal arguments give equal readings; a fault changes those of its sensor alone.

    Parameters
    ----------
    row : mapping of str to float
        The figures of a row of the record, by column.
    seq : int
        Number of the row.
    seed : int
        Of the noise and of missing samples.
    sensors : SensorState
        Which of them fail.

    Returns
    -------
    dict of str to float
        Readings in bar, degC and g/s by sensor; none of a sensor whose sample is missing.
    """
    random = np.random.default_rng([seed, seq])
    told = {name: float(noisy(np.array([row[name]]), name, random)[0]) for name in (*ANALOG, *TOLD)}
    lost = random.random(len(told)) < MISSING
    told |= _misread(told, row["time"], seq, seed, sensors)
    return {
        name: value for (name, value), gone in zip(told.items(), lost, strict=True) if math.isfinite(value) and not gone
    }


def _misread(told: Mapping[str, float], time: float, seq: int, seed: int, sensors: SensorState) -> dict[str, float]:
    """What the sensors with faults read instead."""
    wrong: dict[str, float] = {}
    held = dict(sensors.held)
    for place, fault in enumerate(sensors.faults):
        sensor = getattr(fault, "sensor", None)
        if sensor is None:
            continue
        if isinstance(fault, SensorFrozen):
            wrong[sensor] = held.get(sensor, math.nan)
            continue
        random = np.random.default_rng([seed, seq, place])
        value = np.array([wrong.get(sensor, told[sensor])])
        wrong[sensor] = float(misread(value, np.array([time]), fault, random)[0])
    return wrong


class LiveSensors:
    """The sensors of a run that goes on: which of them fail in a second, and what the frozen ones say.

    Parameters
    ----------
    faults : iterable of Fault
        Those of the run; what is of its plant is left out.
    """

    def __init__(self, faults: Iterable[Fault]) -> None:
        self._held: dict[str, tuple[float, float]] = {}  # begin of the fault [s] and reading, by sensor
        self._fed: tuple[float, ...] = ()  # time, number and the vehicle's figures of the last row with a vehicle
        self.set_faults(faults)

    def set_faults(self, faults: Iterable[Fault]) -> None:
        """Let these be the faults from the next second on; a sensor that stays frozen goes on saying what it said."""
        self._faults = [fault for fault in faults if not fault.OF_PLANT]

    def second(self, figures: Sequence[float], seq: int) -> SensorState:
        """The faults that are there in the second of a row of the record with this number, columns in their order."""
        if figures[_PLACES["vehicle"]] != _NOBODY:
            self._fed = (float(seq), *(figures[_PLACES[name]] for name in _VEHICLE))
        if not self._faults:
            return HEALTHY
        row = {name: figures[place] for name, place in _PLACES.items()}
        there = tuple(fault for fault in self._faults if fault.there(row["time"]))
        frozen: dict[str, float] = {fault.sensor: fault.begin_s for fault in there if isinstance(fault, SensorFrozen)}
        self._held = {name: held for name, held in self._held.items() if frozen.get(name) == held[0]}
        for name, begin in frozen.items():
            if name not in self._held:
                self._held[name] = (begin, self._now(name, row, seq, there))
        return SensorState(there, tuple((name, value) for name, (_, value) in self._held.items())) if there else HEALTHY

    def _now(self, sensor: str, row: Mapping[str, float], seq: int, there: Sequence[Fault]) -> float:
        """What a sensor reads as it freezes; one of a vehicle the last that it has read of any."""
        if sensor in _VEHICLE and row["vehicle"] == _NOBODY:
            if not self._fed:
                return math.nan
            seq, row = int(self._fed[0]), {**row, **dict(zip(_VEHICLE, self._fed[1:], strict=True))}
        random = np.random.default_rng([0, seq])
        told = {name: float(noisy(np.array([row[name]]), name, random)[0]) for name in ANALOG}
        before = tuple(fault for fault in there if not isinstance(fault, SensorFrozen))
        return {**told, **_misread(told, row["time"], seq, 0, SensorState(before))}[sensor]

    def memories(self) -> dict[str, np.ndarray]:
        """Arrays for a snapshot, by name."""
        held = [self._held.get(name, (math.nan, math.nan)) for name in ANALOG]
        return {"sensors_held": np.array(held, float), "sensors_fed": np.array(self._fed, float)}

    def resume(self, memories: Mapping[str, np.ndarray]) -> None:
        """Go on from a snapshot; from one without sensors, those that are frozen hold what they read next."""
        held, fed = memories.get("sensors_held"), memories.get("sensors_fed")
        if held is None or fed is None or held.shape != (len(ANALOG), 2) or fed.size not in (0, 1 + len(_VEHICLE)):
            return
        rows = zip(ANALOG, held.tolist(), strict=True)
        self._held = {name: (begin, value) for name, (begin, value) in rows if math.isfinite(begin)}
        self._fed = tuple(fed.ravel().tolist())
