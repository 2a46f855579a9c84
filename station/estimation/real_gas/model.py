"""The estimation model of the faithful plant: an extended Kalman filter around the plant's own second.

As `station.estimation.thesis`, which has its sources; the slopes are differences of the plant's kernels (`slopes.py`).
"""

from __future__ import annotations

import math

import numpy as np

from station.estimation.drifting import JUDGED, leave_out
from station.estimation.interface import (
    EstimationModel,
    Followed,
    Tuning,
    first_reading,
    with_fields,
)
from station.estimation.power import PowerCurve
from station.estimation.real_gas.banks import begin_bank
from station.estimation.real_gas.belief import belief_of, refill, restate
from station.estimation.real_gas.kernel import run_pass
from station.estimation.real_gas.states import (
    AIR,
    BIASED,
    COMPRESSOR,
    DISPENSER,
    DRIFT,
    LEAKS,
    PLANT_STATES,
    STATES,
    WARMER,
    N,
    Scratch,
    scratch,
)
from station.frames import Frames
from station.geometry import BUFFERS, KELVIN
from station.parameters import Station
from station.plants.real_gas import plant as kernels
from station.plants.real_gas.entries import KILO, RealGasConstants
from station.plants.real_gas.fill import PERIOD
from station.plants.real_gas.gas import density_and_enthalpy
from station.plants.real_gas.hydrogen import BAR
from station.plants.real_gas.machines import bank_of, compressor_with, line_with, precooler_with
from station.plants.real_gas.registration import REAL_GAS, compressor_curve

PRIOR = 0.15
"""Standard deviation of what the station's file says of a parameter, relative."""

USUAL_FLOW = 60.0
"""Of the nozzle that tunings and limits of leaks are meant for [g/s]."""

PRIOR_COLD = 3.0
"""Likewise of the precooler's set point [K]."""

_AREA = "real_gas.dispensing.valve_mm2"
_COLD = "real_gas.precooler.set_point_c"
_DISPLACEMENT = "real_gas.compressor.displacement_m3_per_h"

PARAMETERS = {
    **{f"buffers.{each}.volume_m3": PRIOR for each in BUFFERS},
    _DISPLACEMENT: PRIOR,
    "real_gas.compressor.clearance": PRIOR,
    _AREA: PRIOR,
    _COLD: PRIOR_COLD,
}
"""Fields of a station's file that are found, and their priors' standard deviations: relative, but for a temperature."""

_FIRST = {AIR: 5.0, COMPRESSOR: 0.02, DISPENSER: 0.02, WARMER: 0.5, **{LEAKS + b: 0.03 for b in range(len(BUFFERS))}}
"""Standard deviations at the beginning: surroundings [K], factors [1], a precooler's fault [K], leaks [g/s]."""


def constants_of(station: Station) -> RealGasConstants:
    """The plant's constants of a station whose vehicles report."""
    constants: RealGasConstants = REAL_GAS.constants_of(station, communication=True)
    return constants


def begin(frames: Frames, station: Station, tuning: Tuning, constants: RealGasConstants) -> Scratch:
    """The state of the filter before the first second, from the first minute's readings."""
    s = scratch()
    s.volume[0] = station.vehicle.volume_m3
    size = _size(tuning)
    s.health[COMPRESSOR] = s.health[DISPENSER] = 1.0
    for b, buffer in enumerate(station.buffers.all):
        p, sp = first_reading(frames, b, buffer.initial_pressure_bar, 100.0)
        t, st = first_reading(frames, 4 + b, station.thermal.ambient_temperature_c, 15.0)
        kernels.begin(s.state, b, max(p, 1.0), t, buffer.volume_m3, math.nan, constants)
        begin_bank(s, b, sp * BAR, st, constants)
    for place, deviation in _FIRST.items():
        if place < size and not (size == BIASED and LEAKS <= place < LEAKS + len(BUFFERS)):
            s.cov[place, place] = deviation**2
    if size > PLANT_STATES:
        leave_out(s.drifts, station.unknown_buffers)
    return s


