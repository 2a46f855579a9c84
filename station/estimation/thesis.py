"""The estimation model of the thesis's plant: an extended Kalman filter with augmented states.

Jazwinski 1970, *Stochastic Processes and Filtering Theory*, ch. 8 (extended filter); Friedland 1969,
doi:10.1109/TAC.1969.1099223 (biases as states); scalar measurements one after another after Bierman 1977,
*Factorization Methods for Discrete Sequential Estimation*. The equations are those of `station.plants.thesis`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from station.estimation.belief import Belief, command_of, root_of
from station.estimation.drifting import JUDGED, leave_out
from station.estimation.filter_kernel import run_pass
from station.estimation.interface import (
    AMBIENT,
    KC,
    KD,
    LEAK,
    MV,
    SHARED_STATES,
    TV,
    EstimationModel,
    Followed,
    Tuning,
    first_reading,
    with_fields,
)
from station.estimation.thesis_states import BIASED, DRIFT, PLANT_STATES, N, Scratch, scratch
from station.frames import Frames
from station.geometry import BUFFERS, KELVIN, TANKS, VEHICLE
from station.parameters import Station
from station.plants.interface import M, P, T
from station.plants.thesis import THESIS, PlantConstants, gas_mass, gas_pressure
from station.sensors import OFF, state_size

PRIOR = 0.15
"""Standard deviation of what the station's file says of a parameter, relative."""

PRIOR_PRESSURE = 0.03
"""Likewise of the compressor's pressure."""

PRIOR_AMBIENT = 5.0
"""Likewise of the ambient temperature [K]."""

_AMBIENT = "thermal.ambient_temperature_c"

PARAMETERS = {
    **{f"buffers.{each}.volume_m3": PRIOR for each in BUFFERS},
    **{f"buffers.{each}.inlet_heating_k_per_s": PRIOR for each in BUFFERS},
    **{f"buffers.{each}.outlet_cooling_k_per_s": PRIOR for each in BUFFERS},
    "compressor.pressure_bar": PRIOR_PRESSURE,
    "compressor.inlet_coefficient_g_per_s_bar": PRIOR,
    "dispenser.outlet_coefficient_g_per_s_bar": PRIOR,
    "vehicle.heating_k_per_s": PRIOR,
    "thermal.heat_exchange_per_s": PRIOR,
    _AMBIENT: PRIOR_AMBIENT,
}
"""Fields of a station's file that are found, and their priors' standard deviations: relative, but for a temperature."""

_UNITS = {"mass": "g", "temperature": "degC", "leak": "g/s", "compressor": "", "dispenser": "", "ambient": "K"}
_MASSES, _TEMPERATURES = [0, 1, 2, MV], [3, 4, 5, TV]
"""Places of masses and temperatures of the tanks among the states, in the order of TANKS."""

_FIRST = (0.03, 0.02, 5.0)  # standard deviations at the beginning: leak [g/s], factors [1], ambient [K]


def begin(frames: Frames, station: Station, tuning: Tuning, constants: PlantConstants) -> Scratch:
    """The state of the filter before the first second, from the first minute's readings."""
    s = scratch()
    x, cov = s.x, s.cov
    s.volume[:VEHICLE], s.volume[VEHICLE] = constants.buffer_volume, station.vehicle.volume_m3
    x[KC] = x[KD] = 1.0
    size = _size(tuning)
    for b in range(len(BUFFERS)):
        p, sp = first_reading(frames, b, station.buffers.all[b].initial_pressure_bar, 100.0)
        t, st = first_reading(frames, 4 + b, constants.ambient_temperature, 15.0)
        x[b], x[3 + b] = gas_mass(p, t, constants.buffer_volume[b]), t
        cov[b, b] = (x[b] * sp / p) ** 2 + (x[b] * st / (t + KELVIN)) ** 2
        cov[3 + b, 3 + b] = st * st
        cov[b, 3 + b] = cov[3 + b, b] = -x[b] * st * st / (t + KELVIN)
        if size == N:
            cov[LEAK + b, LEAK + b] = _FIRST[0] ** 2
    if size > PLANT_STATES:
        cov[KC, KC] = cov[KD, KD] = _FIRST[1] ** 2
        cov[AMBIENT, AMBIENT] = _FIRST[2] ** 2
        leave_out(s.drifts, station.unknown_buffers)
    return s


