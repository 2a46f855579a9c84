"""Masses from noisy readings, with a half-width certified before the run and an interval that the run leaves."""

from __future__ import annotations

from functools import lru_cache
from math import isnan, nan
from typing import NamedTuple

import numpy as np

from controllers.certified.prediction import Known, Tanks, step
from controllers.certified.tanks import Box, Group, Range, group_of
from station.controller import Observation
from station.errors import StationError
from station.geometry import BUFFERS, INLETS, KELVIN, OUTLETS, VEHICLE
from station.parameters import Station
from station.plants.thesis import PlantConstants, gas_mass, gas_pressure, refuse_others
from station.tightening import TightenedStation
from station.tube import TankInterval, interval_at, pressure_interval
from station.uncertainty import Uncertainty
from theory.switching.observer import Observer

TANKS = (*BUFFERS, "vehicle")


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
        return tuple((nan, nan) if ends is None else pressure_interval(ends) for ends in self.tanks)


class Estimator:
    """Masses of a station second by second, each with a certified half-width and an interval.

    Two answers stand side by side. The observers' `mass` is within `half_width` whatever comes, which their certificate
    proves before the run. The interval from `low` to `high` is what the readings of this run leave: the interval a
    second before, carried on, cut with what the new readings admit and with the observers' set.

    Parameters
    ----------
    station
        As a disturbed scenario tells it (`Scenario.known_station`), or the nominal one.
    uncertainty
        Beside a nominal station; by default none.
    hold
        Seconds every tank's mode is known to last; where a mode ends sooner, its tank begins anew from its reading,
        as it does every second of dispensing to a vehicle that reports nothing.
    smooth
        Whether gains weigh many readings together, or have the smallest certified set.
    box
        Operating conditions that the claim holds for.
    """

    def __init__(
        self, station: Station, uncertainty: Uncertainty | None = None, *, hold: int = 1, smooth: bool = True,
        box: Box | None = None,
    ) -> None:  # fmt: skip
        if isinstance(station, TightenedStation):
            uncertainty, station = uncertainty or station.uncertainty, station.nominal
        refuse_others(station.plant, "estimates")
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
        """Inputs of `predict` beside the tanks."""
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
        tanks: list[TankInterval | None] = []
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
                ends = _cut(before, TankInterval(*interval_at(pressure, temperature, error, warm)), tank, seen)
            if tank != VEHICLE or seen.communication:
                half_width[tank] = self._observe(tank, going, seen)
                volume = self._volume(tank, seen)
                least, most = self._mass[tank] - half_width[tank], self._mass[tank] + half_width[tank]
                ends = _cut(ends, TankInterval(least / volume, most / volume, -KELVIN, np.inf), tank, seen)
            else:
                self._mass[tank] = nan
            tanks.append(ends)
        found: Tanks = tuple(tanks)  # type: ignore[assignment]  # four, the buffers' never None
        self._last, self._tanks = seen, found
        masses = [self._masses(tank, ends, seen) for tank, ends in enumerate(tanks)]
        low, high = tuple(pair[0] for pair in masses), tuple(pair[1] for pair in masses)
        return Estimate(tuple(self._mass), tuple(half_width), low, high, found)

    def _masses(self, tank: int, ends: TankInterval | None, seen: Observation) -> Range:
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
            self._mass[tank], self._run[tank] = self._observed_mass(tank, seen), (now, 0)
            return half_width
        run = run if mode == now else 0
        gain = observer.gain(group.modes.index(now) + 1, run)[0, 0]
        observed = self._observed_mass(tank, last)
        self._mass[tank] += seen.period * self._flow(tank, seen.previous, last) + gain * (observed - self._mass[tank])
        self._run[tank] = now, run + 1
        return half_width

    def _observed_mass(self, tank: int, seen: Observation) -> float:
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
                    f"estimator, {TANKS[tank]}: {what} at {seen.time:g} s must stay {error:g} within {low:g} to "
                    f"{high:g}, the box of the certificate; read {value:g}"
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


def _cut(one: TankInterval | None, two: TankInterval, tank: int, seen: Observation) -> TankInterval:
    """What lies in both intervals."""
    if one is None:
        return two
    ends = TankInterval(
        max(one.low, two.low), min(one.high, two.high), max(one.cold, two.cold), min(one.warm, two.warm)
    )
    if ends.low > ends.high or ends.cold > ends.warm:
        raise StationError(
            f"estimator, {TANKS[tank]}: no tank within the uncertainty gives the readings at {seen.time:g} s; "
            f"between the ends {one} and {two} nothing is left"
        )
    return ends
