"""The figures of one window, counted from the rows of a record and the events of its vehicles."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from api.twins.day_tally import BY_LIMIT, DayTally, onto
from api.twins.days import DAY_S, FLOATS, UNITS
from api.twins.messages import EventKind
from api.twins.record_parts import Part
from api.twins.windows import Window
from station.columns import CODES
from station.geometry import VALVES
from station.scenario import Scenario
from station.tariff import QUARTER

MORE_UNITS = {
    "vehicles_connected": "vehicles",
    "state_of_charge_mean": "1",
    "state_of_charge_min": "1",
    "compressor_kwh": "kWh",
    "precooler_kwh": "kWh",
    "kwh_per_kg": "kWh/kg",
    "revenue_eur": "EUR",
    "margin_eur": "EUR",
    "occupied_s": "s",
    "utilisation": "1",
    "availability": "1",
    "whole_s": "s",
    "unread_s": "s",
}
"""Figures of a window that a day has not, and their units."""

WINDOW_UNITS = {**{name: unit for name, unit in UNITS.items() if name != "day"}, **MORE_UNITS}
"""Figures of a window and their units."""

WINDOW_FLOATS = (
    *FLOATS, *(name for name in MORE_UNITS if name not in ("vehicles_connected", "occupied_s", "whole_s", "unread_s"))
)  # fmt: skip
"""Those that are no whole numbers."""

_OF_VEHICLES = (
    "vehicles_arrived", "vehicles_served", "vehicles_incomplete", "vehicles_connected", "wait_mean_s", "wait_p95_s",
    "wait_max_s", "state_of_charge_mean", "state_of_charge_min",
)  # fmt: skip
"""Figures that events tell, also of seconds that are kept as minutes."""

_UNMEASURED = (
    "vehicles_arrived", "vehicles_served", "vehicles_incomplete", "vehicles_waiting", "deadlines_missed", "liveness_s",
    "refused_valves", *BY_LIMIT,
)  # fmt: skip
"""Figures that no sensor tells."""

_NONE = math.nan

_INLETS = VALVES[:3]


class WindowTally:
    """Counts of a window. Rows come in order, with the one before it and the one behind it, if these are kept.

    Parameters
    ----------
    scenario : Scenario
        The scenario of the twin.
    window : Window
        The seconds to be counted.
    powers : list of str
        Columns of the plant's electric power, compressor first; none where no account is kept.
    measured : bool
        Whether the record is one of readings.
    """

    def __init__(self, scenario: Scenario, window: Window, powers: list[str], *, measured: bool) -> None:
        self._window, self._powers, self._measured = window, powers, measured
        self._tariff = scenario.station.tariff
        tally = self._tally = DayTally(scenario, DAY_S)
        tally.is_metered = bool(powers)
        tally.begin(window.first)
        tally.since = tally.next = window.first
        tally.bill.open(window.first // QUARTER * QUARTER, window.end)
        self._starts_known = window.first == 0
        self._stock: list[tuple[float, ...]] = []  # masses of the buffers at its begin, and behind its end [g]
        self._sums = dict.fromkeys(("flow", "inlets", *powers), 0.0)  # over all rows, minutes too
        self._covered = 0.0  # seconds that these rows stand for,
        self._bounds = [math.nan, math.nan]  # and from when to when they do [s]
        self._counts = dict.fromkeys(("connected", "occupied", "starved", "unread", "whole"), 0)
        self._vehicle: float | None = None  # in the second before
        self._charges: list[float] = []

    def add(self, part: Part) -> None:
        """Take what belongs to the window from rows of the record."""
        first, end = self._window
        begin, behind = np.searchsorted(part.time, (first, end))
        if begin and part.time[begin - 1] == first - 1 and part.spans[begin - 1] == 1.0:
            before = {name: column[begin - 1] for name, column in part.table.items()}
            self._tally.codes = tuple(float(before[name]) for name in CODES)
            self._vehicle, self._starts_known = float(before["vehicle"]), True
        if begin < behind:
            self._add_rows(_cut(part, slice(begin, behind)))
        if behind < len(part.time) and part.time[behind] == end:
            self.end_with(tuple(part.masses[behind].tolist()))

    def end_with(self, masses: tuple[float, ...]) -> None:
        """Take the masses of the buffers at its end [g], where no row behind it tells them."""
        if len(self._stock) == 1 and masses:
            self._stock.append(masses)

    def _add_rows(self, part: Part) -> None:
        table, spans = part.table, part.spans
        self._covered += float(spans.sum())
        self._bounds = [
            float(part.time[0]) if math.isnan(self._bounds[0]) else self._bounds[0],
            float(part.time[-1] + spans[-1]),
        ]
        self._counts["whole"] += int((spans == 1.0).sum())
        for name in self._powers:
            self._sums[name] = onto(self._sums[name], table[name] * spans / 3600)
        self._sums["flow"] = onto(self._sums["flow"], table["flow_dispenser"] * spans)
        self._sums["inlets"] += float((np.sum([table[name] for name in _INLETS], axis=0) * spans).sum())
        if part.time[0] != self._tally.next or (spans != 1.0).any() or (np.diff(part.time) != 1.0).any():
            return  # minutes, or what is behind them: not every second is known
        if self._tally.next == self._window.first:
            self._stock = [tuple(part.masses[0].tolist())]
        energy = np.zeros(len(spans))
        for name in self._powers:
            energy = energy + table[name]
        self._tally.rows(table, energy / 3600)
        self._count_vehicles(table["vehicle"], table["flow_dispenser"])
        self._counts["unread"] += int(part.unread.sum())

    def _count_vehicles(self, vehicle: np.ndarray, flow: np.ndarray) -> None:
        there = vehicle >= 0
        self._counts["occupied"] += int(there.sum())
        self._counts["starved"] += int((there & (flow <= 0)).sum())
        if self._measured:
            before = np.concatenate(([self._vehicle if self._vehicle is not None else vehicle[0]], vehicle[:-1]))
            self._counts["connected"] += int((there & (vehicle != before)).sum())
            self._vehicle = float(vehicle[-1])

    def event(self, event: Mapping[str, Any]) -> None:
        """Take an event of the record's, if it is of a vehicle and of the window."""
        first, end = self._window
        time, details, counts = event["time"], event["details"], self._tally.counts
        match event["kind"]:
            case EventKind.ARRIVAL if first <= time < end:
                counts["arrived"] += 1
            case EventKind.FILL_START if first <= time < end:
                self._counts["connected"] += 1
                self._tally.waits.append(_told(details, "waited_s"))
            case (EventKind.FILL_END | EventKind.FILL_INCOMPLETE) as kind if first < time <= end:
                counts["served" if kind == EventKind.FILL_END else "incomplete"] += 1
                self._charges.append(_told(details, "state_of_charge"))

    # The figures.

    def figures(self) -> dict[str, float]:
        """WINDOW_UNITS of the window; NaN: there is none, or the record does not tell it."""
        first, end = self._window
        tally, counts = self._tally, self._counts
        if self._stock and not self._measured:
            tally.bill.second(first, self._stock[0], self._stock[-1])
        found = {**tally.figures(), "from_s": first, "to_s": end}
        found |= self._more(found, end - first)
        if tally.next != end:
            known = {"from_s", "to_s", *(() if self._measured else _OF_VEHICLES)}
            found |= {name: _NONE for name in found if name not in known} | self._of_minutes(end - first)
        if not self._starts_known:
            found["compressor_starts"] = _NONE
        if len(self._stock) < 2 or any(math.isnan(mass) for mass in self._stock[-1]):
            found |= dict.fromkeys(("stock_eur", "total_eur", "eur_per_kg", "margin_eur"), _NONE)
        if self._measured:
            found |= dict.fromkeys(_UNMEASURED, _NONE)
        return {**found, "whole_s": counts["whole"], "unread_s": counts["unread"]}

    def _more(self, found: Mapping[str, float], duration: int) -> dict[str, float]:
        """The figures of MORE_UNITS but the last two, of a window that is whole."""
        counts, charges, kilograms = self._counts, np.array(self._charges), found["delivered_kg"]
        machines = [self._sums[name] for name in self._powers] or [
            power * found[seconds] / 3600
            for power, seconds in zip(self._tally.powers, ("compressor_s", "dispensing_s"), strict=True)
        ]
        price = None if self._tariff is None else self._tariff.hydrogen_eur_per_kg
        revenue = _NONE if price is None else price * kilograms
        return {
            "vehicles_connected": counts["connected"],
            "state_of_charge_mean": float(charges.mean()) if charges.size else _NONE,
            "state_of_charge_min": float(charges.min()) if charges.size else _NONE,
            "compressor_kwh": machines[0],
            "precooler_kwh": machines[1],
            "kwh_per_kg": found["energy_kwh"] / kilograms if kilograms else _NONE,
            "revenue_eur": revenue,
            "margin_eur": revenue - found["total_eur"],
            "occupied_s": counts["occupied"],
            "utilisation": counts["occupied"] / duration,
            "availability": 1.0 - counts["starved"] / duration,
        }

    def _of_minutes(self, duration: int) -> dict[str, float]:
        """Sums over columns, which means of minutes still tell if these stand for the window and for nothing else."""
        if self._covered != duration or self._bounds != [*self._window] or self._measured:
            return {}
        kilograms = self._sums["flow"] / 1000
        machines = [self._sums[name] for name in self._powers] or [_NONE, _NONE]
        energy = machines[0] + machines[1]
        return {
            "delivered_kg": kilograms,
            "compressor_s": float(np.rint(self._sums["inlets"])),
            "compressor_kwh": machines[0],
            "precooler_kwh": machines[1],
            "energy_kwh": energy,
            "kwh_per_kg": energy / kilograms if kilograms else _NONE,
        }


