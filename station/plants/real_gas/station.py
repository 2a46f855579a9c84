"""The faithful station: three banks, compressors, precooler, dispenser and vehicle, as kernels of one flat state.

The kernels are `start`, `connect`, `advance`, `fill_ends` and `disconnect`; a command is the six bits of the thesis's
valves, inlets of the high, medium and low bank and then outlets. The period of `advance` is the one that the tanks were
made for; where no vehicle is connected any tank and visit may be given. Every kilogram and joule that crosses the
boundary of station and connected vehicle is counted in the ledger, so that balances close to rounding.
"""

from __future__ import annotations

import numpy as np

from station.compiled import uncounted
from station.plants.real_gas.compressor import compressor_flow, compressor_work
from station.plants.real_gas.dispensing import dispense, wanted
from station.plants.real_gas.fill import BY_CHARGE, BY_PRESSURE, BY_TEMPERATURE, NOT_ENDED, WHEN_FULL
from station.plants.real_gas.gas import density_and_enthalpy, enthalpy
from station.plants.real_gas.gas import state as gas_state
from station.plants.real_gas.layout import (
    AIM,
    ALL_BANKS,
    BANKS,
    BEFORE,
    BLOCK,
    CAME,
    CAME_ENERGY,
    COMPRESSED,
    CONNECTED,
    DELIVERY,
    ELECTRIC,
    HEAT,
    LEAKED,
    LINE_ENERGY,
    LINE_MASS,
    LOST,
    NOTE,
    NOTES,
    REJECTED,
    SUPPLIED_ENERGY,
    TAIL,
    VENTED,
    VENTED_ENERGY,
    WENT,
    WENT_ENERGY,
    WORK,
    RealGasStation,
    Visit,
    bank_at,
)
from station.plants.real_gas.precooler import block_after
from station.plants.real_gas.tables import GasTables
from station.plants.real_gas.tank import (
    CELLS,
    ENERGY,
    MASS,
    SURFACE,
    Tank,
    add,
    draw,
    fill_state,
    give_heat,
    inner_transfer,
    look,
    look_closely,
    look_warmly,
    settle,
    stiffness,
)

_FULL = 1e-4
"""A fill has reached its mass when it lacks no larger share of it: what is left is on its way through the line."""

_NEAR = 10.0
"""A vehicle further below its limit is not warmed to it within a second [K]."""

_AT_PRESSURE = 2e4
"""A fill has reached its pressure when it lacks no more [Pa]."""


def new_state(
    station: RealGasStation, pressures: tuple[float, float, float], kelvin: float, gas: GasTables
) -> np.ndarray:
    """The state with banks at pressures [Pa] and a temperature [K], an empty line, and a cold precooler."""
    state = np.zeros(station.rest_at + TAIL)
    for place, (bank, pressure) in enumerate(zip((station.high, station.medium, station.low), pressures, strict=True)):
        fill_state(state, place * station.stride, bank, pressure, kelvin, kelvin, gas)
    start(state, station, gas)
    return state


@uncounted
def start(state: np.ndarray, station: RealGasStation, gas: GasTables) -> None:
    """Empty the line and cool the precooler down, as before the first second."""
    tail = state[station.rest_at :]
    _empty_line(tail, station, gas)
    tail[BLOCK] = station.precooler.set_point
    tail[DELIVERY] = np.nan


@uncounted
def _empty_line(tail: np.ndarray, station: RealGasStation, gas: GasTables) -> None:
    """Leave in the line what its vent pressure holds at the ambient temperature."""
    rho, h = density_and_enthalpy(station.line.vent, station.ambient, gas)
    tail[LINE_MASS] = rho * station.line.volume
    tail[LINE_ENERGY] = tail[LINE_MASS] * (h - station.line.vent / rho)


