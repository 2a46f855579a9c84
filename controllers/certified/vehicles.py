"""The vehicles a claim of service is about: start pressures and tank volumes in ranges, and what they take."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from station.errors import InputError
from station.geometry import KELVIN
from station.parameters import Station
from station.plants.thesis import SPECIFIC_GAS
from station.quantities import VOLUME_MAX


class Vehicle(NamedTuple):
    """One of them."""

    start: float  # pressure at connection [bar]
    volume: float  # [m3]


@dataclass(frozen=True)
class Vehicles:
    """Ranges of vehicles; finish pressure and start temperature are the station's usual vehicle's."""

    starts: tuple[float, float]  # pressures at connection, least and greatest [bar]
    volumes: tuple[float, float]  # of tanks [m3]
    temperature: float  # at connection [deg C]
    finish: float  # pressure on leaving [bar]

    @property
    def densities(self) -> tuple[float, float]:
        """Least and greatest density of the gas in vehicles that connect [g/m3]."""
        low, high = self.starts
        bars = SPECIFIC_GAS * (self.temperature + KELVIN)
        return low / bars, high / bars

    @property
    def widest(self) -> Vehicle:
        """The vehicle that takes the most."""
        return Vehicle(self.starts[0], self.volumes[1])

    def demand(self, station: Station) -> float:
        """Demand of the widest vehicle over that of the usual one: volumes times pressures to be filled."""
        usual, (start, volume) = station.vehicle, self.widest
        rise = usual.finish_pressure_bar - usual.start_pressure_bar
        return float(volume / usual.volume_m3 * ((self.finish - start) / rise))

    def gas(self, station: Station) -> float:
        """No vehicle takes more [kg]: it lies below its finish pressure until the second in which it leaves."""
        coldest = min(self.temperature, station.thermal.ambient_temperature_c)
        full = self.finish / (SPECIFIC_GAS * (coldest + KELVIN))
        return float(self.volumes[1] * (full - self.densities[0]) + station.dispenser.flow_max_g_per_s) / 1000.0

    def cut(self, ratio: float) -> list[tuple[float, float]]:
        """The volumes in cells whose ends differ by no more than `ratio`, the largest first [m3]."""
        low, high = self.volumes
        ends = [high]
        while ends[-1] > low:
            ends.append(max(ends[-1] / ratio, low))
        return [(ends[at + 1], ends[at]) for at in range(len(ends) - 1)] or [(low, high)]

    @property
    def usual(self) -> bool:
        """Whether they are one."""
        return self.starts[0] == self.starts[1] and self.volumes[0] == self.volumes[1]

    def in_words(self) -> str:
        """As a claim names them."""
        if self.usual:
            return "usual vehicle"
        volumes = " to ".join(f"{volume:.4g}" for volume in dict.fromkeys(self.volumes))
        return f"vehicle of {volumes} m3 that begins with {' to '.join(f'{bar:.4g}' for bar in self.starts)} bar"

    def drawn(self, unit: np.ndarray) -> Vehicle:
        """The vehicle at a place of the ranges, both within 0 to 1."""
        start, volume = (
            min(low + (high - low) * float(at), high)
            for (low, high), at in zip((self.starts, self.volumes), unit, strict=True)
        )
        return Vehicle(start, volume)

    def as_document(self) -> dict[str, Any]:
        """As JSON holds it."""
        return {
            "start_pressure_bar": list(self.starts), "volume_m3": list(self.volumes),
            "start_temperature_c": self.temperature, "finish_pressure_bar": self.finish,
        }  # fmt: skip


def vehicles_of(station: Station, volume: tuple[float, float] | None, spread: float | None) -> Vehicles:
    """The usual vehicle of a station; with more volumes [m3], and start pressures `spread` to either side [bar].

    Raises
    ------
    InputError
        for ranges that the station cannot fill, or that are none.
    """
    usual = station.vehicle
    volumes = (usual.volume_m3, usual.volume_m3) if volume is None else volume
    width = 0.0 if spread is None else spread
    starts = usual.start_pressure_bar - width, usual.start_pressure_bar + width
    problems = []
    if not 0.0 < volumes[0] <= volumes[1] <= VOLUME_MAX:
        problems.append(
            ("volume", f"must be two volumes within 0 to {VOLUME_MAX:g} m3, the smaller one first; given {volumes}")
        )
    elif not volumes[0] <= usual.volume_m3 <= volumes[1]:
        problems.append(("volume", f"must hold the usual vehicle's {usual.volume_m3:g} m3; given {volumes}"))
    if not (width >= 0.0 and starts[0] > 0.0 and starts[1] < usual.finish_pressure_bar):
        problems.append(
            ("start_spread", f"must leave start pressures between 0 and {usual.finish_pressure_bar:g}; given {width:g}")
        )
    if not problems:
        try:
            station.check_tank("volume", volumes[0])
        except ValueError as error:
            problems.append(("volume", str(error)))
    if problems:
        raise InputError("certificate", problems)
    return Vehicles(starts, volumes, usual.start_temperature_c, usual.finish_pressure_bar)
