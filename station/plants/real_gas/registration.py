"""The faithful plant as `station.plants` registers it: its constants of a station, and its functions."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from station.compiled import kernel
from station.errors import InputError
from station.geometry import KELVIN
from station.limit_figures import limit_figures
from station.plants.interface import REFERENCE_TEMPERATURE, Plant
from station.plants.real_gas import plant as kernels
from station.plants.real_gas.catalog import DISPENSING, TEMPERATURE_LIMIT, TankClass, tank_class
from station.plants.real_gas.compressor import Compressor, compressor_flow, compressor_work
from station.plants.real_gas.entries import (
    FIGURES,
    KWH,
    LEVELS,
    OWN_ENTRIES,
    RATES,
    VEHICLE_CELLS,
    RealGasConstants,
)
from station.plants.real_gas.fill import PERIOD
from station.plants.real_gas.hydrogen import BAR
from station.plants.real_gas.layout import NOTES, Line, RealGasStation, station_of
from station.plants.real_gas.leachman import Array, density, pressure
from station.plants.real_gas.machines import bank_of, compressor_with, line_with, precooler_with
from station.plants.real_gas.precooler import Precooler
from station.plants.real_gas.ramp_table import NOMINAL_BAR, RampTable, full_pressure, known_of, ramp_table
from station.plants.real_gas.tables import GasTables, gas_tables
from station.plants.real_gas.tank import Tank
from station.plants.real_gas.wall import Wall
from station.plants.sample import sample_of

if TYPE_CHECKING:
    from station.plants.real_gas.options import RealGasOptions

_STEPS = 65
_CURVE = 257
"""Masses at which the compressor's flow and work are looked up on the way of a bank to a larger mass."""

_PARTING = 50e6
"""Up to this nominal working pressure a tank is of the class of 35 MPa [Pa]."""


def _station_of(station: Any, given: RealGasOptions) -> RealGasStation:
    """The machines of a station [SI]."""
    ambient = station.thermal.ambient_temperature_c + KELVIN
    high, medium, low = (bank_of(buffer.volume_m3, PERIOD) for buffer in station.buffers.all)
    return station_of(
        (high, medium, low), VEHICLE_CELLS, compressor_with(given.compressor, ambient), precooler_with(given.precooler),
        line_with(given.dispensing), ambient,
    )  # fmt: skip


def _temperatures(station: Any) -> tuple[float, float]:
    """Of the ambient air, and of the gas in a tank that comes, usually [K]."""
    return station.thermal.ambient_temperature_c + KELVIN, station.vehicle.start_temperature_c + KELVIN


def _ramps(station: Any, kind: str, nominal: float, *, communication: bool) -> RampTable:
    """The ramps of a class of tanks at a nominal working pressure [Pa]."""
    given: RealGasOptions = station.real_gas
    ambient, start = _temperatures(station)
    known = known_of(kind, given.dispensing, given.precooler, nominal, ambient, start)
    return ramp_table(given.dispensing, known, communication=communication)


def constants_of(station: Any, *, communication: bool) -> RealGasConstants:
    """The constants of a `station.parameters.Station` with a section `real_gas`; see `Plant.constants_of`.

    Raises
    ------
    InputError
        if it has none.
    """
    given: RealGasOptions | None = station.real_gas
    if given is None:
        raise InputError("station", [("real_gas", "the plant 'real-gas' needs this section")])
    ways, top, least = given.dispensing, given.bank_pressure_max_bar, given.bank_pressure_min_bar
    lighter, stronger = (bar * BAR for bar in NOMINAL_BAR)
    ambient, start = _temperatures(station)
    return RealGasConstants(
        compressor_pressure=given.compressor.pressure_max_bar,
        outlet_coefficient=station.dispenser.outlet_coefficient_g_per_s_bar,
        limits=limit_figures(station)._replace(
            vehicle_temperature_max=TEMPERATURE_LIMIT - KELVIN, dispenser_flow_max=math.inf, hold_pressure=math.inf
        ),
        compressor_count=station.compressor.count,
        bank_pressure_max=(top.high, top.medium, top.low),
        bank_pressure_min=(least.high, least.medium, least.low),
        minimum_on=given.minimum_on_s,
        minimum_off=given.minimum_off_s,
        target=ways.target_percent / 100,
        pressure_factor=float(DISPENSING["limits"]["pressure_factor"]),
        reports=communication,
        full_pressure=(full_pressure(lighter, ambient, start), full_pressure(stronger, ambient, start)),
        lighter_ramps=_ramps(station, ways.tank_35, lighter, communication=communication),
        stronger_ramps=_ramps(station, ways.tank_70, stronger, communication=communication),
        parting=_PARTING,
        tank_max=ways.tank_max_l * 1e-3,
        lighter=tank_class(ways.tank_35),
        stronger=tank_class(ways.tank_70),
        station=_station_of(station, given),
        gas=gas_tables(),
    )


def held(pressure: Any, temperature: Any, volume: Any) -> Any:
    """Mass [g] at a pressure [bar] and temperature [deg C] in a volume [m3]; numbers or arrays."""
    pascal, kelvin = np.asarray(pressure, float) * BAR, np.asarray(temperature, float) + KELVIN
    found = density(pascal, np.broadcast_to(kelvin, pascal.shape)) * volume * 1e3
    return float(found) if found.ndim == 0 else found