def _told(details: Mapping[str, Any], name: str) -> float:
    """A figure of an event; NaN where an older version did not tell it."""
    found = details.get(name)
    return _NONE if found is None else float(found)


def _cut(part: Part, rows: slice) -> Part:
    table = {name: column[rows] for name, column in part.table.items()}
    return Part(table, part.spans[rows], part.masses[rows], part.unread[rows])


def window_document(figures: Mapping[str, float], told: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """A window as JSON carries it: NaN becomes null, counts are whole, refusals stand together by their limit.

    `told` are the figures of the same seconds as a day of the twin had them: they stand where the record has none, or
    does not hold every second any more.
    """
    refused = {limit: _plain(name, figures[name]) for name, limit in BY_LIMIT.items()}
    plain: dict[str, Any] = {name: _plain(name, figures[name]) for name in WINDOW_UNITS if name not in BY_LIMIT}
    plain["refused"] = None if None in refused.values() else refused
    is_whole = plain["whole_s"] == plain["to_s"] - plain["from_s"]
    for name, value in (told or {}).items():
        if name in plain and (plain[name] is None or not is_whole):
            plain[name] = value
    return plain


def _plain(name: str, figure: float) -> float | int | None:
    if math.isnan(figure):
        return None
    return figure if name in WINDOW_FLOATS else int(figure)
