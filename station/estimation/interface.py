"""The interface of an estimation model: what follows a plant, behind functions that are alike for every plant."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.estimation.belief import Belief
from station.estimation.power import PowerCurve
from station.frames import Frames
from station.geometry import BUFFERS
from station.parameters import Station
from station.sensor_names import ANALOG, BANK_SENSORS

SHARED_STATES = (
    *(f"mass_{each}" for each in BUFFERS),
    *(f"temperature_{each}" for each in BUFFERS),
    "mass_vehicle",
    "temperature_vehicle",
    "ambient_deviation",
    *(f"leak_{each}" for each in BUFFERS),
    "compressor_factor",
    "dispenser_factor",
)
"""Names of the estimates that every model gives, in this order; units g, deg C, K, g/s and 1."""

MV, TV, AMBIENT, LEAK, KC, KD = 6, 7, 8, 9, 12, 13
"""Places among them: mass and temperature of the vehicle, air, the first leak, factors of compressor and dispenser."""

FIRST_SECONDS = 60
"""So many seconds are read before the first is followed: of them the first reading of each tank is taken."""


OTHER_VOLUME = 0.01
"""A vehicle whose tank is told to be larger or smaller by so large a part begins anew: its volume was told late [1]."""

CAP = 25.0
"""What the square of an innovation counts at most where misfits are compared [1]: an outlier says little."""

BLIND = 10.0
"""A buffer of which nobody told for so many seconds in a row what it gave and was given begins anew by its readings."""


class Tuning(NamedTuple):
    """How soft the filter's model is: standard deviations of what a second adds, and where a reading is an outlier."""

    mass: float  # [g]
    temperature: float  # [K]
    leak: float  # [g/s]
    factor: float  # [1]
    ambient: float  # [K]
    gate: float  # a reading so many standard deviations off is not used
    pressure_bias: float = 0.0  # of what a buffer's pressure sensor is off [bar]; 0: none is
    temperature_bias: float = 0.0  # and its thermometer [K]


STIFF = Tuning(mass=0.02, temperature=0.002, leak=0.0, factor=0.0, ambient=1e-2, gate=6.0)
"""For a calibrated station: the plant's equations hold. Air that waves by 5 K over a day is the air's."""

ROBUST = Tuning(mass=0.5, temperature=0.01, leak=4e-3, factor=1e-3, ambient=3e-3, gate=6.0)
"""For the states of health: parameters may be half a percent off."""


DRIFTING = ROBUST._replace(
    mass=0.02, temperature=0.002, leak=0.0, ambient=1e-2, pressure_bias=7e-3, temperature_bias=4e-3
)  # fmt: skip
"""For sensors that drift, at a calibrated station: no buffer leaks, and what its sensors are off is estimated."""


@dataclass(frozen=True)
class Drifts:
    """Errors of the sensors of buffers, second by second, in the order of BANK_SENSORS."""

    biases: NDArray[np.float64]  # (seconds, len(BANK_SENSORS)) as estimated [bar], [K]
    begins: NDArray[np.float64]  # (seconds, the same) where it is found, seconds since it began; else NaN
    lasts: NDArray[np.float64]  # (seconds, the same) 1: it drifts
    falls: NDArray[np.float64]  # (seconds, len(BUFFERS)) 1: pressures lie below the model's as if the buffer lost gas

    def part(self, first: int, last: int) -> Drifts:
        """The seconds from `first` up to `last`."""
        seconds = slice(first, last)
        return Drifts(self.biases[seconds], self.begins[seconds], self.lasts[seconds], self.falls[seconds])

    @classmethod
    def of_nothing(cls) -> Drifts:
        """Of no second."""
        none = np.zeros((0, len(BANK_SENSORS)))
        return cls(none, none, none, np.zeros((0, len(BUFFERS))))

    @classmethod
    def joined(cls, parts: list[Drifts]) -> Drifts:
        """Parts of one record, one after the other, as one; at least one."""
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in cls.__dataclass_fields__))


