"""One pass of the faithful plant's filter over a record of seconds."""

from __future__ import annotations

import numpy as np

from station.compiled import kernel, uncounted
from station.estimation.interface import OTHER_VOLUME, Tuning
from station.estimation.noise import note_changes, take_noise
from station.estimation.put_right import use_raw
from station.estimation.real_gas.banks import begin_anew, note_blind
from station.estimation.real_gas.metered import give_as_read, give_to_another
from station.estimation.real_gas.outlets import read_area
from station.estimation.real_gas.readings import (
    apply,
    judged_meter,
    keep,
    keep_biases,
    read_compressor,
    read_flow,
    read_tanks,
)  # fmt: skip
from station.estimation.real_gas.slopes import P_ENERGY, P_MASS, P, look_at, second_on
from station.estimation.real_gas.states import BIASED, PLANT_STATES, RAMP_AIM, VEHICLE_ENERGY, VEHICLE_MASS, Scratch
from station.estimation.real_gas.transition import leave_behind, propagate, widen
from station.estimation.real_gas.valves import FLOWS, read_valves
from station.estimation.real_gas.visits import connect, disconnect
from station.estimation.resting import hear, note_innovation
from station.geometry import INLETS, VEHICLE
from station.plants.real_gas.entries import INSIDE, RealGasConstants, connected_visit
from station.plants.real_gas.hydrogen import BAR
from station.plants.real_gas.layout import BANKS
from station.plants.real_gas.tank import MASS
from station.sensor_names import ANALOG, SENSORS

_FLOW_C, _FLOW_D = ANALOG.index("flow_compressor"), ANALOG.index("flow_dispenser")
_CONNECTED, _VOLUME = SENSORS.index("vehicle"), SENSORS.index("vehicle_volume")
_INLETS, _OUTLETS = SENSORS.index("inlet_high"), SENSORS.index("outlet_high")
_NEARLY = 0.98  # of what ends a fill, from where on a small flow may be its last [1]
_LATE = 5e5  # how far the ramp may be ahead of a pressure that was not the first [Pa]


@uncounted
def _is_another(s: Scratch, read: np.ndarray, noise: np.ndarray, gate: float, plant: RealGasConstants) -> bool:
    """Whether the pressure of a vehicle cannot be that of the one connected."""
    look_at(s, VEHICLE, s.volume[0], plant.station, plant.gas)
    by_mass, by_energy = s.gas[VEHICLE, P_MASS], s.gas[VEHICLE, P_ENERGY]
    m, e = VEHICLE_MASS, VEHICLE_ENERGY
    spread = by_mass * by_mass * s.cov[m, m] + 2.0 * by_mass * by_energy * s.cov[m, e]
    spread += by_energy * by_energy * s.cov[e, e] + (noise[VEHICLE] * BAR) ** 2
    return bool(abs(read[VEHICLE] * BAR - s.gas[VEHICLE, P]) > gate * np.sqrt(spread))


@uncounted
def _vehicle_told(
    s: Scratch, read: np.ndarray, noise: np.ndarray, coming: np.ndarray, then: float, gate: float,
    plant: RealGasConstants,
) -> float:  # fmt: skip
    """The vehicle that a second tells, or one that the next second (`coming`) tells and that has come already.

    It has where an outlet is open and no other is connected, or where the pressure is not that of the other. Where
    nobody told of an outlet that is open in the next second, a flow or the pressure of a vehicle says it.
    """
    told = read[_CONNECTED]
    if not np.isnan(told) or np.isnan(then) or then < 0.0 or then == s.vehicle[0]:
        return told
    if s.vehicle[0] >= 0.0:
        return then if _is_another(s, read, noise, gate, plant) else told
    is_seen = read[_FLOW_D] > FLOWS * noise[_FLOW_D] or not np.isnan(read[VEHICLE])
    for outlet in range(_OUTLETS, _OUTLETS + BANKS):
        if read[outlet] >= 0.5 or (is_seen and np.isnan(read[outlet]) and coming[outlet] >= 0.5):
            return then
    return told


@uncounted
def _come_and_go(
    s: Scratch, read: np.ndarray, noise: np.ndarray, coming: np.ndarray, then: float,
    usual: tuple[float, float, float, float], gate: float, plant: RealGasConstants,
) -> bool:  # fmt: skip
    """Let the vehicle go or come that a second tells; whether its readings are used by that.

    One whose pressure was not read begins again when it is, and one whose volume is told late.
    """
    told = _vehicle_told(s, read, noise, coming, then, gate, plant)
    p, kelvin, sp, st = read[VEHICLE], read[4 + VEHICLE], noise[VEHICLE], noise[4 + VEHICLE]
    if np.isnan(told) or told == s.vehicle[0]:
        volume = read[_VOLUME]
        other = s.vehicle[0] >= 0.0 and abs(volume - s.volume[0]) > OTHER_VOLUME * s.volume[0]
        if (s.unread[0] == 0.0 and not other) or np.isnan(p):
            return False
        s.unread[0] = 0.0
        s.volume[0] = volume if other else s.volume[0]
        disconnect(s, plant)
        connect(s, p, kelvin, sp, st, usual, plant)
        s.cov[RAMP_AIM, RAMP_AIM] += _LATE * _LATE
        return True
    if s.vehicle[0] >= 0.0:
        disconnect(s, plant)
    s.vehicle[0] = told
    s.unread[0] = 1.0 if told >= 0.0 and np.isnan(p) else 0.0
    if told < 0.0:
        return False
    s.volume[0] = usual[2] if np.isnan(read[_VOLUME]) else read[_VOLUME]
    connect(s, p, kelvin, sp, st, usual, plant)
    if np.isnan(read[_CONNECTED]):  # nobody knows since when
        s.cov[RAMP_AIM, RAMP_AIM] += _LATE * _LATE
    return True


