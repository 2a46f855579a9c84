"""What a day of a live twin costs by its station's tariff: energy is counted here, and priced by `station.costs`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from station.costs import COST_UNITS, account_edges, bill_of, stock_eur
from station.scenario import Scenario

BILL = ("energy_eur", "demand_eur", "stock_eur", "total_eur", "eur_per_kg", "peak_kw")
"""Figures of COST_UNITS that a day has."""

BILL_UNITS = {name: COST_UNITS[name] for name in BILL}
"""And their units."""

NOTHING = dict.fromkeys(BILL, float("nan"))
"""The figures where there is no tariff."""


class DayBill:
    """The energy of the running day between the times at which prices change or quarters of an hour end.

    Without a tariff it counts nothing, and its figures are NaN.
    """

    def __init__(self, scenario: Scenario, day_s: int) -> None:
        self._scenario = scenario
        self._tariff = scenario.station.tariff
        self._day_s = day_s
        self.close()

    def close(self) -> None:
        """Forget the day; the next second opens another."""
        self._edges = np.zeros(0)
        self._spent: list[float] = []
        self._place = 0  # among the edges
        self._stock: tuple[Sequence[float], Sequence[float]] = (), ()  # of the buffers, at first and now [g]

    def second(self, seq: int, before: Sequence[float], after: Sequence[float]) -> None:
        """One more second is over, with these masses of the buffers at its begin and its end [g]."""
        if self._tariff is None:
            return
        if not self._spent:
            self._open_day(seq)
        self._stock = self._stock[0] or before, after

    @property
    def stock(self) -> tuple[float, ...]:
        """Masses of the buffers behind the last second [g]; () before the first, and without a tariff."""
        return tuple(self._stock[1])

    def _open_day(self, seq: int) -> None:
        begin = seq // self._day_s * self._day_s
        self.open(begin, begin + self._day_s)

    def open(self, begin: float, end: float) -> None:
        """Count from one time to another instead of in days; quarters of an hour are counted from `begin` [s]."""
        if self._tariff is None:
            return
        self._edges = account_edges(self._tariff, float(begin), float(end))
        self._spent = [0.0] * (len(self._edges) - 1)
        self._place = 0

    def add(self, begin: float, end: float, energy: float) -> None:
        """So much electric energy [kWh] was taken evenly between two times of the day, not before any told [s]."""
        if not self._spent or not energy:
            return
        edges, power = self._edges, energy / (end - begin)
        while edges[self._place + 1] <= begin:
            self._place += 1
        while edges[self._place + 1] < end:
            self._spent[self._place] += power * (edges[self._place + 1] - begin)
            begin = edges[self._place + 1]
            self._place += 1
        self._spent[self._place] += power * (end - begin)

    def figures(self, duration: float, delivered: float) -> dict[str, float]:
        """BILL of so many seconds with so much hydrogen dispensed [kg]; NaN where a figure has no bound."""
        if self._tariff is None or not self._spent:
            return NOTHING
        stock = stock_eur(self._scenario, *self._stock)
        found = bill_of(self._tariff, self._edges, np.array(self._spent), duration, stock, delivered)
        return {name: found[name] if math.isfinite(found[name]) else float("nan") for name in BILL}

    def memories(self) -> dict[str, np.ndarray]:
        """Arrays for a snapshot, by name."""
        return {"day_spent": np.array(self._spent), "day_stock": np.array(self._stock)} if self._spent else {}

    def resume(self, memories: Mapping[str, Any], first: int) -> bool:
        """Go on with the day of second `first` from a snapshot; whether it has what this tariff needs."""
        spent, stock = memories.get("day_spent"), memories.get("day_stock")
        if self._tariff is None or spent is None or stock is None or len(stock) != len(self._stock):
            return self._tariff is None
        self._open_day(first)
        if len(spent) != len(self._spent):
            self.close()
            return False
        self._spent = spent.tolist()
        self._stock = tuple(stock[0].tolist()), tuple(stock[1].tolist())
        return True