def advance(
    frames: Frames, rows: int, s: Scratch, station: Station, tuning: Tuning, constants: PlantConstants
) -> Followed:
    """Follow the first `rows` seconds; see `EstimationModel`."""
    usual = (station.vehicle.start_pressure_bar, station.vehicle.start_temperature_c, station.vehicle.volume_m3)
    size = _size(tuning)
    found = Followed.empty(rows, JUDGED if size == BIASED else N, tuning.gate)
    values, noise = np.ascontiguousarray(frames.values), np.ascontiguousarray(frames.noise)
    run_pass(
        values, frames.as_read(), noise, frames.relative, frames.memory, s, size, constants, usual, tuning,
        found.states, found.deviations, found.innovations, found.errors,
    )  # fmt: skip
    return found


def _size(tuning: Tuning) -> int:
    """How many states the filter has."""
    if tuning.pressure_bias > 0.0:
        return BIASED
    return N if tuning.leak > 0.0 else PLANT_STATES


def constants_at(station: Station, value: dict[str, float]) -> PlantConstants:
    """The plant's constants with other parameters."""

    def each(field: str) -> tuple[float, float, float]:
        high, medium, low = (value[f"buffers.{name}.{field}"] for name in BUFFERS)
        return high, medium, low

    return station.constants()._replace(
        buffer_volume=each("volume_m3"),
        inlet_heating=each("inlet_heating_k_per_s"),
        outlet_cooling=each("outlet_cooling_k_per_s"),
        compressor_pressure=value["compressor.pressure_bar"],
        inlet_coefficient=value["compressor.inlet_coefficient_g_per_s_bar"],
        outlet_coefficient=value["dispenser.outlet_coefficient_g_per_s_bar"],
        vehicle_heating=value["vehicle.heating_k_per_s"],
        heat_exchange=value["thermal.heat_exchange_per_s"],
        ambient_temperature=value[_AMBIENT],
    )


def station_at(station: Station, values: dict[str, float]) -> Station:
    """The station with other parameters; a buffer never begins above the compressor's pressure."""
    given = with_fields(station, values)
    top = values["compressor.pressure_bar"]
    for name in BUFFERS:
        buffer = given["buffers"][name]
        buffer["initial_pressure_bar"] = min(buffer["initial_pressure_bar"], 0.999 * top)
    return Station.model_validate(given)


def grams_of(station: Station) -> tuple[float, float, float]:
    """The gas of a bar in each bank [g/bar]; see `EstimationModel`."""
    high, medium, low = (gas_mass(1.0, station.thermal.ambient_temperature_c, b.volume_m3) for b in station.buffers.all)
    return high, medium, low


def restate(state: NDArray[np.float64], volume: float, constants: PlantConstants) -> None:
    """Write pressures of masses and temperatures; see `EstimationModel`."""
    for tank, each in enumerate((*constants.buffer_volume, *((volume,) if volume > 0.0 else ()))):
        state[P + tank] = gas_pressure(state[M + tank], state[T + tank], each)


def belief_of(s: Scratch, station: Station, constants: PlantConstants) -> Belief:  # noqa: ARG001
    """The belief before a second; see `EstimationModel`."""
    connected = bool(s.vehicle[0] >= 0.0)
    state = np.zeros(state_size(OFF, THESIS.own))
    state[M : M + len(TANKS)], state[T : T + len(TANKS)] = s.x[_MASSES], s.x[_TEMPERATURES]
    restate(state, float(s.volume[VEHICLE]), constants)
    spread = np.zeros((len(state), PLANT_STATES))
    root = root_of(s.cov[:PLANT_STATES, :PLANT_STATES])
    spread[M : M + len(TANKS)], spread[T : T + len(TANKS)] = root[_MASSES], root[_TEMPERATURES]
    if not connected:
        spread[[M + VEHICLE, T + VEHICLE]] = 0.0
    return Belief(state, spread, float(s.x[AMBIENT]), connected, float(s.volume[VEHICLE]), command_of(s.valve))


THESIS_MODEL = EstimationModel(
    plant=THESIS.name,
    states={name: _UNITS[name.partition("_")[0]] for name in SHARED_STATES},
    scratch=scratch,
    constants_of=lambda station: station.constants(),
    begin=begin,
    advance=advance,
    parameters=PARAMETERS,
    absolute=frozenset({_AMBIENT}),
    metered=frozenset(name for name in PARAMETERS if "volume" in name or "coefficient" in name),
    constants_at=constants_at,
    station_at=station_at,
    belief_of=belief_of,
    restate=restate,
    refill=lambda _state, _finish_pressure, _constants: None,  # the run itself compares pressures
    drift=DRIFT,
    small_leak=0.045,
    grams_of=grams_of,
    scale_of=lambda _station: 1.0,  # Eq. (7.11) allows no larger flow
    power_of=lambda _station: None,  # the same whatever it gives
    air=_AMBIENT,
)
"""The filter of stations of chapter 7's plant."""
