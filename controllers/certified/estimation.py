"""Masses from noisy readings with a certified error: the station as a switched system, and its observers.

Each tank is a system whose mode is what the valve command does to it: x+ = A x + b + E w, where x is its mass in units
of what a reading tells it to. A flow is linear in the mass at a given temperature; what the temperature's deviation from
the middle of a stated box changes is taken from the readings, and its error, the parameters' error and the neighbour's
reading are bounded over the box and added to w. See docs/certified.md for the derivation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import isnan, nan, sqrt
from typing import NamedTuple

import numpy as np

from controllers.certified.prediction import Known, Tanks, step
from station.controller import Observation
from station.errors import StationError
from station.limits import INLETS, OUTLETS, commands
from station.margins import KnownStation
from station.parameters import Station
from station.plant import BUFFERS, KELVIN, SPECIFIC_GAS, VEHICLE, PlantConstants, gas_mass, gas_pressure
from station.tube import Ends, ends_at, pressure_ends
from station.uncertainty import Uncertainty
from theory import SwitchedSystem
from theory.language import DwellTime
from theory.observer import Observer, design

TANKS = (*BUFFERS, "vehicle")

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
        """What a command does to the tanks: its bits without those that do not reach them."""
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
        """|mass told by readings - mass| [g]: (V / R) (error + p error_T / T) / (T - error_T) at most."""
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
        share = min(width * plant.outlet_coefficient * gap, plant.dispenser_flow_max * width / (1.0 - width))
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


class Estimate(NamedTuple):
    """The tanks at a second; high, medium, low, vehicle. NaN where no vehicle is connected or none reports."""

    mass: tuple[float, ...]  # of the observers [g]
    half_width: tuple[float, ...]  # certified before the run: the mass is never further off [g]
    low: tuple[float, ...]  # what this run's readings leave [g]
    high: tuple[float, ...]  # [g]
    tanks: Tanks  # the same as intervals of density and temperature, for `predict`

    @property
    def pressure(self) -> tuple[Range, ...]:
        """Between what each pressure lies [bar]."""
        return tuple((nan, nan) if ends is None else pressure_ends(ends) for ends in self.tanks)


class Estimator:
    """Masses of a station second by second, each with a certified half-width and an interval.

    Two answers stand side by side. The observers' `mass` is within `half_width` whatever comes, which their certificate
    proves before the run. The interval from `low` to `high` is what the readings of this run leave: the interval a
    second before, carried on, cut with what the new readings admit and with the observers' set.

    Parameters
    ----------
    station : as a disturbed scenario tells it (`Scenario.told`), or the nominal one with an `uncertainty`
    hold : seconds every tank's mode is known to last; where a mode ends sooner, its tank begins anew from its reading,
        as it does every second of dispensing to a vehicle that reports nothing
    smooth : gains that weigh many readings together, or (not) the smallest certified set
    box : where the claim holds
    """

    def __init__(
        self, station: Station, uncertainty: Uncertainty | None = None, *, hold: int = 1, smooth: bool = True,
        box: Box | None = None,
    ) -> None:  # fmt: skip
        if isinstance(station, KnownStation):
            uncertainty, station = uncertainty or station.uncertainty, station.nominal
        self.station = station
        self.uncertainty = uncertainty or Uncertainty()
        self.plant = station.constants()
        self.box = box or Box.of(station)
        self.hold, self.smooth = hold, smooth
        self._last: Observation | None = None
        self._tanks: Tanks | None = None
        self._mass = [nan] * 4
        self._run = [(0, 0)] * 4  # behaviour and samples in it

    def group(self, tank: int, vehicle_volume: float) -> Group:
        """The system of one tank."""
        return group_of(self.plant, self.uncertainty, (tank,), self.box, vehicle_volume)

    def observer(self, tank: int, vehicle_volume: float) -> Observer:
        """The certified observer of one tank."""
        return _made(self.plant, self.uncertainty, tank, self.box, vehicle_volume, self.hold, self.smooth)

    def known(self, seen: Observation) -> Known:
        """What `predict` needs beside the tanks."""
        return Known(self.plant, self.uncertainty, seen.vehicle_volume, seen.communication)

    def update(self, seen: Observation) -> Estimate:
        """The estimate at the second that begins with `seen`; to be asked every second.

        Raises
        ------
        StationError
            naming the reading that leaves the box, or readings that no tank within the uncertainty could give.
        """
        last = self._last if self._last is not None and seen.time == self._last.time + seen.period else None
        same = last is not None and last.vehicle == seen.vehicle
        connected = seen.vehicle >= 0
        moved = step(self._tanks, seen.previous, self.known(last)) if last and self._tanks else (None,) * 4
        tanks: list[Ends | None] = []
        half_width = [nan] * 4
        for tank in range(4):
            going = last if tank != VEHICLE or same else None
            reports = tank != VEHICLE or (connected and (seen.communication or going is None))
            self._check(tank, seen, reports=reports)
            if tank == VEHICLE and not connected:
                self._mass[tank] = nan
                tanks.append(None)
                continue
            before = moved[tank] if going is not None else None
            ends = before
            if reports:
                pressure, temperature = _reading(seen, tank)
                error, warm = self.uncertainty.pressure_bar, self.uncertainty.temperature_k
                ends = _cut(before, Ends(*ends_at(pressure, temperature, error, warm)), tank, seen)
            if tank != VEHICLE or seen.communication:
                half_width[tank] = self._observe(tank, going, seen)
                volume = self._volume(tank, seen)
                low, high = self._mass[tank] - half_width[tank], self._mass[tank] + half_width[tank]
                ends = _cut(ends, Ends(low / volume, high / volume, -KELVIN, np.inf), tank, seen)
            else:
                self._mass[tank] = nan
            tanks.append(ends)
        self._last, self._tanks = seen, (tanks[0], tanks[1], tanks[2], tanks[3])  # type: ignore[assignment]
        low, high = zip(*(self._masses(tank, ends, seen) for tank, ends in enumerate(tanks)), strict=True)
        return Estimate(tuple(self._mass), tuple(half_width), low, high, self._tanks)

    def _masses(self, tank: int, ends: Ends | None, seen: Observation) -> Range:
        """Between what the mass of a tank lies [g]; the volume of a vehicle that reports nothing is not known."""
        if ends is None:
            return nan, nan
        volume = self._volume(tank, seen)
        width = 0.0 if tank != VEHICLE or seen.communication else self.uncertainty.parameters
        return ends.low * volume * (1.0 - width), ends.high * volume * (1.0 + width)

    def _volume(self, tank: int, seen: Observation) -> float:
        return seen.vehicle_volume if tank == VEHICLE else self.plant.buffer_volume[tank]

    def _observe(self, tank: int, last: Observation | None, seen: Observation) -> float:
        """Carry a tank's observer a second on, or begin it from the reading; its certified half-width [g]."""
        group, observer = self.group(tank, seen.vehicle_volume), self.observer(tank, seen.vehicle_volume)
        half_width = float(observer.half_widths[0]) * group.unit[0]
        now = group.behaviour(seen.previous)
        mode, run = self._run[tank]
        unseen = not seen.communication and now & OUTLETS != 0  # nobody reads the vehicle's pressure
        if last is None or unseen or isnan(self._mass[tank]) or (run and mode != now and run < self.hold):
            self._mass[tank], self._run[tank] = self._told(tank, seen), (now, 0)
            return half_width
        run = run if mode == now else 0
        gain = observer.gain(group.modes.index(now) + 1, run)[0, 0]
        told = self._told(tank, last)
        self._mass[tank] += seen.period * self._flow(tank, seen.previous, last) + gain * (told - self._mass[tank])
        self._run[tank] = now, run + 1
        return half_width

    def _told(self, tank: int, seen: Observation) -> float:
        """The mass that the readings tell [g]."""
        pressure, temperature = _reading(seen, tank)
        return float(gas_mass(pressure, temperature, self._volume(tank, seen)))

    def _flow(self, tank: int, command: int, seen: Observation) -> float:
        """Flow into a tank as far as it is known [g/s], Eqs (7.1) and (7.6)."""
        low, high = (end + KELVIN for end in self.box.temperature[tank])
        pressure, temperature = _reading(seen, tank)
        middle = (low + high) / 2
        slope = gas_pressure(1.0, middle - KELVIN, self._volume(tank, seen))
        own = slope * self._mass[tank] + pressure * (1.0 - middle / (temperature + KELVIN))
        if tank != VEHICLE and command & INLETS & (1 << tank):
            return self.plant.inlet_coefficient * (self.plant.compressor_pressure - own)
        for buffer in range(3):
            if command & OUTLETS & (8 << buffer) and tank in {buffer, VEHICLE}:
                other = _reading(seen, VEHICLE if tank == buffer else buffer)[0]
                return self.plant.outlet_coefficient * (other - own)
        return 0.0

    def _check(self, tank: int, seen: Observation, *, reports: bool) -> None:
        if not reports:
            return
        errors = self.uncertainty.pressure_bar, self.uncertainty.temperature_k
        boxes = self.box.pressure[tank], self.box.temperature[tank]
        for what, value, error, (low, high) in zip(
            ("pressure", "temperature"), _reading(seen, tank), errors, boxes, strict=True
        ):
            if not low <= value - error <= value + error <= high:
                raise StationError(
                    f"estimator, {TANKS[tank]}: {what} at {seen.time:g} s must stay {error:g} within {low:g} to {high:g}, "
                    f"the box of the certificate; read {value:g}"
                )


@lru_cache(maxsize=256)
def _made(
    plant: PlantConstants, uncertainty: Uncertainty, tank: int, box: Box, volume: float, hold: int, smooth: bool
) -> Observer:
    return group_of(plant, uncertainty, (tank,), box, volume).observer(hold, smooth=smooth)


def _reading(seen: Observation, tank: int) -> tuple[float, float]:
    if tank == VEHICLE:
        return seen.vehicle_pressure, seen.vehicle_temperature
    return seen.pressure[tank], seen.temperature[tank]


def _cut(one: Ends | None, two: Ends, tank: int, seen: Observation) -> Ends:
    """What lies in both intervals."""
    if one is None:
        return two
    ends = Ends(max(one.low, two.low), min(one.high, two.high), max(one.cold, two.cold), min(one.warm, two.warm))
    if ends.low > ends.high or ends.cold > ends.warm:
        raise StationError(
            f"estimator, {TANKS[tank]}: no tank within the uncertainty gives the readings at {seen.time:g} s; "
            f"between the ends {one} and {two} nothing is left"
        )
    return ends
