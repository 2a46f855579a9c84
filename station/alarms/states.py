"""The life of one alarm: the states of ISA-18.2, and what leads from one to another."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from station.alarm_rules import AlarmRule


class AlarmState(StrEnum):
    """The state of an alarm, by ISA-18.2 (2016), figure 3."""

    NORMAL = "normal"
    UNACKNOWLEDGED = "unacknowledged"
    ACKNOWLEDGED = "acknowledged"
    RETURNED = "returned_unacknowledged"  # the condition is over, and nobody has acknowledged it
    SHELVED = "shelved"  # put aside by somebody, until a time
    SUPPRESSED = "suppressed_by_design"  # the consequence of another alarm
    OUT_OF_SERVICE = "out_of_service"  # put aside by somebody, until somebody puts it back


ANNOUNCED = (AlarmState.UNACKNOWLEDGED, AlarmState.ACKNOWLEDGED, AlarmState.RETURNED)
"""States in which an alarm is shown to who operates the station."""


@dataclass
class Alarm:
    """An alarm and where it stands. Times are those of the twin [s]."""

    rule: AlarmRule
    active: bool = False  # its condition holds, delays counted
    pending: bool = False  # it was announced, and nobody has acknowledged it since
    suppressed: bool = False  # an alarm holds of which it is a consequence
    shelved_until: float | None = None
    out_of_service: bool = False
    raised: float | None = None  # when its condition began last
    ended: float | None = None  # when it ended last
    value: float = math.nan  # of the signal when its condition began or ended last
    by: str = ""  # who acknowledged it, shelved it or took it out of service last
    reason: str = ""
    told: AlarmState = field(default=AlarmState.NORMAL)

    @property
    def state(self) -> AlarmState:
        """The state."""
        if self.out_of_service:
            return AlarmState.OUT_OF_SERVICE
        if self.shelved_until is not None:
            return AlarmState.SHELVED
        if self.active and self.suppressed:
            return AlarmState.SUPPRESSED
        if self.active:
            return AlarmState.UNACKNOWLEDGED if self.pending else AlarmState.ACKNOWLEDGED
        return AlarmState.RETURNED if self.pending else AlarmState.NORMAL

    @property
    def is_aside(self) -> bool:
        """Whether its condition is announced to nobody."""
        return self.out_of_service or self.shelved_until is not None or self.suppressed

    @property
    def is_fresh(self) -> bool:
        """Whether nothing has ever happened to it."""
        return self.raised is None and not self.by and not self.suppressed

    def begin(self, time: float, value: float) -> None:
        """Its condition begins."""
        self.active, self.raised, self.ended, self.value = True, time, None, value
        self.pending = not self.is_aside

    def end(self, time: float, value: float) -> None:
        """Its condition ends."""
        self.active, self.ended, self.value = False, time, value
        if self.is_aside:
            self.pending = False

    def aside(self) -> None:
        """It is announced to nobody from now on."""
        self.pending = False

    def back(self) -> None:
        """It is announced again; where its condition holds, as if that had just begun."""
        self.pending = self.active and not self.is_aside

    def kept(self) -> dict[str, Any]:
        """Its entry in a snapshot, as JSON; NaN as null."""
        found = {name: getattr(self, name) for name in _KEPT}
        return {**found, "value": None if math.isnan(self.value) else self.value, "told": str(self.told)}

    def resume(self, kept: dict[str, Any]) -> None:
        """Go on from what was kept."""
        for name in _KEPT:
            setattr(self, name, kept[name])
        self.value = math.nan if kept["value"] is None else float(kept["value"])
        self.told = AlarmState(kept["told"])


_KEPT = ("active", "pending", "suppressed", "shelved_until", "out_of_service", "raised", "ended", "by", "reason")
