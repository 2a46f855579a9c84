"""A buffer that dispenses and the vehicle it fills, known by bounds, and the tables that the stages of a fill leave."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from controllers.reserve.tank import OUTWARD, Law, cooled, least_ratio, most_ratio
from station.compiled import inlined, kernel
from station.geometry import KELVIN
from station.plants.thesis import SPECIFIC_GAS, PlantConstants

# What became of a part of the box.
PROVED, LATE, FLOW, HEAT, FULL = range(5)
OUTCOMES = (
    "proved",
    "a fill could last longer than T",
    "an outlet could be closed by the flow limit",
    "a second could be too close to the vehicle's temperature limit to tell",
    "medium could be full when it hands the vehicle on",
)

SLACK = 1e-7
"""Decisions so close to their threshold may go either way [bar]."""

COLDEST, BIN, BINS = -60.0, 0.5, 320
"""Ends of stages are kept apart by temperature, BIN kelvins each, from COLDEST deg C on."""

WARMER, COARSE, COOLER, STEP = 80, 2.0, 16, 2.5
"""Closings of high are kept apart by WARMER temperatures, COARSE kelvins each from COLDEST on, and by COOLER of the
vehicle, STEP kelvins each below the warmest it may be."""

PIECE = 8.0
"""Densities at a hand-over are followed in pieces of that many bar of the vehicle."""


class ProofProblem(NamedTuple):
    """Proof obligation, its vehicle, and the settings of the rule."""

    starts: tuple[float, float]  # least and greatest density of the gas in vehicles that connect [g/m3]
    temperature: float  # their temperature [deg C]
    volumes: tuple[float, float]  # least and greatest volume [m3]
    finish: float  # pressure at which they leave [bar]
    within: int  # T [s]
    spacing: int  # s [s]
    gap: float  # at which low and medium hand them on [bar]
    opens: float  # gap from which high is opened [bar]
    stop: tuple[float, float, float]  # pressure of a full buffer, high, medium and low [bar]
    slot: int  # turn of a buffer [s]


class FillEnclosure(NamedTuple):
    """Bounds on a buffer that dispenses and on the vehicle."""

    low: float  # pressure [bar]
    high: float
    cold: float  # temperature [deg C]
    warm: float
    least: float  # density of the vehicle's gas [g/m3]
    most: float


class EnclosureTables(NamedTuple):
    """Enclosures that stages leave for those after them; rows are seconds since connection."""

    vehicle: np.ndarray  # (n, 2) temperature [deg C] while low or medium dispense; whether the limit closes the outlet
    to_medium: np.ndarray  # (n, 2) least and greatest density at which low hands the vehicle on [g/m3]
    to_high: np.ndarray  # (n, 2) the same of medium
    low_ends: np.ndarray  # (n, BINS, 4) low when it has handed on, or the vehicle has left
    medium_ends: np.ndarray  # medium when it has handed on
    medium_idle: np.ndarray  # medium when the vehicle has left before high was needed
    high_idle: np.ndarray  # high when the vehicle has left
    left: np.ndarray  # (n, 3) whether a vehicle can leave from low, medium, high
    opened: np.ndarray  # (n, 2) first and last second in which high can be opened for what medium handed on then
    closed: (
        np.ndarray
    )  # (n, BINS, 7) high has come too close: densities, least gap, temperatures, vehicle's temperatures
    waits: np.ndarray  # (2, 2) first second and end of first waits for high, and of those after it came too close


@kernel
def bars_of(temperature: float) -> float:
    """Pressure of the vehicle by the density of its gas [bar m3/g]."""
    return (temperature + KELVIN) * SPECIFIC_GAS


@kernel
def bin_of(temperature: float) -> int:
    """The row of a table's temperature [deg C]."""
    return min(max(int(np.floor((temperature - COLDEST) / BIN)), 0), BINS - 1)


@kernel
def place_of(temperature: float, below: float) -> int:
    """The row of a buffer's temperature [deg C] and of how far a vehicle is below the warmest it may be [K]."""
    buffer = min(max(int(np.floor((temperature - COLDEST) / COARSE)), 0), WARMER - 1)
    return buffer * COOLER + min(max(int(np.floor(below / STEP)), 0), COOLER - 1)


