"""The kernel of the filter: one pass over a record of seconds; see `station.estimation.filter`."""

from __future__ import annotations

import numpy as np

from station.compiled import inlined, kernel
from station.estimation.covariance import drift_on, turn
from station.estimation.drifting import forget, is_drifting, judge_drifts, lost_mass, warmed
from station.estimation.interface import AMBIENT, BLIND, KC, KD, LEAK, MV, OTHER_VOLUME, TV, Tuning
from station.estimation.jumps import TAKEN, forget_jumps, nearer_gate, note_jump, unless_jump
from station.estimation.noise import note_changes, take_noise
from station.estimation.put_right import is_as_read, judged_reading, use_raw
from station.estimation.resting import hear, note_innovation
from station.estimation.scalar_update import take_reading
from station.estimation.sudden import NOTHING, STANDS, is_doubted
from station.estimation.thermometers import note_warming
from station.estimation.thesis_states import BIASED, PLANT_STATES, N, Scratch, places_of
from station.estimation.thesis_valves import infer, read_valves
from station.geometry import KELVIN, VEHICLE
from station.plants.thesis import (
    PlantConstants,
    buffer_temperature,
    gas_mass,
    gas_pressure,
    inlet_flow,
    next_mass,
    outlet_flow,
    vehicle_temperature,
)
from station.sensor_names import ANALOG, BANK_SENSORS, SENSORS

FLOW_C, FLOW_D = ANALOG.index("flow_compressor"), ANALOG.index("flow_dispenser")
_VALVES, _CONNECTED, _VOLUME = len(ANALOG), SENSORS.index("vehicle"), SENSORS.index("vehicle_volume")
_UNSEEN_GAS = 30.0  # what an outlet may give in a second in which nobody told which vehicle is connected [g]
_UNREAD = 10.0  # error of the temperature of a buffer that begins anew without a thermometer [K]
_UNSEEN_HEAT = 0.3  # how much warmer a tank may get in a second whose valves nobody told [K]


@inlined
def _update(s: Scratch, size: int, error: float, variance: float, gate: float, bounded: bool) -> float:
    """One reading: `error` is it less its prediction, `s.h` its slopes. The innovation in standard deviations."""
    for i in range(size):
        s.column[i] = 0.0
    for j in range(size):
        slope = s.h[j]
        if slope != 0.0:
            for i in range(size):
                s.column[i] += slope * s.cov[j, i]
    spread = variance
    for i in range(size):
        spread += s.h[i] * s.column[i]
    return take_reading(s.x, s.cov, s.column, size, error, spread, gate, bounded)


@inlined
def _begin(s: Scratch, tank: int, pressure: float, temperature: float, sp: float, st: float) -> None:
    """Begin a tank with readings and their noise."""
    m, t = places_of(tank)
    mass = gas_mass(pressure, temperature, s.volume[tank])
    s.x[m], s.x[t] = mass, temperature
    for j in range(BIASED):
        s.cov[m, j], s.cov[j, m], s.cov[t, j], s.cov[j, t] = 0.0, 0.0, 0.0, 0.0
    by_heat = mass / (temperature + KELVIN)
    s.cov[m, m], s.cov[t, t] = (mass * sp / pressure) ** 2 + (by_heat * st) ** 2, st * st
    s.cov[m, t], s.cov[t, m] = -by_heat * st * st, -by_heat * st * st


@inlined
def _connect(s: Scratch, values: np.ndarray, noise: np.ndarray, usual: tuple[float, float, float]) -> None:
    """Begin a vehicle with its first readings; where there are none, with the usual ones and little trust."""
    p, t, sp, st = values[VEHICLE], values[4 + VEHICLE], noise[VEHICLE], noise[4 + VEHICLE]
    if np.isnan(p):
        p, sp = usual[0], 100.0
    if np.isnan(t):
        t, st = usual[1], 10.0
    _begin(s, VEHICLE, p, t, sp, st)
    s.behind[VEHICLE] = s.blind[VEHICLE] = 0.0


