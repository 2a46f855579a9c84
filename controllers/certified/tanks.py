"""The tanks of a station as switched systems, with bounds of what is not known of them over a stated box.

Each tank is a system whose mode is what the valve command does to it: x+ = A x + b + E w, where x is its mass in units
of the error of the mass that readings tell. A flow is linear in the mass at a given temperature; what a temperature off
the middle of the box changes is taken from the readings, and its error, the parameters' error and the neighbour's
reading are bounded over the box and added to w. docs/certified.md derives it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import sqrt
from typing import NamedTuple

import numpy as np

from station.geometry import KELVIN, OUTLETS, VEHICLE
from station.parameters import Station
from station.plants.thesis import SPECIFIC_GAS, PlantConstants, gas_pressure
from station.uncertainty import Uncertainty
from station.valves import commands
from theory import SwitchedSystem
from theory.switching.language import DwellTime
from theory.switching.observer import Observer, design

ABOVE = 20.0
"""How far above the compressor's pressure a full buffer may get by warming, in the default box [bar]."""

COLDER, COOLING = 20.0, 400.0
"""How far below ambient a tank may cool, in the default box [K], or what so many seconds [s] of dispensing do."""

WARMER = 5.0
"""How far above its limit a tank's temperature may be read, in the default box [K]."""

ROUNDING = 1e-6
"""Relative slack of every bound, for the decimals of the matrices and the rounding of the observer's own arithmetic."""

FOREIGN = 64
"""Bit that stands for the outlet of a buffer outside a group of tanks."""

SMOOTH = (0.95, 0.6)
"""Contractions for a closed tank and for one with a valve open: readings of many seconds are weighed together."""

Range = tuple[float, float]


class Box(NamedTuple):
    """Pressures [bar] and temperatures [deg C] between which a claim holds. An estimator refuses readings outside."""

    pressure: tuple[Range, Range, Range, Range]
    temperature: tuple[Range, Range, Range, Range]

    @classmethod
    def of(cls, station: Station) -> Box:
        """The default box: a buffer that dispenses is above the outlet gap, one that is filled below p_com."""
        top, gap = station.compressor.pressure_bar, station.dispenser.outlet_gap_min_bar
        ambient = station.thermal.ambient_temperature_c
        colder = [max(COLDER, COOLING * buffer.outlet_cooling_k_per_s) for buffer in station.buffers.all]
        warm = station.thermal.buffer_temperature_max_c + WARMER
        hot = station.vehicle.temperature_max_c + WARMER
        high, medium, low = ((ambient - by, warm) for by in colder)
        return cls((*((gap, top + ABOVE),) * 3, (0.0, top)), (high, medium, low, (ambient - COLDER, hot)))


@dataclass(frozen=True)
class Group:
    """Tanks observed together: their switched system in units of the readings' errors."""

    tanks: tuple[int, ...]
    modes: tuple[int, ...]  # what a command does to the group, as `behaviour` tells it; mode i is the i-th, from 1
    unit: tuple[float, ...]  # error of a mass as the readings tell it [g], one a tank
    process: tuple[tuple[float, ...], ...]  # bound of what is not known of the flows in each mode [units/s]
    system: SwitchedSystem
    first: tuple[tuple[float, ...], ...]

    def behaviour(self, command: int) -> int:
        """Effect of a command on the tanks: its bits without those that do not reach them."""
        return _behaviour(self.tanks, command)

    def mode(self, command: int) -> int:
        """The mode of a command, from 1."""
        return self.modes.index(self.behaviour(command)) + 1

    def observer(self, hold: int = 1, *, smooth: bool = True) -> Observer:
        """Gains and certificate for commands that stay at least `hold` seconds.

        Not `smooth`: the smallest certified set, which follows the newest reading.
        """
        alpha = [SMOOTH[mode != 0] for mode in self.modes] if smooth else None
        language = DwellTime(hold, modes=len(self.modes))
        return design(self.system, language, self.first, alpha=alpha, clock=hold - 1)


def _behaviour(tanks: Sequence[int], command: int) -> int:
    own = sum(9 << buffer for buffer in tanks if buffer != VEHICLE)
    if VEHICLE in tanks and command & OUTLETS & ~own:
        return command & own | FOREIGN
    return command & own


