"""What is counted of a stretch of a simulated record, and the figures it makes: of a day, or of any window."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from api.twins.day_bill import DayBill
from api.twins.messages import COLUMNS
from station import Limit, Status
from station.columns import CODES
from station.geometry import VALVES
from station.plants.interface import plant_named
from station.scenario import Scenario

BY_LIMIT = {f"refused_{limit.name.lower()}": limit.name.lower() for limit in Limit if limit}
"""Name of each limit by that of the figure that counts its refusals."""

PLACES = {name: place for place, name in enumerate(COLUMNS)}
"""Place of each column in the row of a second."""

HOLDING = slice(PLACES[VALVES[0]], PLACES["decision_status"] + 1)
"""The part of a row that holds for minutes: valves, what refuses them, and who decided."""

COUNTED = (
    "arrived", "served", "incomplete", "waiting", "compressor", "dispensing", "starts", "missed", "liveness",
    "delivered", "energy",
)  # fmt: skip

_INLETS, _OUTLETS, _REFUSED = slice(0, 3), slice(3, 6), slice(6, 12)  # of the codes; the last is the status


class DayTally:
    """Counts of the seconds from `first` to `next`.

    Valves and refusals hold for minutes: what holds is counted when it ends. A caller who has one second at a time adds
    to `counts`, `waits` and `bill` itself; `rows` adds many.
    """

    def __init__(self, scenario: Scenario, day_s: int) -> None:
        station = scenario.station
        powers = station.compressor.power_kw, station.precooler.power_kw
        self.powers = [math.nan if power is None else power for power in powers]
        self.is_metered = bool(plant_named(station.plant).powers)
        self.is_billed = station.tariff is not None
        self.bill = DayBill(scenario, day_s)
        self.codes: tuple[float, ...] = ()  # what holds since `since`
        self.first = self.since = self.next = 0
        self.begin(0)

    def begin(self, first: int) -> None:
        """Count anew from second `first` on; what holds goes on."""
        self.first = first
        self.counts = dict.fromkeys(COUNTED, 0.0)
        self.refused = [0] * (max(Limit) + 1)
        self.waits: list[float] = []
        self.bill.close()

    def change(self, codes: tuple[float, ...], now: int) -> None:
        """Let other codes hold from second `now` on."""
        self.count(now)
        before = sum(self.codes[_INLETS])
        self.counts["starts"] += max(0.0, sum(codes[_INLETS]) - before)
        self.codes = codes

    def count(self, now: int) -> None:
        """Count what has held until second `now`."""
        since, codes, counts = self.since, self.codes, self.counts
        spans, self.since = now - since, now
        if not spans or not codes:
            return
        counts["compressor"] += spans * sum(codes[_INLETS])
        counts["dispensing"] += spans * any(codes[_OUTLETS])
        if self.is_billed and not self.is_metered:
            power = self.powers[0] * sum(codes[_INLETS]) + self.powers[1] * any(codes[_OUTLETS])
            self.bill.add(since, now, power * spans / 3600)
        counts["missed"] += spans * (codes[-1] == Status.FALLBACK)
        counts["liveness"] += spans * (codes[-1] == Status.LIVENESS)
        for limit in codes[_REFUSED]:
            self.refused[int(limit)] += spans

    def rows(self, table: Mapping[str, np.ndarray], energy: NDArray[np.float64]) -> None:
        """Add seconds that follow one another, a row each, from `next` on.

        `table` has the columns of CODES, `flow_dispenser` [g/s] and `queue_length`; `energy` is that of each second
        [kWh], 0 where the plant keeps no account of it.
        """
        codes = np.column_stack([table[name] for name in CODES])
        changes = np.flatnonzero((codes[1:] != codes[:-1]).any(axis=1)) + 1
        for place in (0, *changes.tolist()):
            now = tuple(codes[place].tolist())
            if now != self.codes:
                self.change(now, self.next + place)
        counts = self.counts
        counts["delivered"] = onto(counts["delivered"], table["flow_dispenser"])
        counts["energy"] = onto(counts["energy"], energy)
        counts["waiting"] = float(table["queue_length"][-1])
        if self.is_billed:
            for place in np.flatnonzero(energy).tolist():
                self.bill.add(self.next + place, self.next + place + 1, float(energy[place]))
        self.next += len(codes)

    def figures(self) -> dict[str, float]:
        """Figures of the seconds so far, by the names of `api.twins.days.UNITS` behind `day`; NaN: there is none."""
        self.count(self.next)
        counts, waits = self.counts, np.array(self.waits)
        refused = dict(zip(BY_LIMIT, self.refused[1:], strict=True))
        none = float("nan")
        compressor, dispensing = counts["compressor"], counts["dispensing"]
        energy = (self.powers[0] * compressor + self.powers[1] * dispensing) / 3600
        return {
            "from_s": self.first,
            "to_s": self.next,
            "vehicles_arrived": counts["arrived"],
            "vehicles_served": counts["served"],
            "vehicles_incomplete": counts["incomplete"],
            "vehicles_waiting": counts["waiting"],
            "wait_mean_s": float(waits.mean()) if waits.size else none,
            "wait_p95_s": float(np.quantile(waits, 0.95)) if waits.size else none,
            "wait_max_s": float(waits.max()) if waits.size else none,
            "delivered_kg": counts["delivered"] / 1000,
            "compressor_s": compressor,
            "dispensing_s": dispensing,
            "energy_kwh": counts["energy"] if self.is_metered else energy,
            "compressor_starts": counts["starts"],
            "refused_valves": sum(refused.values()),
            "deadlines_missed": counts["missed"],
            "liveness_s": counts["liveness"],
            **self.bill.figures(self.next - self.first, counts["delivered"] / 1000),
            **refused,
        }


def onto(total: float, added: NDArray[np.float64]) -> float:
    """A total with figures added one by one in their order: the bits of a sum that grew second by second."""
    return float(np.cumsum(np.concatenate(([total], added)))[-1])