def _way(buffer: int, mass: Any, target: float, plant: RealGasConstants) -> tuple[Array, Array]:
    """Masses [kg] from some to a larger one [g] of a bank, and its pressures on that way [Pa].

    At REFERENCE_TEMPERATURE, or that of the air where this is colder: a bank that was full in the cold could not take
    as much when warm. The last axis goes along the way.
    """
    bank = (plant.station.high, plant.station.medium, plant.station.low)[buffer]
    masses = np.linspace(mass, target, _STEPS, axis=-1) * 1e-3
    return masses, pressure(masses / bank.volume, min(REFERENCE_TEMPERATURE + KELVIN, plant.station.ambient))


@kernel
def _flows(pressures: Array, unit: Compressor) -> Array:
    """Flows [kg/s] against pressures [Pa]."""
    return np.array([compressor_flow(p, unit) for p in pressures])


@kernel
def _works(pressures: Array, unit: Compressor) -> Array:
    """Electric work [J/kg] against pressures [Pa]."""
    return np.array([compressor_work(p, unit) for p in pressures])


def compressor_curve(plant: RealGasConstants) -> tuple[Array, Array, Array]:
    """Pressures [bar] from the suction's to where the compressor stops, its flow [g/s] and electric power [kW]."""
    unit = plant.station.compressor
    pressures = np.linspace(unit.pressure, np.nextafter(unit.pressure_max, 0.0), _CURVE)
    flows = _flows(pressures, unit)
    return pressures / BAR, flows * 1e3, flows * _works(pressures, unit) * 1e-3


def _restoring_time(buffer: int, mass: Any, target: float, plant: RealGasConstants) -> Any:
    """Seconds in which the compressor brings a bank from a mass to a larger one [g]; see `_way`.

    Infinite where it stops before; `mass` is a number or an array.
    """
    masses, pressures = _way(buffer, mass, target, plant)
    flows = _flows(pressures.ravel(), plant.station.compressor).reshape(pressures.shape)
    with np.errstate(divide="ignore", invalid="ignore"):
        seconds = np.trapezoid(1.0 / flows, masses)
    return np.where(flows.min(axis=-1) > 0.0, seconds, math.inf)[()]


def _restoring_energy(buffer: int, mass: Any, target: float, plant: RealGasConstants) -> Any:
    """Electric energy that this takes [kWh]; infinite where the compressor stops before."""
    masses, pressures = _way(buffer, mass, target, plant)
    work = _works(pressures.ravel(), plant.station.compressor).reshape(pressures.shape)
    reached = pressures[..., -1] < plant.station.compressor.pressure_max
    return np.where(reached, np.trapezoid(work, masses) / KWH, math.inf)[()]


def _sample() -> RealGasConstants:
    """Constants of the types that kernels are compiled for."""
    row, kind = np.zeros(1), TankClass(*(1.0,) * 4, np.zeros((1, 5)))
    tank = Tank(*(1.0,) * 4, Wall(row, row, row, row, row, *(1.0,) * 3))
    unit = Compressor(*(1.0,) * 5, 1, *(1.0,) * 3, row, 1.0)
    machines = RealGasStation(tank, tank, tank, unit, Precooler(*(1.0,) * 7), Line(*(1.0,) * 4), 1.0, 1, 1, 1)
    grid = np.zeros((1, 1, 1))
    gas = GasTables(grid, *(1.0,) * 3, grid, *(1.0,) * 4)
    ramps = RampTable(row, row, np.zeros((1, 1)))
    return sample_of(
        RealGasConstants, lighter_ramps=ramps, stronger_ramps=ramps, lighter=kind, stronger=kind, station=machines,
        gas=gas,
    )  # fmt: skip


REAL_GAS = Plant(
    name="real-gas",
    constants=RealGasConstants,
    constants_of=constants_of,
    sample=_sample(),
    own=OWN_ENTRIES,
    notes=NOTES,
    rates=RATES,
    levels=LEVELS,
    figures=FIGURES,
    begin=kernels.begin,
    advance=kernels.advance,
    rest=kernels.rest,
    fill_end=kernels.fill_end,
    leaves_at=kernels.leaves_at,
    leave=kernels.leave,
    lose=kernels.lose,
    seep=kernels.seep,
    own_columns=kernels.own_columns,
    reads_nozzle=kernels.reads_nozzle,
    metered=kernels.metered,
    outlet_flow=kernels.outlet_flow,
    filled_to=kernels.filled_to,
    emptied_to=kernels.emptied_to,
    timed_valves=kernels.timed_valves,
    warmed=kernels.warmed,
    vehicle_temperature=kernels.vehicle_temperature,
    held=held,
    stiffness=lambda _temperature, _volume: 0.0,  # its steps are implicit
    restoring_time=_restoring_time,
    ailing=kernels.ailing,
    precools=True,
    restoring_energy=_restoring_energy,
)
"""Hydrogen as a real gas, in tanks with walls."""