@inlined
def _begin_anew(s: Scratch, values: np.ndarray, noise: np.ndarray, tanks: int) -> None:
    """Begin tanks anew by their readings, of which nobody knows what they gave and were given before."""
    for tank in range(4):
        s.anew[tank] = 0.0
        if tank < tanks and s.blind[tank] >= BLIND and not np.isnan(values[tank]):
            s.anew[tank] = 1.0
            forget_jumps(s.jumps, tank)
            t, st = values[4 + tank] + s.behind[tank], noise[4 + tank]
            if np.isnan(t):
                t, st = s.x[places_of(tank)[1]], _UNREAD
            _begin(s, tank, max(values[tank], 1.0), t, noise[tank], st)


@inlined
def _note_blind(s: Scratch, values: np.ndarray, doubt: bool) -> None:
    """Count the seconds in a row in which nobody told what a tank gave and was given.

    Nobody told who is connected, and an outlet may be open: it may have given something to somebody.
    """
    unknown, given = doubt and values[FLOW_D] != 0.0, False
    for tank in range(4):
        hidden = given
        if tank < VEHICLE:
            out = s.unseen[3 + tank] > 0.0 or (unknown and not values[_VALVES + 3 + tank] < 0.5)
            hidden, given = s.unseen[tank] > 0.0 or out, given or out
        if hidden:
            s.blind[tank] += 1.0
        elif s.blind[tank] < BLIND or s.anew[tank] != 0.0:
            s.blind[tank] = 0.0


@inlined
def _read_tanks(
    s: Scratch, size: int, values: np.ndarray, noise: np.ndarray, seen: int, gate: float, innovations: np.ndarray,
    errors: np.ndarray,
) -> None:  # fmt: skip
    """Pressures and temperatures of the first `seen` tanks."""
    for channel in range(8):
        tank, y = channel % 4, values[channel]
        if tank >= seen or np.isnan(y) or s.anew[tank] != 0.0:
            continue
        m, t = places_of(tank)
        s.h[:] = 0.0
        if channel < 4:
            expected = gas_pressure(s.x[m], s.x[t], s.volume[tank])
            s.h[m], s.h[t] = expected / s.x[m], expected / (s.x[t] + KELVIN)
        else:
            expected = s.x[t] - s.behind[tank]
            s.h[t] = 1.0
        if size == BIASED and tank < VEHICLE:
            bias = LEAK + tank if channel < 4 else N + tank
            s.h[bias], expected = 1.0, expected + s.x[bias]
        errors[channel] = y - expected
        known = size > PLANT_STATES and tank < VEHICLE and not is_drifting(s.drifts, tank, channel >= 4)
        error, sigma = errors[channel] - (s.jumps[channel, TAKEN] if known else 0.0), noise[channel]
        nearer = nearer_gate(s.jumps, channel, sigma, gate) if known else gate
        normal = _update(s, size, error, sigma**2, nearer, False)
        as_read = note_jump(s.jumps, channel, normal, error, sigma, nearer, gate) if known else normal
        innovations[channel] = unless_jump(s.jumps, channel, normal) if size == BIASED and known else as_read


@inlined
def _flows(s: Scratch, tanks: int, plant: PlantConstants) -> None:
    """What would flow through each valve, and its slopes, from the states as they are."""
    s.x[KC] = max(s.x[KC], NOTHING)
    for tank in range(tanks):
        m, t = places_of(tank)
        s.pressure[tank] = gas_pressure(s.x[m], s.x[t], s.volume[tank])
        s.by_mass[tank], s.by_heat[tank] = s.pressure[tank] / s.x[m], s.pressure[tank] / (s.x[t] + KELVIN)
    for b in range(3):
        one = inlet_flow(s.pressure[b], plant)
        rate = -s.x[KC] * plant.inlet_coefficient
        s.flow[b], s.slope[b, KC] = s.x[KC] * one, one
        s.slope[b, b], s.slope[b, 3 + b] = rate * s.by_mass[b], rate * s.by_heat[b]
        if tanks == 4:
            one = outlet_flow(s.pressure[b], s.pressure[VEHICLE], plant)
            rate = s.x[KD] * plant.outlet_coefficient
            s.flow[3 + b], s.slope[3 + b, KD] = s.x[KD] * one, one
            s.slope[3 + b, b], s.slope[3 + b, 3 + b] = rate * s.by_mass[b], rate * s.by_heat[b]
            s.slope[3 + b, MV], s.slope[3 + b, TV] = -rate * s.by_mass[VEHICLE], -rate * s.by_heat[VEHICLE]