@dataclass(frozen=True)
class Followed:
    """Estimates of the filter, second by second."""

    states: NDArray[np.float64]  # (seconds, states) after the second's readings; NaN of a vehicle that is not there
    deviations: NDArray[np.float64]  # (seconds, states) standard deviations
    innovations: NDArray[np.float64]  # (seconds, len(ANALOG)) in standard deviations; NaN where nothing was read
    errors: NDArray[np.float64]  # (seconds, len(ANALOG)) in the sensor's unit
    gate: float
    drifts: Drifts | None = None  # of sensors; None where none are looked for
    stuck: NDArray[np.float64] | None = None  # (seconds, STUCK) of valves; None where none are looked for

    @property
    def used(self) -> NDArray[np.float64]:
        """The innovations of the readings that were used; NaN elsewhere."""
        with np.errstate(invalid="ignore"):
            return np.where(np.abs(self.innovations) <= self.gate, self.innovations, np.nan)

    def part(self, first: int, last: int) -> Followed:
        """The seconds from `first` up to `last`."""
        seconds = slice(first, last)
        return Followed(
            self.states[seconds], self.deviations[seconds], self.innovations[seconds], self.errors[seconds], self.gate,
            None if self.drifts is None else self.drifts.part(first, last),
            None if self.stuck is None else self.stuck[seconds],
        )  # fmt: skip

    @classmethod
    def empty(cls, rows: int, states: int, gate: float) -> Followed:
        """Seconds that are still to be followed."""
        return cls(
            np.empty((rows, states)),
            np.empty((rows, states)),
            np.full((rows, len(ANALOG)), np.nan),
            np.full((rows, len(ANALOG)), np.nan),
            gate,
        )

    @classmethod
    def joined(cls, parts: Sequence[Followed]) -> Followed:
        """Parts of one record, one after the other, as one; at least one part."""
        return cls(
            np.concatenate([part.states for part in parts]),
            np.concatenate([part.deviations for part in parts]),
            np.concatenate([part.innovations for part in parts]),
            np.concatenate([part.errors for part in parts]),
            parts[0].gate,
            None if parts[0].drifts is None else Drifts.joined([part.drifts for part in parts if part.drifts]),
            None
            if parts[0].stuck is None
            else np.concatenate([part.stuck for part in parts if part.stuck is not None]),
        )


@dataclass(frozen=True)
class EstimationModel:
    """A filter of stations of one plant, and the parameters that a calibration finds of them.

    `begin` gives the filter before the first second, from the first minute's readings. `advance` follows the first
    `rows` seconds and leaves in the filter what is known after them; the second after them is only looked at.
    """

    plant: str  # name of the plant
    states: dict[str, str]  # estimates and their units; SHARED_STATES come first
    scratch: Callable[[], Any]  # a filter of nothing: a NamedTuple of float64 arrays
    constants_of: Callable[[Station], Any]
    begin: Callable[[Frames, Station, Tuning, Any], Any]
    advance: Callable[[Frames, int, Any, Station, Tuning, Any], Followed]
    parameters: dict[str, float]  # fields of a station's file that are found, and standard deviations of their priors:
    # relative, but for those in `absolute`
    absolute: frozenset[str]
    constants_at: Callable[[Station, dict[str, float]], Any]  # the constants with other parameters
    station_at: Callable[[Station, dict[str, float]], Station]  # and the station
    belief_of: Callable[[Any, Station, Any], Belief]  # what a filter believes before the second that comes next
    restate: Callable[[NDArray[np.float64], float, Any], None]  # writes what others read of a run's state, pressures
    # say, once entries of the plant were changed; with the volume of the vehicle's tank [m3] and the constants
    refill: Callable[[NDArray[np.float64], float, Any], None]  # lets the vehicle of a run's state be filled to a finish
    # pressure [bar] as a station with these constants does it: with or without communication
    drift: float  # a pressure sensor of a calibrated station drifts that is off by so much [bar]
    small_leak: float  # a bank of a calibrated station leaks whose smoothed leak estimate is larger: healthy ones' stay
    # below in thirty days [g/s]
    grams_of: Callable[[Station], tuple[float, float, float]]  # of a bar in each bank, near its first pressure [g/bar]
    scale_of: Callable[[Station], float]  # how many times larger its flows are than those tunings and limits are for
    power_of: Callable[[Station], PowerCurve | None]  # of its compressor; None where power says nothing of the flow
    air: str | None = (
        None  # the one that is the temperature of the air in the first second; a file has the record's mean
    )
    metered: frozenset[str] = frozenset()  # those that are so much larger as flow meters read too much
    late: frozenset[str] = frozenset()  # those that a soft model tells nothing of, and that wait for a stiffer one


def first_reading(frames: Frames, channel: int, otherwise: float, spread: float) -> tuple[float, float]:
    """The first reading of a channel within a minute and twice its noise, or what to assume."""
    early = frames.values[:FIRST_SECONDS, channel]
    read = np.flatnonzero(np.isfinite(early))
    return (float(early[read[0]]), 2.0 * float(frames.noise[read[0], channel])) if len(read) else (otherwise, spread)


def field_of(station: Station, name: str) -> float:
    """The parameter of a station that a dotted path names."""
    given: Any = station
    for part in name.split("."):
        given = getattr(given, part)
    return float(given)


def with_fields(station: Station, values: dict[str, float]) -> dict[str, Any]:
    """A station's file with other parameters, by dotted paths."""
    given: dict[str, Any] = station.model_dump()
    for name, value in values.items():
        *path, field = name.split(".")
        part = given
        for step in path:
            part = part[step]
        part[field] = value
    return given
