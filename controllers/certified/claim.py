"""What a certificate of service claims: of which vehicles, how far apart, and how soon each is finished."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from controllers.certified.box import Seen
from controllers.certified.vehicles import Vehicles, vehicles_of
from station.errors import InputError
from station.parameters import Station

HOUR = 3600
"""The window of the bound on what is dispensed [s]."""

LONGEST = 7200
"""No T or s beyond this is looked at [s]."""


@dataclass(frozen=True)
class Asked:
    """What somebody asks to be claimed; what is left out follows from the station and from S1-S4."""

    volume: tuple[float, float] | None = None  # of tanks [m3]
    start_spread: float | None = None  # of start pressures to either side [bar]
    spacing: int | None = None  # s [s]
    within: int | None = None  # T [s]

    def as_document(self) -> dict[str, Any]:
        """As JSON holds it."""
        return {
            "volume_m3": None if self.volume is None else list(self.volume), "start_spread_bar": self.start_spread,
            "spacing_s": self.spacing, "within_s": self.within,
        }  # fmt: skip

    @classmethod
    def of_document(cls, given: dict[str, Any]) -> Asked:
        """What `as_document` wrote."""
        volume = given["volume_m3"]
        return cls(
            None if volume is None else (float(volume[0]), float(volume[1])),
            None if given["start_spread_bar"] is None else float(given["start_spread_bar"]),
            None if given["spacing_s"] is None else int(given["spacing_s"]),
            None if given["within_s"] is None else int(given["within_s"]),
        )


@dataclass(frozen=True)
class Claim:
    """Each of these vehicles, arriving so far apart, is finished so soon after it has connected."""

    vehicles: Vehicles
    spacing: int  # s [s]
    within: int  # T [s]

    def gas(self, station: Station) -> dict[str, float]:
        """What one vehicle and all that arrive within an hour can take, as JSON holds it."""
        one = self.vehicles.gas(station)
        return {"vehicle_kg": one, "hour_kg": one * (1 + HOUR // max(self.spacing, 1))}


def claim_of(station: Station, seen: Seen, asked: Asked) -> Claim:
    """The claim at a station.

    What is not asked otherwise: s and T are those of the usual vehicle in S1-S4, by what the widest vehicle takes more.

    Raises
    ------
    InputError
        for vehicles that the station cannot fill, and times beyond LONGEST.
    """
    vehicles = vehicles_of(station, asked.volume, asked.start_spread)
    demand = max(vehicles.demand(station), 1.0)
    spacing = int(demand * seen.spacing) if asked.spacing is None else asked.spacing
    within = int(demand * seen.within) if asked.within is None else asked.within
    problems = [
        (name, f"must be within 1 to {LONGEST} s; {'given' if own is not None else 'these vehicles take'} {time}")
        for name, own, time in (("spacing", asked.spacing, spacing), ("within", asked.within, within))
        if asked != Asked() and not 1 <= time <= LONGEST
    ]
    if problems:
        raise InputError("certificate", problems)
    return Claim(vehicles, spacing, within)