@inlined
def _expect(s: Scratch, first: int) -> tuple[float, float]:
    """What flows through three valves, and what would with machines that do all that they should; slopes in `s.h`."""
    expected, healthy = 0.0, 0.0
    s.h[:] = 0.0
    for v in range(first, first + 3):
        if s.valve[v] != 0.0:
            expected += s.flow[v]
            healthy += s.slope[v, KC] + s.slope[v, KD]
            for j in range(N):
                s.h[j] += s.slope[v, j]
    unknown = s.unseen[first] + s.unseen[first + 1] + s.unseen[first + 2] > 0.0
    return expected, -1.0 if unknown else healthy


@inlined
def _judged_meter(s: Scratch, size: int, side: int, row: int, raw: np.ndarray, read: float) -> float:
    """The reading of a meter, unless it may just have been put right."""
    if is_as_read(row, side, raw, read):
        return read
    expected, healthy = _expect(s, 3 * side)
    if healthy <= 0.0:
        return read
    channel = FLOW_C + side
    variance = s.noise[channel] ** 2 + (s.relative[channel] * expected) ** 2
    for i in range(size):
        for j in range(size):
            if s.h[i] != 0.0 and s.h[j] != 0.0:
                variance += s.h[i] * s.cov[i, j] * s.h[j]
    return judged_reading(s.put, side, raw[row, side], read, expected, np.sqrt(variance))


@inlined
def _hear_meter(s: Scratch, size: int, side: int, row: int, raw: np.ndarray, read: np.ndarray) -> None:
    """Take a meter's reading if it counts, and what it says of valves that nobody told."""
    channel = FLOW_C + side
    read[channel] = _judged_meter(s, size, side, row, raw, read[channel])
    infer(s, 3 * side, read[channel], s.noise[channel], s.relative[channel])


@inlined
def _read_flow(
    s: Scratch, size: int, first: int, read: float, noise: float, relative: float, gate: float
) -> tuple[float, float]:
    """One flow meter, that of the three valves from `first` on: its innovation and error; NaN where nothing flows."""
    expected, healthy = _expect(s, first)
    if np.isnan(read) or healthy <= 0.0:
        return np.nan, np.nan
    spread = noise**2 + (relative * expected) ** 2
    return _update(s, size, read - expected, spread, gate, size > PLANT_STATES), read - expected


@inlined
def _read_compressor(
    s: Scratch, size: int, read: float, noise: float, relative: float, gate: float
) -> tuple[float, float]:
    """The compressor's meter, which is used unless it reads all at once something else than the pressures say."""
    expected, healthy = _expect(s, 0)
    if np.isnan(read) or healthy <= 0.0 or (size == PLANT_STATES and read == 0.0):
        return np.nan, np.nan
    spread = np.sqrt(noise**2 + (relative * expected) ** 2)
    doubted = False
    if size > PLANT_STATES:
        doubted, s.x[KC] = is_doubted(s.doubt, s.x[KC], s.cov, KC, size, read, healthy, gate * spread)
        expected = s.x[KC] * healthy
    off = read - expected
    if doubted:
        return off / np.sqrt(spread**2 + healthy**2 * s.cov[KC, KC]), off
    normal = _update(s, size, off, spread**2, gate, size > PLANT_STATES)
    return (np.nan, np.nan) if read == 0.0 and s.x[KC] < STANDS else (normal, off)


@inlined
def _stands(s: Scratch, size: int, read: float) -> bool:
    """Whether a compressor does not work; without its health, as its meter says."""
    return s.x[KC] < STANDS and s.doubt[0] == 0.0 if size > PLANT_STATES else read == 0.0


