"""Figures of a live twin by simulated day: kept second by second, with the formulas of `station.metrics`."""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Iterator
from typing import Any

import numpy as np

from api.twins.day_bill import BILL, BILL_UNITS
from api.twins.day_tally import BY_LIMIT, COUNTED, HOLDING, PLACES, DayTally
from station.geometry import BUFFERS
from station.live import Second
from station.scenario import Scenario

DAY_S = 86_400
"""Length of a day, counted from the twin's start [simulated s]."""

DAYS_MAX = 31
"""Past days that are kept: with the running one some 8 kB of a checkpoint."""

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
    **dict.fromkeys(BY_LIMIT, "1"),
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
        elif name in BY_LIMIT:
            plain["refused"][BY_LIMIT[name]] = int(figure)
        else:
            plain[name] = int(figure)
    return plain


_MASS = slice(PLACES[f"mass_{BUFFERS[0]}"], PLACES[f"mass_{BUFFERS[-1]}"] + 1)
_FLOW, _QUEUE = PLACES["flow_dispenser"], PLACES["queue_length"]


class Days:
    """The running day and those past. The twin's thread adds seconds, others read figures.

    A second in which nothing changes costs a comparison.
    """

    def __init__(self, scenario: Scenario, day_s: int | None = None) -> None:
        self._day_s = day_s or DAY_S
        self._tally = DayTally(scenario, self._day_s)
        self._lock = threading.Lock()
        self._past: deque[dict[str, float]] = deque(maxlen=DAYS_MAX)

    def add(self, second: Second, wait: float | None = None) -> dict[str, float] | None:
        """One more second, and the wait of a vehicle that was connected in it [s]; the figures of a day it ends."""
        if second.over:
            return None
        row = second.row
        with self._lock:
            tally = self._tally
            if second.seq != tally.next:
                tally.first = tally.since = second.seq  # nothing is known of the seconds before
                tally.bill.close()
            if tally.is_billed:
                tally.bill.second(second.seq, row[_MASS], second.stock)
                tally.bill.add(second.seq, second.seq + 1, second.energy)
            codes = row[HOLDING]
            if codes != tally.codes:
                tally.change(codes, second.seq)
            counts = tally.counts
            counts["delivered"] += row[_FLOW]
            counts["energy"] += second.energy
            counts["waiting"] = row[_QUEUE]
            if second.arrived:
                counts["arrived"] += len(second.arrived)
            if second.left >= 0:
                counts["incomplete" if math.isnan(second.figures["finished"]) else "served"] += 1
            if wait is not None:
                tally.waits.append(wait)
            tally.next = second.seq + 1
            return None if tally.next % self._day_s else self._turn()

    def _turn(self) -> dict[str, float]:
        """End the day: the figures of it."""
        figures = self._figures()
        self._past.append(figures)
        self._tally.begin(self._tally.next)
        return figures

    def _figures(self) -> dict[str, float]:
        return {"day": (self._tally.next - 1) // self._day_s, **self._tally.figures()}

    @property
    def _begun(self) -> bool:
        """Whether any second of the running day was simulated."""
        return self._tally.next > self._tally.first

    def end(self) -> tuple[int, tuple[float, ...]]:
        """How many seconds were simulated, and the masses of the buffers now [g]; () where they are not known."""
        with self._lock:
            return self._tally.next, self._tally.bill.stock

    def running(self) -> dict[str, float] | None:
        """UNITS of the running day; None where none of its seconds was simulated."""
        with self._lock:
            return self._figures() if self._begun else None

    def figures(self) -> Iterator[dict[str, float]]:
        """UNITS of each day, the oldest first; the last is the running one, if any of its seconds was simulated."""
        with self._lock:
            running = [self._figures()] if self._begun else []
            return iter([*self._past, *running])

    def memories(self) -> dict[str, np.ndarray]:
        """Arrays for a snapshot, by name."""
        with self._lock:
            tally = self._tally
            tally.count(tally.next)
            running = [tally.first, tally.next, *tally.counts.values(), *tally.refused]
            return {
                "days": np.array([list(day.values()) for day in self._past]).reshape(-1, len(UNITS)),
                "day": np.array(running, float),
                "day_codes": np.array(tally.codes, float),
                "day_waits": np.array(tally.waits, float),
                **tally.bill.memories(),
            }

    def resume(self, memories: dict[str, Any], now: int) -> None:
        """Go on at second `now` from a snapshot; from one without days, or not of this version, they begin now."""
        tally = self._tally
        tally.first = tally.since = tally.next = now
        past, running = memories.get("days"), memories.get("day")
        size = 2 + len(COUNTED) + len(tally.refused)
        if past is not None and past.shape[1:] == (len(UNITS) - len(BILL),):  # an older version did not price a day
            past = np.insert(past, [list(UNITS).index(BILL[0])] * len(BILL), np.nan, axis=1)
        if past is None or past.shape[1:] != (len(UNITS),) or running is None or running.shape != (size,):
            return
        if int(running[1]) != now:
            return
        self._past.extend(dict(zip(UNITS, day, strict=True)) for day in past.tolist())
        has_begun = running[0] < running[1]
        if has_begun and not tally.bill.resume(memories, now):
            return  # the tariff is another, or an older version told no energy: the running day begins anew
        tally.first = int(running[0])
        tally.counts = dict(zip(COUNTED, running[2:].tolist(), strict=False))
        tally.refused = [int(count) for count in running[2 + len(COUNTED) :]]
        tally.codes = tuple(memories["day_codes"].tolist())
        tally.waits = memories["day_waits"].tolist()