@uncounted
def connect(state: np.ndarray, vehicle: Tank, visit: Visit, station: RealGasStation, gas: GasTables) -> None:
    """Connect a vehicle; what it brings is counted."""
    at, tail = station.vehicle_at, state[station.rest_at :]
    fill_state(state, at, vehicle, visit.pressure, visit.temperature, visit.temperature, gas)
    tail[CAME] += state[at + MASS]
    tail[CAME_ENERGY] += stored_energy(state, at, vehicle)
    tail[AIM], tail[CONNECTED], tail[HEAT], tail[BEFORE] = visit.pressure, 1.0, 0.0, visit.temperature


@uncounted
def disconnect(state: np.ndarray, vehicle: Tank, station: RealGasStation, gas: GasTables) -> None:
    """Let the vehicle go and vent the line; both are counted."""
    at, tail = station.vehicle_at, state[station.rest_at :]
    tail[WENT] += state[at + MASS]
    tail[WENT_ENERGY] += stored_energy(state, at, vehicle)
    for entry in range(at, station.rest_at):
        state[entry] = 0.0
    mass, energy = tail[LINE_MASS], tail[LINE_ENERGY]
    _empty_line(tail, station, gas)
    tail[VENTED] += mass - tail[LINE_MASS]
    tail[VENTED_ENERGY] += energy - tail[LINE_ENERGY]
    tail[CONNECTED], tail[DELIVERY] = 0.0, np.nan


@uncounted
def fill_ends(
    state: np.ndarray, vehicle: Tank, visit: Visit, station: RealGasStation, period: float, gas: GasTables
) -> int:
    """Reason that ends the connected vehicle's fill now, an `End`; `NOT_ENDED` for none.

    The temperature ends it a period before it would be passed: warming goes on as it did, or grows to all that the
    ramp lets flow.
    """
    at, tail = station.vehicle_at, state[station.rest_at :]
    p, kelvin = look(state, at, vehicle, gas)
    before = tail[BEFORE]
    tail[BEFORE] = kelvin
    if state[at + MASS] >= visit.mass * (1.0 - _FULL):
        return BY_CHARGE
    if p >= visit.pressure_max - _AT_PRESSURE:
        return BY_PRESSURE if visit.mass < np.inf else WHEN_FULL
    then = kelvin + max(kelvin - before, 0.0)
    if then < visit.temperature_max and then > visit.temperature_max - _NEAR:
        mass = wanted(state, vehicle, visit, station, period, gas).mass
        delivered = tail[DELIVERY] if tail[DELIVERY] > 0.0 else station.ambient
        u = state[at + ENERGY] / state[at + MASS]
        then = max(
            then,
            _kelvin_with(state[at + MASS] / vehicle.volume, u, mass / vehicle.volume, enthalpy(p, delivered, gas), gas),
        )
    return BY_TEMPERATURE if then >= visit.temperature_max else NOT_ENDED


@uncounted
def _kelvin_with(rho: float, u: float, more: float, h: float, gas: GasTables) -> float:
    """Temperature [K] of a gas with `more` [kg/m3] of enthalpy `h` [J/kg] put to it, before any wall takes heat."""
    after = rho + more
    return gas_state(after, (rho * u + more * h) / after, gas)[1]


@uncounted
def filled_kelvin(place: int, p: float, kelvin: float, station: RealGasStation, period: float, gas: GasTables) -> float:
    """Temperature [K] of a bank at a pressure [Pa] and temperature [K] after a period of filling, without its wall."""
    unit = station.compressor
    rho, h = density_and_enthalpy(p, kelvin, gas)
    more = compressor_flow(p, unit) * period / bank_at(place, station).volume
    return _kelvin_with(rho, h - p / rho, more, enthalpy(p, unit.delivery, gas), gas)


@uncounted
def stored_energy(state: np.ndarray, place: int, tank: Tank) -> float:
    """Energy of the gas and the wall of a tank [J]."""
    total = state[place + ENERGY]
    for cell in range(tank.wall.capacity.shape[0]):
        total += tank.wall.capacity[cell] * state[place + CELLS + cell]
    return total