@uncounted
def _is_last(
    s: Scratch, read: np.ndarray, noise: float, relative: float, then: float, gate: float, plant: RealGasConstants
) -> bool:
    """Whether a fill ends in a second, as far as is known: the vehicle has left after it, or the meter says so.

    The meter is believed where nobody tells the vehicle, and where the vehicle is nearly full.
    """
    vehicle = s.vehicle[0]
    if vehicle < 0.0 or (not np.isnan(then) and then != vehicle):
        return bool(vehicle >= 0.0)
    if np.isnan(then) and np.isnan(read[_CONNECTED]) and np.isnan(read[_FLOW_D]):
        return True
    held, expected = s.state[INSIDE + plant.station.vehicle_at + MASS], s.flow[1]
    if not np.isnan(then) and held < _NEARLY * connected_visit(s.state).mass:
        return False
    return bool(read[_FLOW_D] < expected - gate * np.sqrt(noise * noise + (relative * expected) ** 2))


@uncounted
def _correct_gift(
    s: Scratch, read: np.ndarray, command: int, how: tuple[bool, bool], then: float, gate: float,
    plant: RealGasConstants,
) -> None:  # fmt: skip
    """What the banks gave in a second where the model does not say it; `how`: a fill by its meter alone, its last."""
    meter, noise, relative = read[_FLOW_D], s.noise[_FLOW_D], s.relative[_FLOW_D]
    metered, last = how
    if metered:
        give_as_read(s, command, meter, noise, relative, plant)
        return
    untold = np.isnan(read[_CONNECTED]) and then != s.vehicle[0]
    if untold and give_to_another(s, command, meter, noise, relative, gate, plant):
        return
    if last:
        leave_behind(s, command, meter, noise, relative, plant)


@kernel
def run_pass(
    values: np.ndarray, raw: np.ndarray, noise: np.ndarray, relative: np.ndarray, memory: np.ndarray, s: Scratch,
    size: int, plant: RealGasConstants, usual: tuple[float, float, float, float], tuning: Tuning, states: np.ndarray,
    deviations: np.ndarray, innovations: np.ndarray, errors: np.ndarray,
) -> None:  # fmt: skip
    """Follow a record; `usual`: pressure, temperature, volume and nominal pressure of an unknown vehicle.

    `raw` is `Frames.raw`. A second's readings come first, then what flows in it. As many rows are followed as `states`
    has; a row of `values` beyond them is only looked at, since what the next second tells of vehicle and valves counts
    for this one.
    """
    for row in range(states.shape[0]):
        read, wrong, normal = s.heard, errors[row], innovations[row]
        hear(s.runs, values[row], noise[row], read, s.tag_noise)
        use_raw(s.put, row, raw, read)
        take_noise(s.loud, s.tag_noise, relative, s.noise, s.relative)
        coming = values[row + 1] if row + 1 < values.shape[0] else values[row]
        then = coming[_CONNECTED] if row + 1 < values.shape[0] else np.nan
        fresh = _come_and_go(s, read, s.noise, coming, then, usual, tuning.gate, plant)
        connected = s.vehicle[0] >= 0.0
        begin_anew(s, read, s.noise, plant)
        read_tanks(s, size, read, s.noise, connected, fresh, tuning.gate, memory, normal, wrong, plant)
        command = read_valves(s, read, s.noise, coming, connected, plant.compressor_count)
        note_blind(s, read, then)
        metered = connected and s.unread[0] != 0.0
        flowing = command & INLETS if metered else command
        if metered:  # its temperature is read, and was not predicted
            normal[4 + VEHICLE], wrong[4 + VEHICLE] = np.nan, np.nan
        second_on(s, size, flowing, connected, plant)
        if size == PLANT_STATES and read[_FLOW_C] == 0.0 and s.flow[0] > 0.0:  # without its health, as its meter says
            second_on(s, size, flowing & ~INLETS, connected, plant)
        s.delta[:] = 0.0
        inlets_told = not np.isnan(read[_INLETS : _INLETS + BANKS]).any()
        read[_FLOW_C] = judged_meter(s, size, 0, row, raw, read[_FLOW_C])
        normal[_FLOW_C], wrong[_FLOW_C] = read_compressor(
            s, size, read[_FLOW_C], s.noise[_FLOW_C], s.relative[_FLOW_C], tuning.gate, inlets_told
        )
        read[_FLOW_D] = judged_meter(s, size, 1, row, raw, read[_FLOW_D])
        last = _is_last(s, read, s.noise[_FLOW_D], s.relative[_FLOW_D], then, tuning.gate, plant)
        if connected and not last and not metered:
            read_area(s, size, command, read[_FLOW_D], s.noise[_FLOW_D], s.relative[_FLOW_D], tuning.gate, plant)
            normal[_FLOW_D], wrong[_FLOW_D] = read_flow(
                s, size, 1, read[_FLOW_D], s.noise[_FLOW_D], s.relative[_FLOW_D], tuning.gate
            )  # fmt: skip
        if size > PLANT_STATES:  # a calibration's innovations are those of its parameters
            note_changes(s.loud, normal, wrong, s.tag_noise, relative, read, tuning.gate)
        for channel in range(s.runs.shape[0]):
            note_innovation(s.runs, channel, normal[channel], tuning.gate)
        apply(s, size, plant)
        if size == BIASED:
            keep_biases(s, normal, tuning.gate, states[row], deviations[row])
        else:
            keep(s, connected, states[row], deviations[row], plant)
        propagate(s, size, plant)
        widen(s, size, connected, tuning)
        _correct_gift(s, read, command, (metered, last), then, tuning.gate, plant)