def advance(
    frames: Frames, rows: int, s: Scratch, station: Station, tuning: Tuning, constants: RealGasConstants
) -> Followed:
    """Follow the first `rows` seconds; see `EstimationModel`."""
    vehicle, scale = station.vehicle, scale_of(station)
    if tuning.leak > 0.0 and scale > 1.0:
        tuning = tuning._replace(mass=scale * tuning.mass, leak=scale * tuning.leak)
    usual = (vehicle.start_pressure_bar, vehicle.start_temperature_c, vehicle.volume_m3, vehicle.finish_pressure_bar)
    size = _size(tuning)
    found = Followed.empty(rows, JUDGED if size == BIASED else len(STATES), tuning.gate)
    values, noise = np.ascontiguousarray(frames.values), np.ascontiguousarray(frames.noise)
    run_pass(
        values, frames.as_read(), noise, frames.relative, frames.memory, s, size, constants, usual, tuning,
        found.states, found.deviations, found.innovations, found.errors,
    )  # fmt: skip
    return found


def _size(tuning: Tuning) -> int:
    """How many coordinates the filter has."""
    if tuning.pressure_bias > 0.0:
        return BIASED
    return N if tuning.leak > 0.0 else PLANT_STATES


def constants_at(station: Station, values: dict[str, float]) -> RealGasConstants:
    """The plant's constants with other parameters."""
    base, given = constants_of(station), station.real_gas
    if given is None:
        raise AssertionError("constants_of() refuses such a station")
    ambient = station.thermal.ambient_temperature_c + KELVIN
    unit = given.compressor.model_copy(
        update={
            "displacement_m3_per_h": values[_DISPLACEMENT],
            "clearance": values["real_gas.compressor.clearance"],
        }
    )
    high, medium, low = (bank_of(values[f"buffers.{name}.volume_m3"], PERIOD) for name in BUFFERS)
    ways = given.dispensing.model_copy(update={"valve_mm2": values[_AREA]})
    cold = given.precooler.model_copy(update={"set_point_c": values[_COLD]})
    return base._replace(
        station=base.station._replace(
            high=high, medium=medium, low=low, compressor=compressor_with(unit, ambient),
            precooler=precooler_with(cold), line=line_with(ways),
        )
    )  # fmt: skip


def grams_of(station: Station) -> tuple[float, float, float]:
    """The gas of a bar in each bank [g/bar]; see `EstimationModel`."""
    gas, kelvin = constants_of(station).gas, station.thermal.ambient_temperature_c + KELVIN
    found = []
    for bank in station.buffers.all:
        p = bank.initial_pressure_bar * BAR
        denser = density_and_enthalpy(p + BAR, kelvin, gas)[0] - density_and_enthalpy(p, kelvin, gas)[0]
        found.append(denser * bank.volume_m3 * KILO)
    high, medium, low = found
    return high, medium, low


def station_at(station: Station, values: dict[str, float]) -> Station:
    """The station with other parameters."""
    return Station.model_validate(with_fields(station, values))


def scale_of(station: Station) -> float:
    """By how much more than USUAL_FLOW the nozzle lets pass [1]; 1 where it is less.

    A model that is half a percent off misses so much more gas of a fill.
    """
    given = station.real_gas
    return 1.0 if given is None else max(1.0, given.dispensing.flow_max_g_per_s / USUAL_FLOW)


def power_of(station: Station) -> PowerCurve:
    """The curve of the station's compressor."""
    pressure, flow, power = compressor_curve(constants_of(station))
    return PowerCurve(pressure, flow, power)


REAL_GAS_MODEL = EstimationModel(
    plant=REAL_GAS.name,
    states=STATES,
    scratch=scratch,
    constants_of=constants_of,
    begin=begin,
    advance=advance,
    parameters=PARAMETERS,
    absolute=frozenset({_COLD}),
    constants_at=constants_at,
    station_at=station_at,
    belief_of=belief_of,
    restate=restate,
    refill=refill,
    drift=DRIFT,
    small_leak=0.033,
    grams_of=grams_of,
    scale_of=scale_of,
    power_of=power_of,
    late=frozenset({_AREA}),
    metered=frozenset({_AREA, _DISPLACEMENT, *(name for name in PARAMETERS if "volume" in name)}),
)
"""The filter of stations of the plant `real-gas`."""
