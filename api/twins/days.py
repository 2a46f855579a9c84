"""Figures of a live twin by simulated day: kept second by second, with the formulas of `station.metrics`."""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Iterator
from typing import Any

import numpy as np

from api.twins.day_bill import BILL, BILL_UNITS, DayBill
from api.twins.messages import COLUMNS
from station import Limit, Status
from station.geometry import BUFFERS, VALVES
from station.live import Second
from station.plants.interface import plant_named
from station.scenario import Scenario

DAY_S = 86_400
"""Length of a day, counted from the twin's start [simulated s]."""

DAYS_MAX = 31
"""Past days that are kept: with the running one some 8 kB of a checkpoint."""

_BY_LIMIT = {f"refused_{limit.name.lower()}": limit.name.lower() for limit in Limit if limit}

UNITS = {
    "day": "index",
    "from_s": "s",
    "to_s": "s",
    "vehicles_arrived": "vehicles",
    "vehicles_served": "vehicles",
    "vehicles_incomplete": "vehicles",
    "vehicles_waiting": "vehicles",
    "wait_mean_s": "s",
    "wait_p95_s": "s",
    "wait_max_s": "s",
    "delivered_kg": "kg",
    "compressor_s": "s",
    "dispensing_s": "s",
    "energy_kwh": "kWh",
    "compressor_starts": "1",
    "refused_valves": "1",
    "deadlines_missed": "1",
    "liveness_s": "s",
    **BILL_UNITS,
    **dict.fromkeys(_BY_LIMIT, "1"),
}
"""Figures of a day and their units."""

FLOATS = ("wait_mean_s", "wait_p95_s", "wait_max_s", "delivered_kg", "energy_kwh", *BILL)
"""Figures that are no whole numbers; NaN where there is none."""


def document(figures: dict[str, float]) -> dict[str, Any]:
    """A day as JSON carries it: NaN becomes null, counts are whole, refusals stand together by their limit."""
    plain: dict[str, Any] = {"refused": {}}
    for name, figure in figures.items():
        if name in FLOATS:
            plain[name] = None if math.isnan(figure) else figure
        elif name in _BY_LIMIT:
            plain["refused"][_BY_LIMIT[name]] = int(figure)
        else:
            plain[name] = int(figure)
    return plain


_PLACES = {name: place for place, name in enumerate(COLUMNS)}
_CODES = slice(_PLACES[VALVES[0]], _PLACES["decision_status"] + 1)
_INLETS, _OUTLETS, _REFUSED = slice(0, 3), slice(3, 6), slice(6, 12)  # of the codes; the last is the status
_MASS = slice(_PLACES[f"mass_{BUFFERS[0]}"], _PLACES[f"mass_{BUFFERS[-1]}"] + 1)
_FLOW, _QUEUE = _PLACES["flow_dispenser"], _PLACES["queue_length"]
_COUNTED = (
    "arrived", "served", "incomplete", "waiting", "compressor", "dispensing", "starts", "missed", "liveness",
    "delivered", "energy",
)  # fmt: skip


