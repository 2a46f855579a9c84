"""The claim of a certificate of service: of which vehicles, how far apart, and how soon each is finished."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from controllers.certified.box import OperatingBox
from controllers.certified.vehicles import Vehicles, vehicles_of
from station.errors import InputError
from station.parameters import Station

HOUR = 3600
"""The window of the bound on what is dispensed [s]."""

LONGEST = 7200
"""No T or s beyond this is looked at [s]."""

BURST_MAX = 20
"""No claim is of larger bursts."""


@dataclass(frozen=True)
class Asked:
    """A claim as it is requested; fields left out follow from the station and from S1-S4."""

    volume: tuple[float, float] | None = None  # of tanks [m3]
    start_spread: float | None = None  # of start pressures to either side [bar]
    spacing: int | None = None  # s [s]
    within: int | None = None  # T [s]
    burst: int = 1  # vehicles that may come at once

    def as_document(self) -> dict[str, Any]:
        """As JSON holds it."""
        return {
            "volume_m3": None if self.volume is None else list(self.volume), "start_spread_bar": self.start_spread,
            "spacing_s": self.spacing, "within_s": self.within, "burst": self.burst,
        }  # fmt: skip

    @classmethod
    def of_document(cls, given: dict[str, Any]) -> Asked:
        """The claim that `as_document` wrote."""
        volume = given["volume_m3"]
        return cls(
            None if volume is None else (float(volume[0]), float(volume[1])),
            None if given["start_spread_bar"] is None else float(given["start_spread_bar"]),
            None if given["spacing_s"] is None else int(given["spacing_s"]),
            None if given["within_s"] is None else int(given["within_s"]),
            int(given["burst"]),
        )


@dataclass(frozen=True)
class Claim:
    """Each of these vehicles is finished so soon: after it has connected, or in bursts after it has arrived.

    With bursts of b no more than b + t / s vehicles arrive in t seconds. Fills that begin when the vehicle is there
    and s has passed since the one before then begin within (b - 1) s of the arrival (Lindley's recursion), but for the
    second in which a station sees who has come.
    """

    vehicles: Vehicles
    spacing: int  # s [s]
    within: int  # T of a fill [s]
    burst: int = 1  # b

    @property
    def promised(self) -> int:
        """From the connection, or with bursts from the arrival, until a vehicle is finished at most [s]."""
        return self.within if self.burst == 1 else (self.burst - 1) * self.spacing + self.within + 1

    def taken(self, arrived: np.ndarray, connected: np.ndarray, finished: np.ndarray) -> np.ndarray:
        """The times the promise is about [s]; inf for a vehicle that is never finished."""
        times = finished - (connected if self.burst == 1 else arrived)
        return np.where(np.isfinite(times), times, np.inf)

    def times(self, gaps: np.ndarray) -> np.ndarray:
        """Arrivals [s] of vehicles with so many seconds between them, put off as far as the claim asks for."""
        slack, due = (self.burst - 1) * self.spacing, 0.0
        times = np.zeros(len(gaps) + 1)
        for place in range(1, len(times)):
            due = max(due, times[place - 1]) + self.spacing  # the generic cell rate algorithm's theoretical arrival
            times[place] = max(times[place - 1] + gaps[place - 1], due - slack)
        return times

    def gas(self, station: Station) -> dict[str, float]:
        """Gas that one vehicle and all that arrive within an hour can take, as JSON holds it."""
        one = self.vehicles.gas(station)
        return {"vehicle_kg": one, "hour_kg": one * (self.burst + HOUR // max(self.spacing, 1))}


def claim_of(station: Station, seen: OperatingBox, asked: Asked, space: int = 0) -> Claim:
    """The claim at a station, of a controller whose fills begin at least `space` [s] apart.

    What is not asked otherwise: s and T are those of the usual vehicle in S1-S4, by what the widest vehicle takes more;
    with bursts s is `space`, where there is one.

    Raises
    ------
    InputError
        for vehicles that the station cannot fill, times beyond LONGEST, and bursts beyond BURST_MAX.
    """
    if not 1 <= asked.burst <= BURST_MAX:
        raise InputError("certificate", [("burst", f"must be within 1 to {BURST_MAX}; given {asked.burst}")])
    vehicles = vehicles_of(station, asked.volume, asked.start_spread)
    demand = max(vehicles.demand(station), 1.0)
    usual = space if asked.burst > 1 and space else int(demand * seen.spacing)
    spacing = usual if asked.spacing is None else asked.spacing
    within = int(demand * seen.within) if asked.within is None else asked.within
    problems = [
        (name, f"must be within 1 to {LONGEST} s; {'given' if own is not None else 'these vehicles take'} {time}")
        for name, own, time in (("spacing", asked.spacing, spacing), ("within", asked.within, within))
        if asked != Asked() and not 1 <= time <= LONGEST
    ]
    if problems:
        raise InputError("certificate", problems)
    return Claim(vehicles, spacing, within, asked.burst)