@kernel
def note_end(table: np.ndarray, second: int, low: float, high: float, cold: float, warm: float) -> None:
    """Widen what a table holds of a second and a temperature."""
    row = table[second, bin_of(cold)]
    row[0], row[1] = min(row[0], low), max(row[1], high)
    row[2], row[3] = min(row[2], cold), max(row[3], warm)


@kernel
def note_span(table: np.ndarray, second: int, least: float, most: float) -> None:
    """Widen an interval of a table."""
    table[second, 0] = min(table[second, 0], least)
    table[second, 1] = max(table[second, 1], most)


@kernel
def dispensed(
    span: FillEnclosure, rise: tuple[float, float], volumes: tuple[float, float], law: Law, plant: PlantConstants
) -> FillEnclosure:
    """The bounds a second on; `rise` bounds the vehicle's pressure by its density [bar m3/g], `volumes` its tank."""
    cooling = plant.outlet_cooling[law.buffer]
    cold = cooled(span.cold, plant) - cooling - OUTWARD * KELVIN
    warm = cooled(span.warm, plant) - cooling + OUTWARD * KELVIN
    flow = plant.outlet_coefficient
    taken = flow * max(span.low - span.least * rise[0], 0.0) * law.density * (warm + KELVIN)
    kept = flow * max(span.high - span.most * rise[1], 0.0) * law.density * (cold + KELVIN)
    return FillEnclosure(
        (span.low * least_ratio(span.cold, span.warm, cooling, plant) - taken) * (1.0 - OUTWARD),
        (span.high * most_ratio(span.cold, span.warm, cooling, plant) - kept) * (1.0 + OUTWARD),
        cold,
        warm,
        (span.least + flow * max(span.low - span.least * rise[1], 0.0) / volumes[1]) * (1.0 - OUTWARD),
        (span.most + flow * max(span.high - span.most * rise[0], 0.0) / volumes[0]) * (1.0 + OUTWARD),
    )


@kernel
def rested(span: FillEnclosure, plant: PlantConstants) -> FillEnclosure:
    """The bounds a second on where the vehicle's temperature keeps the outlet closed."""
    return FillEnclosure(
        span.low * least_ratio(span.cold, span.warm, 0.0, plant),
        span.high * most_ratio(span.cold, span.warm, 0.0, plant),
        cooled(span.cold, plant) - OUTWARD * KELVIN,
        cooled(span.warm, plant) + OUTWARD * KELVIN,
        span.least,
        span.most,
    )


@kernel
def either(a: FillEnclosure, b: FillEnclosure) -> FillEnclosure:
    """Bounds that hold where either's do."""
    return FillEnclosure(
        min(a.low, b.low), max(a.high, b.high), min(a.cold, b.cold), max(a.warm, b.warm), min(a.least, b.least),
        max(a.most, b.most),
    )  # fmt: skip


@kernel
def staying(span: FillEnclosure, gap: float, rise: tuple[float, float]) -> FillEnclosure:
    """Those of a span whose gap is not below `gap`."""
    return FillEnclosure(
        max(span.low, span.least * rise[0] + gap - SLACK),
        span.high,
        span.cold,
        span.warm,
        span.least,
        min(span.most, (span.high - gap + SLACK) / rise[0]),
    )


@kernel
def connected(span: FillEnclosure, finish: float, rise: tuple[float, float]) -> FillEnclosure:
    """Those of a span whose vehicle has not left."""
    most = min(span.most, (finish + SLACK) / rise[0])
    return FillEnclosure(span.low, span.high, span.cold, span.warm, span.least, most)


@kernel
def empty(span: FillEnclosure) -> bool:
    """Whether nobody is left within bounds."""
    return span.low > span.high or span.least > span.most


@kernel
def pieces_of(least: float, most: float, bars: float) -> int:
    """Into how many pieces an interval of the vehicle's density is cut; `bars`: its pressure by that."""
    return max(int(np.ceil((most - least) * bars / PIECE)), 1)


@inlined
def piece_of(least: float, most: float, piece: int, pieces: int) -> tuple[float, float]:
    """One of the pieces an interval is cut into."""
    end = most if piece == pieces - 1 else least + (most - least) * ((piece + 1) / pieces)
    return least + (most - least) * (piece / pieces), end