class Days:
    """The running day and those past. The twin's thread adds seconds, others read figures.

    Valves and refusals hold for minutes, so that a second costs a comparison: what holds is counted when it ends.
    """

    def __init__(self, scenario: Scenario, day_s: int | None = None) -> None:
        station = scenario.station
        powers = station.compressor.power_kw, station.precooler.power_kw
        self._powers = [math.nan if power is None else power for power in powers]
        self._is_metered = bool(plant_named(station.plant).powers)
        self._day_s = day_s or DAY_S
        self._bill = DayBill(scenario, self._day_s)
        self._is_billed = station.tariff is not None
        self._lock = threading.Lock()
        self._past: deque[dict[str, float]] = deque(maxlen=DAYS_MAX)
        self._codes: tuple[float, ...] = ()  # what holds since `_since`
        self._first = self._since = self._next = 0  # seconds: where the day's figures begin, and the next to come
        self._begin()

    def _begin(self) -> None:
        self._counts = dict.fromkeys(_COUNTED, 0.0)
        self._refused = [0] * (max(Limit) + 1)
        self._waits: list[float] = []
        self._bill.close()

    def add(self, second: Second, wait: float | None = None) -> dict[str, float] | None:
        """One more second, and the wait of a vehicle that was connected in it [s]; the figures of a day it ends."""
        if second.over:
            return None
        row = second.row
        with self._lock:
            if second.seq != self._next:
                self._first = self._since = second.seq  # nothing is known of the seconds before
                self._bill.close()
            if self._is_billed:
                self._bill.second(second.seq, row[_MASS], second.stock)
                self._bill.add(second.seq, second.seq + 1, second.energy)
            codes = row[_CODES]
            if codes != self._codes:
                self._count(second.seq)
                self._change(codes)
            counts = self._counts
            counts["delivered"] += row[_FLOW]
            counts["energy"] += second.energy
            counts["waiting"] = row[_QUEUE]
            if second.arrived:
                counts["arrived"] += len(second.arrived)
            if second.left >= 0:
                counts["incomplete" if math.isnan(second.figures["finished"]) else "served"] += 1
            if wait is not None:
                self._waits.append(wait)
            self._next = second.seq + 1
            return None if self._next % self._day_s else self._turn()

    def _change(self, codes: tuple[float, ...]) -> None:
        before = sum(self._codes[_INLETS])
        self._counts["starts"] += max(0.0, sum(codes[_INLETS]) - before)
        self._codes = codes

    def _count(self, now: int) -> None:
        """Count what has held until second `now`."""
        since, codes, counts = self._since, self._codes, self._counts
        spans, self._since = now - since, now
        if not spans or not codes:
            return
        counts["compressor"] += spans * sum(codes[_INLETS])
        counts["dispensing"] += spans * any(codes[_OUTLETS])
        if self._is_billed and not self._is_metered:
            power = self._powers[0] * sum(codes[_INLETS]) + self._powers[1] * any(codes[_OUTLETS])
            self._bill.add(since, now, power * spans / 3600)
        counts["missed"] += spans * (codes[-1] == Status.FALLBACK)
        counts["liveness"] += spans * (codes[-1] == Status.LIVENESS)
        for limit in codes[_REFUSED]:
            self._refused[int(limit)] += spans

    def _turn(self) -> dict[str, float]:
        """End the day: the figures of it."""
        figures = self._figures()
        self._past.append(figures)
        self._first = self._next
        self._begin()
        return figures

    def _figures(self) -> dict[str, float]:
        self._count(self._next)
        counts, waits = self._counts, np.array(self._waits)
        refused = dict(zip(_BY_LIMIT, self._refused[1:], strict=True))
        none = float("nan")
        compressor, dispensing = counts["compressor"], counts["dispensing"]
        energy = (self._powers[0] * compressor + self._powers[1] * dispensing) / 3600
        return {
            "day": (self._next - 1) // self._day_s,
            "from_s": self._first,
            "to_s": self._next,
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
            "energy_kwh": counts["energy"] if self._is_metered else energy,
            "compressor_starts": counts["starts"],
            "refused_valves": sum(refused.values()),
            "deadlines_missed": counts["missed"],
            "liveness_s": counts["liveness"],
            **self._bill.figures(self._next - self._first, counts["delivered"] / 1000),
            **refused,
        }

    def running(self) -> dict[str, float] | None:
        """UNITS of the running day; None where none of its seconds was simulated."""
        with self._lock:
            return self._figures() if self._next > self._first else None

    def figures(self) -> Iterator[dict[str, float]]:
        """UNITS of each day, the oldest first; the last is the running one, if any of its seconds was simulated."""
        with self._lock:
            running = [self._figures()] if self._next > self._first else []
            return iter([*self._past, *running])

    def memories(self) -> dict[str, np.ndarray]:
        """Arrays for a snapshot, by name."""
        with self._lock:
            self._count(self._next)
            running = [self._first, self._next, *self._counts.values(), *self._refused]
            return {
                "days": np.array([list(day.values()) for day in self._past]).reshape(-1, len(UNITS)),
                "day": np.array(running, float),
                "day_codes": np.array(self._codes, float),
                "day_waits": np.array(self._waits, float),
                **self._bill.memories(),
            }

    def resume(self, memories: dict[str, Any], now: int) -> None:
        """Go on at second `now` from a snapshot; from one without days, or not of this version, they begin now."""
        self._first = self._since = self._next = now
        past, running = memories.get("days"), memories.get("day")
        size = 2 + len(_COUNTED) + len(self._refused)
        if past is not None and past.shape[1:] == (len(UNITS) - len(BILL),):  # an older version did not price a day
            past = np.insert(past, [list(UNITS).index(BILL[0])] * len(BILL), np.nan, axis=1)
        if past is None or past.shape[1:] != (len(UNITS),) or running is None or running.shape != (size,):
            return
        if int(running[1]) != now:
            return
        self._past.extend(dict(zip(UNITS, day, strict=True)) for day in past.tolist())
        has_begun = running[0] < running[1]
        if has_begun and not self._bill.resume(memories, now):
            return  # the tariff is another, or an older version told no energy: the running day begins anew
        self._first = int(running[0])
        self._counts = dict(zip(_COUNTED, running[2:].tolist(), strict=False))
        self._refused = [int(count) for count in running[2 + len(_COUNTED) :]]
        self._codes = tuple(memories["day_codes"].tolist())
        self._waits = memories["day_waits"].tolist()
