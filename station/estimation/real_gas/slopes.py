"""A second of the plant, and its slopes: the plant's own kernels, once for the mean and once for each coordinate.

Only the tanks that a coordinate reaches in a second are advanced for it. Differences are one-sided; their steps lie
far above rounding and far below what any sensor tells.
"""

from __future__ import annotations

import numpy as np

from station.compiled import uncounted
from station.estimation.real_gas.states import (
    AIR,
    BANK_ENERGY,
    BANK_WALL,
    BIASED,
    COMPRESSOR,
    DISPENSER,
    LEAKS,
    PACK,
    PACK_ENERGY,
    PLANT_STATES,
    RAMP_AIM,
    VEHICLE_ENERGY,
    VEHICLE_MASS,
    WARMER,
    Scratch,
    coordinate_of,
    move,
    tank_place,
)
from station.geometry import VEHICLE
from station.plants.real_gas import station as machines
from station.plants.real_gas.compressor import Compressor
from station.plants.real_gas.entries import INSIDE, KILO, RealGasConstants, connected_tank, connected_visit
from station.plants.real_gas.gas import state as gas_state
from station.plants.real_gas.gas import state_and_slopes
from station.plants.real_gas.layout import ALL_BANKS, BANKS, Line, RealGasStation, Visit
from station.plants.real_gas.precooler import Precooler
from station.plants.real_gas.tables import GasTables
from station.plants.real_gas.tank import ENERGY, MASS, Tank

P, T, P_MASS, P_ENERGY, T_MASS, T_ENERGY, ENTHALPY = range(7)
"""Of a tank's gas in `Scratch.gas`: pressure [Pa] and temperature [K], their slopes by mass and energy, enthalpy."""

_WARMTH = 0.02  # by which temperatures are varied, and energies by as much heat [K]
_SHARE = 1e-4  # and masses and factors
_PRESSURE = 1e3  # [Pa]
_AIR = 0.1  # [K]


@uncounted
def look_at(s: Scratch, tank: int, volume: float, station: RealGasStation, gas: GasTables) -> None:
    """Pressure and temperature of a tank's gas with their slopes, into `s.gas`."""
    at = INSIDE + tank_place(tank, station)
    mass = s.state[at + MASS]
    rho, u = mass / volume, s.state[at + ENERGY] / mass
    p, kelvin, by_rho, by_u, cv = state_and_slopes(rho, u, gas)
    step = _SHARE * rho
    warming = (gas_state(rho + step, u, gas)[1] - kelvin) / step
    s.gas[tank, P], s.gas[tank, T], s.gas[tank, ENTHALPY] = p, kelvin, u + p / rho
    s.gas[tank, P_MASS], s.gas[tank, P_ENERGY] = by_rho / volume - by_u * u / mass, by_u / mass
    s.gas[tank, T_MASS], s.gas[tank, T_ENERGY] = warming / volume - u / (mass * cv), 1.0 / (mass * cv)


@uncounted
def believed(station: RealGasStation, air: float, compressor: float, dispenser: float, warmer: float) -> RealGasStation:
    """The station in other air [K], with parts of its machines' gifts [1] and a warmer precooler [K]."""
    unit, line, cold = station.compressor, station.line, station.precooler
    return RealGasStation(
        station.high,
        station.medium,
        station.low,
        Compressor(
            unit.displacement * compressor, unit.density, unit.enthalpy, unit.pressure, unit.clearance, unit.stages,
            unit.efficiency, unit.pressure_max, unit.delivery + air, unit.work, unit.work_scale,
        ),
        Precooler(
            cold.capacity, cold.set_point, cold.effectiveness, cold.refrigeration, cold.performance, cold.leak,
            cold.warmer + warmer,
        ),
        Line(line.area * dispenser, line.volume, line.vent, line.flow_max),
        station.ambient + air,
        station.stride,
        station.vehicle_at,
        station.rest_at,
    )  # fmt: skip


@uncounted
def _reach(banks: int, filling: bool, command: int, connected: bool) -> tuple[int, bool]:
    """The tanks that are moved by a second in which some banks, or what fills the vehicle, differ."""
    inlets, outlets = command & ALL_BANKS, command >> BANKS if connected else 0
    for _ in range(2):
        filling = filling or banks & outlets != 0
        if filling:
            banks |= outlets
        if banks & inlets:
            banks |= inlets
    return banks, filling


@uncounted
def _varied(coordinate: int, command: int, connected: bool) -> tuple[int, bool]:
    """Which banks, and whether the filling, a coordinate moves in a second."""
    if coordinate < VEHICLE_MASS:
        return _reach(1 << coordinate % BANKS, False, command, connected)
    if coordinate < AIR:
        return _reach(0, True, command, connected)
    if coordinate == AIR:
        return ALL_BANKS, connected
    if coordinate == COMPRESSOR:
        return _reach(command & ALL_BANKS, False, command, connected)
    if coordinate in (DISPENSER, WARMER):
        return _reach(0, connected and command >> BANKS != 0, command, connected)
    return 0, False


