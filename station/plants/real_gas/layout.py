"""A real-gas station as kernels use it: its parameters, and where everything stands in its flat state."""

from __future__ import annotations

from typing import NamedTuple

from station.compiled import uncounted
from station.plants.real_gas.compressor import Compressor
from station.plants.real_gas.precooler import Precooler
from station.plants.real_gas.tank import CELLS, Tank

BANKS = 3

ALL_BANKS = 7
"""Every bank, as bits."""

(
    LINE_MASS, LINE_ENERGY, BLOCK, AIM, DELIVERY, CONNECTED, HEAT, COMPRESSED, WORK, ELECTRIC, REJECTED, LEAKED, LOST,
    VENTED, VENTED_ENERGY, CAME, CAME_ENERGY, WENT, WENT_ENERGY, SUPPLIED_ENERGY, BEFORE,
) = range(21)  # fmt: skip
"""Places in the state behind the tanks, from `RealGasStation.rest_at` on.

Mass and energy of the gas in the line, temperature of the precooler's block, pressure that the ramp aims at, that of
the gas at the nozzle, whether a vehicle is connected, heat its wall took in the last second; then the ledger since
the start [kg], [J]: compressed, compressors' work, precooler's electricity, heat rejected by aftercoolers and
refrigerator, heat leaked into the block, heat lost by tanks, vented, vehicles that came and went, gas supplied; at last
the temperature of the vehicle's gas a second ago [K].
"""

TAIL = 21

NOTE = 6
"""Entries a bank of a state with room for notes, behind all others: mass and energy [kg], [J] with which the gas was
last looked up, pressure [Pa], temperature [K] and cv [J/(kg K)] that were found, and what its inner surface passes on
[W/K]."""

NOTES = BANKS * NOTE
"""All of them. A state has room for notes where nobody reads its ledger: that of a future, which keeps no record."""


class Line(NamedTuple):
    """The dispenser's valves and its line to the nozzle."""

    area: float  # effective, of each outlet valve [m2]
    volume: float  # [m3]
    vent: float  # pressure it is vented to after a fill [Pa]
    flow_max: float  # of the nozzle [kg/s]


class RealGasStation(NamedTuple):
    """A station as kernels use it."""

    high: Tank
    medium: Tank
    low: Tank
    compressor: Compressor
    precooler: Precooler
    line: Line
    ambient: float  # [K]
    stride: int  # entries of a bank in the state
    vehicle_at: int  # where the vehicle's tank begins
    rest_at: int  # where the rest begins


class Visit(NamedTuple):
    """A vehicle's fill: how it comes, its ramp and what ends it."""

    pressure: float  # at the start [Pa]
    temperature: float  # of gas and wall at the start [K]
    ramp: float  # [Pa/s]
    mass: float  # that ends it [kg]; infinite for none
    pressure_max: float  # [Pa]
    temperature_max: float  # of the gas [K]


def station_of(
    banks: tuple[Tank, Tank, Tank], vehicle_cells: int, compressor: Compressor, precooler: Precooler, line: Line,
    ambient: float,
) -> RealGasStation:  # fmt: skip
    """A station whose banks have walls of as many cells, and vehicles' tanks walls of `vehicle_cells`.

    Raises
    ------
    ValueError
        if the walls of the banks have different numbers of cells.
    """
    cells = {len(bank.wall.capacity) for bank in banks}
    if len(cells) != 1:
        raise ValueError(f"the walls of the banks must have as many cells; given {sorted(cells)}")
    stride = CELLS + cells.pop()
    vehicle_at = BANKS * stride
    return RealGasStation(
        *banks, compressor, precooler, line, ambient, stride, vehicle_at, vehicle_at + CELLS + vehicle_cells
    )


@uncounted
def bank_at(place: int, station: RealGasStation) -> Tank:
    """A bank by its place: high, medium, low. Only uncounted kernels may call it: it gives arrays back uncounted."""
    if place == 0:
        return station.high
    return station.medium if place == 1 else station.low