@uncounted
def _compress(state: np.ndarray, command: int, station: RealGasStation, period: float, gas: GasTables) -> float:
    """Let compressors fill the banks whose inlets are open; the mass [kg]. A compressor stands at each open inlet."""
    tail, unit, total = state[station.rest_at :], station.compressor, 0.0
    for place in range(BANKS):
        if command >> place & 1:
            at, bank = place * station.stride, bank_at(place, station)
            p, _, by_rho, by_u, _ = look_closely(state, at, bank, gas)
            mass = compressor_flow(p, unit) * period
            h = enthalpy(p, unit.delivery, gas)
            rho, u = state[at + MASS] / bank.volume, state[at + ENERGY] / state[at + MASS]
            rise = stiffness(rho, u, by_rho, by_u, h, bank.volume)
            mass = min(mass, (unit.pressure_max - p) / rise) if p < unit.pressure_max else 0.0
            h = enthalpy(p + 0.5 * mass * rise, unit.delivery, gas)
            work = compressor_work(p + 0.5 * mass * rise, unit)
            add(state, at, mass, mass * h)
            tail[SUPPLIED_ENERGY] += mass * unit.enthalpy
            tail[WORK] += mass * work
            tail[REJECTED] += mass * (unit.enthalpy + work - h)
            total += mass
    tail[COMPRESSED] += total
    return total


@uncounted
def has_notes(state: np.ndarray, station: RealGasStation) -> bool:
    """Whether a state has room for notes, see `layout.NOTES`."""
    return bool(state.shape[0] >= station.rest_at + TAIL + NOTES)


@uncounted
def look_and_note(state: np.ndarray, place: int, station: RealGasStation, gas: GasTables) -> tuple[float, float]:
    """Pressure [Pa] and temperature [K] of a bank; with what else the next second needs they are noted."""
    at, note = place * station.stride, station.rest_at + TAIL + place * NOTE
    p, kelvin, cv = look_warmly(state, at, bank_at(place, station), gas)
    state[note], state[note + 1] = state[at + MASS], state[at + ENERGY]
    state[note + 2], state[note + 3], state[note + 4] = p, kelvin, cv
    return p, kelvin


@uncounted
def _settle_banks(
    state: np.ndarray, command: int, inflow: float, station: RealGasStation, period: float, gas: GasTables
) -> None:
    """`settle` of every bank, of a state with notes: the same numbers, in steps that do not wait for one another.

    A processor takes the same step of three banks at once, where one bank after the other is a chain of divisions. What
    was noted of a bank holds while its gas is what it was then.
    """
    tail, first = state[station.rest_at :], station.rest_at + TAIL
    for place in range(BANKS):
        at, note = place * station.stride, first + place * NOTE
        if state[note] != state[at + MASS] or state[note + 1] != state[at + ENERGY]:
            look_and_note(state, place, station, gas)
    for place in range(BANKS):
        at, note = place * station.stride, first + place * NOTE
        stirred = inflow if command >> place & 1 else 0.0
        state[note + 5] = inner_transfer(
            state[note + 2], state[note + 3], state[at + SURFACE], stirred, bank_at(place, station), gas
        )  # fmt: skip
    for place in range(BANKS):
        at, note = place * station.stride, first + place * NOTE
        _, lost = give_heat(
            state, at, bank_at(place, station), state[note + 3], state[note + 4], state[note + 5], station.ambient,
            period,
        )  # fmt: skip
        tail[LOST] += lost


