"""The memory of an identification: where what is known, believed and estimated of each constant stands in it."""

from __future__ import annotations

import math

import numpy as np

from station.compiled import kernel
from station.control_model import is_thesis
from station.geometry import KELVIN
from station.parameters import Station
from station.plants.thesis import THESIS, Rates
from station.tightening import TightenedStation

IDENTIFIED = (
    "inlet_coefficient", "outlet_coefficient",
    "inlet_heating_high", "inlet_heating_medium", "inlet_heating_low",
    "outlet_cooling_high", "outlet_cooling_medium", "outlet_cooling_low",
    "vehicle_heating", "heat_exchange",
)  # fmt: skip
"""The constants identified, in the order of every vector here."""

COUNT = len(IDENTIFIED)

OUTWARD = 1e-9
"""Added to the error of a pressure [bar], a temperature [K] and, relatively, of a constant: the rounding of doubles."""

MODEL_ERRORS = 3.0
"""A model errs by at most so many times the greatest RMS error that its station's file states."""

INLET, OUTLET, HEAT, EXCHANGE = 0, 1, 2, 9
"""Places of the flow coefficients, of the first heat rate and of the exchange in such a vector."""

FLOWS, RATES = 2, 7
"""Numbers of flow coefficients and of heat rates."""

# Parts of the memory: the interval, what is believed of the constants before any reading, the estimate.
LOW, HIGH, CENTRE, HALF, ESTIMATE = (COUNT * part for part in range(5))
ERROR = 5 * COUNT  # of a pressure [bar], of a temperature [K]
COMPRESSOR, AMBIENT = ERROR + 2, ERROR + 3  # readings of p0 [bar] and T_env [deg C]
COVOLUME = ERROR + 4  # b [m3/g]
CAPPED = ERROR + 5  # 1: nozzle and ramp hold the flow to a vehicle, so it tells nothing of the coefficient
TIME, SEEN = ERROR + 6, ERROR + 7  # time of the readings before, vehicle then (-1: none it reports of)
PRESSURE, TEMPERATURE = ERROR + 8, ERROR + 12  # and what they were
FLOW = ERROR + 16  # of each coefficient: sums of squares and products by the variance of a mass
RATE = FLOW + 2 * FLOWS  # of each heat rate: squares, products with the exchange, with the temperature
SHARED = RATE + 3 * RATES  # of the exchange: squares, products with the temperature
WINDOWS = SHARED + 2

ENTRIES = 14
"""Entries of a window; `controllers.adaptive.windows` names them."""

FLAGGED = WINDOWS + 4 * ENTRIES  # seconds whose readings no constants explained, and the time of the last one [s]

IDENTIFICATION_SIZE = FLAGGED + 2
"""Entries of memory `learn` uses."""


def believed(plant: Rates) -> np.ndarray:
    """The constants identified as `plant` has them, (COUNT,)."""
    return np.array(
        [
            plant.inlet_coefficient, plant.outlet_coefficient, *plant.inlet_heating, *plant.outlet_cooling,
            plant.vehicle_heating, plant.heat_exchange,
        ]
    )  # fmt: skip


def model_errors(station: Station) -> tuple[float, float]:
    """By how much the model errs in a window: a pressure [bar], a temperature [K]; infinite where nobody knows.

    The thesis's plant is its own model. A pressure that is wrong by a share is one of a temperature that is.
    """
    if station.plant == THESIS.name and is_thesis(station.control_constants()):
        return 0.0, 0.0
    section = station.control_model
    stated = [] if section is None else [*section.buffer_errors_bar, *section.vehicle_errors_bar]
    if not stated:
        return math.inf, math.inf
    pressure = MODEL_ERRORS * max(stated)
    least = min(buffer.initial_pressure_bar for buffer in station.buffers.all)
    return pressure, (station.thermal.ambient_temperature_c + KELVIN) * pressure / least


def start_identification(station: Station, parameters: float | None, assumed: float) -> np.ndarray:
    """The memory of `learn` before any reading, (IDENTIFICATION_SIZE,).

    The errors are those a disturbed scenario states; where none are stated, readings are taken as exact and the
    constants as known to the relative error `assumed`. `parameters` is preferred to either. Errors of a model that only
    comes near the plant are added; where they are not known the errors are infinite, and nothing is identified.
    """
    plant = station.control_constants()
    pressure, temperature = model_errors(station)
    width = assumed
    if isinstance(station, TightenedStation):
        plant = station.nominal.control_constants()
        width = station.uncertainty.parameters
        pressure += station.uncertainty.pressure_bar
        temperature += station.uncertainty.temperature_k
    width = width if parameters is None else parameters
    memory = np.zeros(IDENTIFICATION_SIZE)
    memory[ERROR : ERROR + 2] = pressure + OUTWARD, temperature + OUTWARD
    memory[COMPRESSOR], memory[AMBIENT] = plant.driving_pressure, plant.ambient_temperature
    memory[COVOLUME], memory[CAPPED] = plant.covolume, math.isfinite(plant.ramp)
    memory[TIME] = np.nan
    believe(believed(plant), width, memory)
    return memory


def believe(constants: np.ndarray, width: float, memory: np.ndarray) -> None:
    """Begin from `constants` (COUNT,), each known to the relative error `width`; 0: nothing is left to identify."""
    memory[CENTRE:HALF] = constants
    memory[HALF:ESTIMATE] = constants * width
    restart(memory)


@kernel
def restart(memory: np.ndarray) -> None:
    """Forget every reading, not that some could not be explained."""
    for item in range(COUNT):
        centre, half = memory[CENTRE + item], memory[HALF + item]
        memory[LOW + item] = centre - half - OUTWARD * centre
        memory[HIGH + item] = centre + half + OUTWARD * centre
        memory[ESTIMATE + item] = centre
    memory[FLOW:FLAGGED] = 0.0