class _Bounds:
    """Bounds over the box of what the flows of one tank depend on."""

    def __init__(self, plant: PlantConstants, uncertainty: Uncertainty, volume: Sequence[float], box: Box) -> None:
        self.plant, self.known, self.volume, self.box = plant, uncertainty, volume, box

    def kelvin(self, tank: int) -> tuple[float, float, float]:
        """Lowest, middle and highest absolute temperature of the box [K]."""
        low, high = (end + KELVIN for end in self.box.temperature[tank])
        return low, (low + high) / 2, high

    def mass_error(self, tank: int) -> float:
        """|mass that readings give - mass| [g]: (V / R) (error + p error_T / T) / (T - error_T) at most."""
        low, warm = self.kelvin(tank)[0], self.known.temperature_k
        pressure = self.known.pressure_bar + self.box.pressure[tank][1] * warm / low
        return self.volume[tank] / SPECIFIC_GAS * pressure / (low - warm)

    def slope(self, tank: int) -> float:
        """Pressure of a gram at the middle of the box [bar/g]."""
        return float(gas_pressure(1.0, self.kelvin(tank)[1] - KELVIN, self.volume[tank]))

    def rest_error(self, tank: int) -> float:
        """Error of p (1 - T_middle / T), which readings tell, of the pressure a mass has beside its slope's [bar]."""
        low, middle, high = self.kelvin(tank)
        warm = self.known.temperature_k
        away = max(middle / (low - warm) - 1.0, 1.0 - middle / (high + warm))
        return self.known.pressure_bar * away + self.box.pressure[tank][1] * middle * warm / (low * (low - warm))

    def inlet(self, tank: int) -> float:
        """What is not known of the flow into a buffer [g/s]."""
        width, error, plant = self.known.parameters, self.known.pressure_bar, self.plant
        most = plant.compressor_pressure + error - self.box.pressure[tank][0]
        return plant.inlet_coefficient * (error + self.rest_error(tank) + width * most)

    def outlet(self, buffer: int, group: Sequence[int]) -> float:
        """What is not known of the flow from a buffer to the vehicle, either of them in the group [g/s]."""
        width, plant = self.known.parameters, self.plant
        ends = sum(self.rest_error(tank) if tank in group else self.known.pressure_bar for tank in (buffer, VEHICLE))
        gap = self.box.pressure[buffer][1] - self.box.pressure[VEHICLE][0]
        # Eq. (7.11) bounds the true flow, and with it the share of it that the parameter's error is.
        share = min(width * plant.outlet_coefficient * gap, plant.limits.dispenser_flow_max * width / (1.0 - width))
        return plant.outlet_coefficient * ends + share


@lru_cache(maxsize=256)
def group_of(
    plant: PlantConstants, uncertainty: Uncertainty, tanks: tuple[int, ...], box: Box, vehicle_volume: float
) -> Group:
    """The switched system of a group of tanks (0 high, 1 medium, 2 low, 3 vehicle), `vehicle_volume` in m3."""
    bounds = _Bounds(plant, uncertainty, (*plant.buffer_volume, vehicle_volume), box)
    units = [bounds.mass_error(tank) for tank in tanks]
    modes = tuple(sorted({_behaviour(tanks, command) for command in commands(plant.compressor_count)}))
    loops, process = [], []
    for mode in modes:
        loop, unknown = _mode(mode, tanks, bounds)
        loops.append([[item * units[j] / units[i] for j, item in enumerate(row)] for i, row in enumerate(loop)])
        process.append(tuple(item / unit for item, unit in zip(unknown, units, strict=True)))
    count, most = len(tanks), max(max(row) for row in process)
    # The box of 2 x count errors lies in an ellipsoid: `share` of it for the flows, the rest for the sensors.
    share = most / (1.0 + most)
    wide, seen = sqrt(count / share) * (1 + ROUNDING), sqrt(count / (1.0 - share)) * (1 + ROUNDING)
    none = [0.0] * count

    def diagonal(values: Sequence[float]) -> list[list[float]]:
        return [[value if i == j else 0.0 for j in range(count)] for i, value in enumerate(values)]

    drives = [[[*row, *none] for row in diagonal([wide * item + ROUNDING for item in each])] for each in process]
    outputs = [[*none, *row] for row in diagonal([seen] * count)]
    system = SwitchedSystem(
        A=_decimals(loops), C=[diagonal([1.0] * count)] * len(modes), E=_decimals(drives),
        F=_decimals([outputs] * len(modes)),
    )  # fmt: skip
    first = tuple(
        tuple(map(float, [*none, *row])) for row in diagonal([round(sqrt(count) * (1 + ROUNDING), 9)] * count)
    )
    return Group(tanks, modes, tuple(units), tuple(process), system, first)


def _mode(mode: int, tanks: Sequence[int], bounds: _Bounds) -> tuple[list[list[float]], list[float]]:
    """The matrix of a mode in grams, and what is not known of each tank's flows [g/s]."""
    plant = bounds.plant
    loop, unknown = np.eye(len(tanks)), np.zeros(len(tanks))
    place = {tank: i for i, tank in enumerate(tanks)}
    for buffer in range(3):
        if mode & (1 << buffer):
            loop[place[buffer], place[buffer]] -= plant.inlet_coefficient * bounds.slope(buffer)
            unknown[place[buffer]] += bounds.inlet(buffer)
    sources = [buffer for buffer in range(3) if mode & (8 << buffer)]
    if mode & FOREIGN:
        sources = [buffer for buffer in range(3) if buffer not in tanks]
        unknown[place[VEHICLE]] += max(bounds.outlet(buffer, tanks) for buffer in sources)
        loop[place[VEHICLE], place[VEHICLE]] -= plant.outlet_coefficient * bounds.slope(VEHICLE)
        return loop.tolist(), unknown.tolist()
    for buffer in sources:
        for tank in set(tanks) & {buffer, VEHICLE}:
            sign = 1.0 if tank == VEHICLE else -1.0
            unknown[place[tank]] += bounds.outlet(buffer, tanks)
            for other in set(tanks) & {buffer, VEHICLE}:
                pull = plant.outlet_coefficient * bounds.slope(other)
                loop[place[tank], place[other]] += sign * (pull if other == buffer else -pull)
    return loop.tolist(), unknown.tolist()


def _decimals(matrices: Sequence[Sequence[Sequence[float]]]) -> list[list[list[float]]]:
    """Entries with twelve decimals: what is certified is what is written down."""
    return [[[round(float(item), 12) for item in row] for row in rows] for rows in matrices]