@inlined
def _advance(s: Scratch, size: int, connected: bool, memory: np.ndarray, plant: PlantConstants) -> None:
    """The states a second on, in `s.drift` the slopes of what was added, and how far thermometers are behind then."""
    s.drift[:, :] = 0.0
    for tank in range(4):
        s.before[tank] = s.x[places_of(tank)[1]]
    gained, outlets = 0.0, 0.0
    warm = s.x[AMBIENT] * plant.heat_exchange
    for b in range(3):
        inlet, outlet = s.valve[b], s.valve[3 + b] if connected else 0.0
        for j in range(N):
            s.drift[b, j] += inlet * s.slope[b, j] - outlet * s.slope[3 + b, j]
            s.drift[MV, j] += outlet * s.slope[3 + b, j]
        leak = 0.0
        if size == N:
            leak, s.drift[b, LEAK + b] = s.x[LEAK + b], -1.0
        inflow, outflow = inlet * s.flow[b], outlet * s.flow[3 + b]
        gained += outflow
        outlets += outlet
        s.x[3 + b] = buffer_temperature(b, s.x[3 + b], inlet, outlet, plant, 1.0) + warm
        s.x[b] = max(next_mass(s.x[b], inflow, outflow + leak, 1.0), 1.0)
        s.drift[3 + b, 3 + b], s.drift[3 + b, AMBIENT] = -plant.heat_exchange, plant.heat_exchange
    if connected:
        s.x[TV] = vehicle_temperature(s.x[TV], outlets, plant, 1.0) + warm
        s.x[MV] = max(next_mass(s.x[MV], gained, 0.0, 1.0), 1.0)
        s.drift[TV, TV], s.drift[TV, AMBIENT] = -plant.heat_exchange, plant.heat_exchange
    for tank in range(4):
        note_warming(s.behind, tank, s.x[places_of(tank)[1]] - s.before[tank], memory)


@inlined
def _widen(s: Scratch, size: int, doubt: bool, perhaps: tuple[float, float, float], tuning: Tuning) -> None:
    """What a second adds to the covariance: what the model does not say, and what nobody told of valves."""
    lost = 0.0
    for b in range(3):
        inlet, outlet = s.unseen[b] * s.moved[b], s.unseen[3 + b] * s.moved[3 + b]
        into, out = np.sqrt(inlet) * s.flow[b], np.sqrt(outlet) * s.flow[3 + b]
        heats = inlet + outlet + (s.valve[b] if s.doubt[0] > 0.0 else 0.0)
        if doubt and perhaps[b] != 0.0:
            out, heats = _UNSEEN_GAS, heats + 1.0
        unseen = (into**2 + out**2) * max(2.0 * s.blind[b] - 1.0, 1.0)  # the same flow second after second, perhaps
        lost += out**2
        s.cov[b, b] += tuning.mass**2 + unseen + lost_mass(s.drifts, b) ** 2
        s.cov[3 + b, 3 + b] += tuning.temperature**2 + _UNSEEN_HEAT**2 * heats + warmed(s.drifts, b) ** 2
        if size == BIASED:
            forget(s.x, s.cov, LEAK + b, tuning.pressure_bias, s.drifts, b)
            forget(s.x, s.cov, N + b, tuning.temperature_bias, s.drifts, VEHICLE + b)
        else:
            s.cov[LEAK + b, LEAK + b] += tuning.leak**2
    s.cov[MV, MV] += tuning.mass**2 + lost
    heats = s.unseen[3] * s.moved[3] + s.unseen[4] * s.moved[4] + s.unseen[5] * s.moved[5]
    s.cov[TV, TV] += tuning.temperature**2 + _UNSEEN_HEAT**2 * heats
    s.cov[KC, KC] += tuning.factor**2 if s.valve[0] + s.valve[1] + s.valve[2] > 0.0 else 0.0
    s.cov[KD, KD] += tuning.factor**2 if s.valve[3] + s.valve[4] + s.valve[5] > 0.0 else 0.0
    s.cov[AMBIENT, AMBIENT] += tuning.ambient**2


@inlined
def _keep(
    s: Scratch, size: int, connected: bool, innovations: np.ndarray, gate: float, states: np.ndarray,
    deviations: np.ndarray,
) -> None:  # fmt: skip
    if size == BIASED:
        for k in range(len(BANK_SENSORS)):
            place = LEAK + k if k < VEHICLE else N + k - VEHICLE
            states[k], deviations[k] = s.x[place], np.sqrt(max(s.cov[place, place], 0.0))
        grams = (1.0 / s.by_mass[0], 1.0 / s.by_mass[1], 1.0 / s.by_mass[2])
        judge_drifts(s.drifts, states, innovations, gate, (s.x[KC], s.x[KD]), grams)
        return
    for i in range(N):
        there = connected or i not in (MV, TV)
        states[i] = s.x[i] if there else np.nan
        deviations[i] = np.sqrt(max(s.cov[i, i], 0.0)) if there else np.nan