@uncounted
def _step(s: Scratch, coordinate: int) -> float:
    """By how much a coordinate is varied."""
    if coordinate < BANK_ENERGY:
        return _SHARE * s.gas[coordinate, P] / s.gas[coordinate, P_MASS]
    if coordinate < BANK_WALL:
        return _WARMTH / s.gas[coordinate - BANK_ENERGY, T_ENERGY]
    if coordinate == VEHICLE_MASS:
        return _SHARE * s.gas[VEHICLE, P] / s.gas[VEHICLE, P_MASS]
    if coordinate == VEHICLE_ENERGY:
        return _WARMTH / s.gas[VEHICLE, T_ENERGY]
    if coordinate in (PACK, PACK_ENERGY):
        return 1e-6 if coordinate == PACK else 1.0
    if coordinate == RAMP_AIM:
        return _PRESSURE
    if coordinate == AIR:
        return _AIR
    if coordinate in (COMPRESSOR, DISPENSER):
        return _SHARE
    return _WARMTH


@uncounted
def _differences(
    s: Scratch, coordinate: int, step: float, banks: int, filling: bool, vehicle: Tank, station: RealGasStation
) -> None:
    """The slopes of the tanks that a coordinate reached, from `s.varied` against `s.following`."""
    for row in range(AIR):
        moved = filling if row >= VEHICLE_MASS else banks >> row % BANKS & 1 != 0
        if moved:
            varied = coordinate_of(s.varied, row, vehicle, station)
            s.transition[row, coordinate] = (varied - coordinate_of(s.following, row, vehicle, station)) / step


@uncounted
def copy(source: np.ndarray, target: np.ndarray) -> None:
    """Copy a state of the plant."""
    for entry in range(source.shape[0]):
        target[entry] = source[entry]


@uncounted
def _lose(s: Scratch, size: int, station: RealGasStation) -> None:
    """Take what leaks from the banks a second on."""
    for bank in range(BANKS):
        lost = s.health[LEAKS + bank] / KILO
        at = bank * station.stride
        s.following[at + MASS] -= lost
        s.following[at + ENERGY] -= lost * s.gas[bank, ENTHALPY]
        if size > PLANT_STATES:
            s.transition[bank, LEAKS + bank] = -1.0 / KILO
            s.transition[BANK_ENERGY + bank, LEAKS + bank] = -s.gas[bank, ENTHALPY] / KILO


@uncounted
def second_on(s: Scratch, size: int, command: int, connected: bool, plant: RealGasConstants) -> None:
    """The plant's own state a second on in `s.following`, what flows in `s.flow`, and the slopes of both.

    Gas of the tanks must have been looked at.
    """
    inside, gas = s.state[INSIDE:], plant.gas
    vehicle, told = connected_tank(s.state), connected_visit(s.state)
    visit = Visit(told.pressure, told.temperature, told.ramp, np.inf, told.pressure_max, np.inf)
    air, compressor, dispenser, warmer = (
        s.health[AIR], s.health[COMPRESSOR], s.health[DISPENSER], s.health[WARMER],
    )  # fmt: skip
    station = believed(plant.station, air, compressor, dispenser, warmer)
    copy(inside, s.following)
    compressed, dispensed = machines.advance_some(
        s.following, vehicle, visit, command, station, 1.0, gas, ALL_BANKS, connected
    )  # fmt: skip
    s.flow[0], s.flow[1] = compressed * KILO, dispensed * KILO
    s.transition[:, :], s.flow_slopes[:, :] = 0.0, 0.0
    for coordinate in range(size):
        if coordinate >= AIR:
            s.transition[coordinate, coordinate] = 1.0
        if coordinate >= VEHICLE_MASS and coordinate < AIR and not connected:
            continue
        banks, filling = _varied(coordinate, command, connected)
        if banks == 0 and not filling:
            continue
        step = _step(s, coordinate)
        copy(inside, s.varied)
        move(s.varied, coordinate, step, vehicle, station)
        other = station
        if coordinate >= AIR:
            other = believed(
                plant.station,
                air + (step if coordinate == AIR else 0.0),
                compressor + (step if coordinate == COMPRESSOR else 0.0),
                dispenser + (step if coordinate == DISPENSER else 0.0),
                warmer + (step if coordinate == WARMER else 0.0),
            )
        given, passed = machines.advance_some(
            s.varied, vehicle, visit, command, other, 1.0, gas, banks, filling
        )  # fmt: skip
        _differences(s, coordinate, step, banks, filling, vehicle, station)
        if banks & command:
            s.flow_slopes[0, coordinate] = (given - compressed) * KILO / step
        if filling:
            s.flow_slopes[1, coordinate] = (passed - dispensed) * KILO / step
    if size != BIASED:
        _lose(s, size, station)
