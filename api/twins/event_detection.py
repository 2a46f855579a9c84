"""Events of a second, detected from its row and the row before."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from api.twins.messages import COLUMNS, EventKind
from station import Limit, Status
from station.geometry import VALVES
from station.live import Second
from station.metrics import state_of_charge
from station.run import PERIOD

_PLACES = {name: place for place, name in enumerate(COLUMNS)}
_VALVES = [_PLACES[name] for name in VALVES]
_REFUSED = [_PLACES[f"refused_{name}"] for name in VALVES]
_TIME, _STATUS, _PRESSURE = (_PLACES[name] for name in ("time", "decision_status", "pressure_vehicle"))

EventDraft = tuple[float, EventKind, dict[str, Any]]
"""Simulated time [s], kind, details."""


class EventDetector:
    """Turns seconds into events."""

    def __init__(self, plant: str) -> None:
        self._plant = plant
        self._open: list[str] = []
        self._refused: dict[str, str] = {}

    def watch(self, second: Second, wait: float | None) -> Iterator[EventDraft]:
        """The events of a second, in the order in which they happened; `wait` is that of a vehicle it connected [s]."""
        row = second.row
        time = row[_TIME]
        for vehicle in second.arrived:
            yield time, EventKind.ARRIVAL, {"vehicle": vehicle}
        if second.connected >= 0:
            details = {"vehicle": second.connected, "waited_s": wait, "pressure_bar": row[_PRESSURE]}
            yield time, EventKind.FILL_START, details
        if row[_STATUS] == Status.FALLBACK:
            yield time, EventKind.DEADLINE_MISSED, {"decided": "logic"}
        yield from self._valves(time, row)
        if second.left >= 0:
            figures = second.figures
            left, full = time + PERIOD, not math.isnan(figures["finished"])
            details = {
                "vehicle": second.left,
                "waited_s": figures["connected"] - figures["arrival"],
                "duration_s": left - figures["connected"],
                "pressure_bar": figures["final_pressure"],
                "delivered_kg": figures["delivered"] / 1000,
                "state_of_charge": state_of_charge(figures, self._plant),
            }
            if not full:
                details["finish_pressure_bar"] = figures["finish_pressure"]
            yield left, EventKind.FILL_END if full else EventKind.FILL_INCOMPLETE, details

    def _valves(self, time: float, row: tuple[float, ...]) -> Iterator[EventDraft]:
        refused = {
            valve: Limit(int(row[place])).name.lower()
            for valve, place in zip(VALVES, _REFUSED, strict=True)
            if row[place]
        }
        if refused and refused != self._refused:
            yield time, EventKind.SHIELD_REFUSAL, {"refused": refused}
        self._refused = refused
        opened = [valve for valve, place in zip(VALVES, _VALVES, strict=True) if row[place]]
        if opened != self._open:
            details = {
                "opened": [valve for valve in opened if valve not in self._open],
                "closed": [valve for valve in self._open if valve not in opened],
            }
            yield time, EventKind.VALVE_CHANGE, details
        self._open = opened

    def resume(self, row: tuple[float, ...]) -> None:
        """Go on behind this row: what was open then is no news."""
        if not math.isnan(row[_TIME]):
            for _ in self._valves(row[_TIME], row):
                pass