@uncounted
def advance_some(
    state: np.ndarray, vehicle: Tank, visit: Visit, command: int, station: RealGasStation, period: float,
    gas: GasTables, banks: int, filling: bool,
) -> tuple[float, float]:  # fmt: skip
    """Apply a command for a period to some of the tanks; mass given by the compressors and to the vehicle [kg].

    `banks`: as bits; `filling`: and the vehicle, with all that gives it gas, which is to be among the banks.
    """
    tail = state[station.rest_at :]
    dispensed, heat = 0.0, 0.0
    if filling:
        dispensed, heat = dispense(state, vehicle, visit, command, station, period, gas)
    inlets = command & banks
    compressed = _compress(state, inlets, station, period, gas)
    open_inlets = (inlets & 1) + (inlets >> 1 & 1) + (inlets >> 2 & 1)
    inflows = compressed / open_inlets / period if open_inlets else 0.0
    if has_notes(state, station) and banks == ALL_BANKS:
        _settle_banks(state, command, inflows, station, period, gas)
    else:
        for place in range(BANKS):
            if banks >> place & 1:
                stirred = inflows if command >> place & 1 else 0.0
                _, lost = settle(
                    state, place * station.stride, bank_at(place, station), stirred, station.ambient, period, gas
                )  # fmt: skip
                tail[LOST] += lost
    if filling:
        tail[HEAT], lost = settle(
            state, station.vehicle_at, vehicle, dispensed / period, station.ambient, period, gas
        )  # fmt: skip
        tail[LOST] += lost
    unit = station.precooler
    tail[BLOCK], leaked, taken = block_after(tail[BLOCK], heat, station.ambient, period, unit)
    tail[LEAKED] += leaked
    tail[REJECTED] += taken
    tail[ELECTRIC] += taken / unit.performance
    return compressed, dispensed


@uncounted
def advance(
    state: np.ndarray, vehicle: Tank, visit: Visit, command: int, station: RealGasStation, period: float,
    gas: GasTables,
) -> tuple[float, float]:  # fmt: skip
    """Apply a command for a period; mass given by the compressors and to the vehicle [kg]."""
    connected = state[station.rest_at + CONNECTED] > 0.0
    return advance_some(state, vehicle, visit, command, station, period, gas, ALL_BANKS, connected)


@uncounted
def lose(state: np.ndarray, place: int, mass: float, station: RealGasStation, gas: GasTables) -> None:
    """Let a mass [kg] leak out of a bank; it is counted as what is vented."""
    tail = state[station.rest_at :]
    gone = draw(state, place * station.stride, bank_at(place, station), mass, gas)
    tail[VENTED] += mass
    tail[VENTED_ENERGY] += gone


@uncounted
def total_mass(state: np.ndarray, station: RealGasStation) -> float:
    """Mass of the gas in banks, line and connected vehicle [kg]."""
    total = state[station.rest_at + LINE_MASS] + state[station.vehicle_at + MASS]
    for place in range(BANKS):
        total += state[place * station.stride + MASS]
    return total


@uncounted
def total_energy(state: np.ndarray, vehicle: Tank, station: RealGasStation) -> float:
    """Energy of gas, walls and the precooler's block, with that of a connected vehicle [J]."""
    tail = state[station.rest_at :]
    total = tail[LINE_ENERGY] + station.precooler.capacity * tail[BLOCK]
    for place in range(BANKS):
        total += stored_energy(state, place * station.stride, bank_at(place, station))
    if tail[CONNECTED] > 0.0:
        total += stored_energy(state, station.vehicle_at, vehicle)
    return float(total)


@uncounted
def accounts(state: np.ndarray, vehicle: Tank, station: RealGasStation) -> tuple[float, float]:
    """Mass [kg] and energy [J] less all that came and went since the start: always the same, but for rounding."""
    tail = state[station.rest_at :]
    came = tail[SUPPLIED_ENERGY] + tail[WORK] + tail[LEAKED] + tail[CAME_ENERGY]
    went = tail[REJECTED] + tail[LOST] + tail[WENT_ENERGY] + tail[VENTED_ENERGY]
    mass = total_mass(state, station) - (tail[COMPRESSED] + tail[CAME] - tail[WENT] - tail[VENTED])
    return mass, total_energy(state, vehicle, station) - (came - went)