@kernel
def run_pass(
    values: np.ndarray, raw: np.ndarray, noise: np.ndarray, relative: np.ndarray, memory: np.ndarray, s: Scratch,
    size: int, plant: PlantConstants, usual: tuple[float, float, float], tuning: Tuning, states: np.ndarray,
    deviations: np.ndarray, innovations: np.ndarray, errors: np.ndarray,
) -> None:  # fmt: skip
    """Follow a record; `usual` is the pressure, temperature and volume of a vehicle of which nothing is known.

    `raw` is `Frames.raw`. A second's readings come first, then what flows in it. As many rows are followed as `states`
    has; a row of `values` beyond them is only looked at, since what the next second tells of the vehicle counts for
    this one.
    """
    vehicle = s.vehicle[0]
    for row in range(states.shape[0]):
        read, wrong, normal = s.heard, errors[row], innovations[row]
        hear(s.runs, values[row], noise[row], read, s.tag_noise)
        use_raw(s.put, row, raw, read)
        take_noise(s.loud, s.tag_noise, relative, s.noise, s.relative)
        told = read[_CONNECTED]
        fresh = not np.isnan(told) and told != vehicle
        vehicle = told if fresh else vehicle
        connected = vehicle >= 0.0
        fresh = fresh and connected
        doubt = np.isnan(told) and not (row + 1 < len(values) and values[row + 1, _CONNECTED] == vehicle)
        s.volume[VEHICLE] = usual[2] if fresh else s.volume[VEHICLE]
        if connected and not np.isnan(read[_VOLUME]):
            other = abs(read[_VOLUME] - s.volume[VEHICLE]) > OTHER_VOLUME * s.volume[VEHICLE]
            s.volume[VEHICLE], fresh = read[_VOLUME], fresh or (other and not np.isnan(read[VEHICLE]))
        if fresh:
            _connect(s, read, s.noise, usual)
        _begin_anew(s, read, s.noise, 4 if connected else 3)
        _read_tanks(s, size, read, s.noise, 4 if connected and not fresh else 3, tuning.gate, normal, wrong)
        tanks = 4 if connected else 3
        _flows(s, tanks, plant)
        read_valves(s, read, values[row + 1] if row + 1 < len(values) else s.nothing, plant.compressor_count)
        perhaps = (max(s.valve[3], s.unseen[3]), max(s.valve[4], s.unseen[4]), max(s.valve[5], s.unseen[5]))
        _hear_meter(s, size, 0, row, raw, read)
        normal[FLOW_C], wrong[FLOW_C] = _read_compressor(
            s, size, read[FLOW_C], s.noise[FLOW_C], s.relative[FLOW_C], tuning.gate
        )
        if connected:
            _flows(s, tanks, plant)
            _hear_meter(s, size, 1, row, raw, read)
            normal[FLOW_D], wrong[FLOW_D] = _read_flow(
                s, size, 3, np.nan if doubt else read[FLOW_D], s.noise[FLOW_D], s.relative[FLOW_D], tuning.gate
            )
        else:  # nothing flows out, whatever the valves do
            s.unseen[3:] = 0.0
        if size > PLANT_STATES:  # a calibration's innovations are those of its parameters
            note_changes(s.loud, normal, wrong, s.tag_noise, relative, read, tuning.gate)
        for channel in range(s.runs.shape[0]):
            note_innovation(s.runs, channel, normal[channel], tuning.gate)
        _note_blind(s, read, doubt)
        _keep(s, size, connected, normal, tuning.gate, states[row], deviations[row])
        inlets = (s.valve[0], s.valve[1], s.valve[2])
        if _stands(s, size, read[FLOW_C]):  # they are as if closed: nothing flows in, nothing is warmed
            s.valve[0], s.valve[1], s.valve[2] = 0.0, 0.0, 0.0
        _flows(s, tanks, plant)
        _advance(s, size, connected, memory, plant)
        drift_on(s.cov, s.half, s.drift, size)
        turn(s.half, size)
        drift_on(s.half, s.cov, s.drift, size)
        _widen(s, size, doubt, perhaps, tuning)
        s.valve[0], s.valve[1], s.valve[2] = inlets
    s.vehicle[0] = vehicle
