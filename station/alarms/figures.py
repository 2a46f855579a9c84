"""The alarm system's own figures: how often it speaks, and which alarms stand, chatter or come most (EEMUA 191)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from station.alarms.states import ANNOUNCED, Alarm

RAISES_MAX = 5_000
"""Begins that are remembered."""

DAY = 86_400.0
"""Figures are of so long [s]."""

STANDING = DAY
"""An alarm that has been active for so long stands [s]."""

CHATTERS, MINUTE = 3, 60.0
"""One that begins so often within a minute chatters [1, s]."""

FLOOD, FLOOD_S = 10, 600.0
"""More than so many begins within ten minutes are a flood [1, s]."""

FREQUENT = 10
"""So many of the most frequent are named."""


@dataclass(frozen=True)
class AlarmFigures:
    """Figures of the last day, or since the beginning where that is shorter."""

    duration: float  # [s] that they are of
    begun: int  # alarms announced
    per_hour: float  # [1/h]
    most_in_ten_minutes: int
    flooded: bool  # more than FLOOD of them
    announced: int  # alarms that are shown now
    unacknowledged: int
    acknowledged_in: float | None  # median time from a begin to its acknowledgement [s]; None: none was
    standing: tuple[str, ...]
    chattering: tuple[str, ...]
    frequent: tuple[tuple[str, int], ...]


def alarm_figures(
    alarms: Sequence[Alarm], raises: Collection[tuple[float, int]], delays: Collection[float], begun: float, now: float
) -> AlarmFigures:
    """Figures at a time [s] of alarms that have begun at `raises`, (time [s], place among `alarms`)."""
    recent = [(time, k) for time, k in raises if time > now - DAY]
    duration = min(DAY, max(now - begun, 0.0))
    counts = Counter(k for _, k in recent)
    times: dict[int, list[float]] = {}
    for time, k in recent:
        times.setdefault(k, []).append(time)
    most = max((_within(moments, FLOOD_S) for moments in [[time for time, _ in recent]] if moments), default=0)
    ordered = sorted(delays)
    return AlarmFigures(
        duration=duration,
        begun=len(recent),
        per_hour=3600 * len(recent) / duration if duration > 0 else 0.0,
        most_in_ten_minutes=most,
        flooded=most > FLOOD,
        announced=sum(alarm.state in ANNOUNCED for alarm in alarms),
        unacknowledged=sum(alarm.pending for alarm in alarms),
        acknowledged_in=ordered[len(ordered) // 2] if ordered else None,
        standing=tuple(
            alarm.rule.name
            for alarm in alarms
            if alarm.active and alarm.raised is not None and now - alarm.raised >= STANDING
        ),
        chattering=tuple(alarms[k].rule.name for k in sorted(times) if _within(times[k], MINUTE) >= CHATTERS),
        frequent=tuple((alarms[k].rule.name, count) for k, count in counts.most_common(FREQUENT)),
    )


def _within(times: Sequence[float], span: float) -> int:
    """The most of these times, in order, that lie within a span [s]."""
    most = first = 0
    for last, time in enumerate(times):
        while time - times[first] > span:
            first += 1
        most = max(most, last - first + 1)
    return most
