"""Figures of any stretch of a twin's record, whole or by hour, shift or day: what `days` tells, of other seconds."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Collection, Iterator, Sequence
from typing import Any

import numpy as np

from api.twins.day_tally import BY_LIMIT
from api.twins.messages import EventKind, is_measured
from api.twins.queries import TwinQueries
from api.twins.record_parts import parts, powers_of
from api.twins.window_tally import WINDOW_UNITS, WindowTally, window_document
from api.twins.windows import By, Shifts, stretch_of, windows_of

EVENTS_AT_ONCE = 1000
"""Events read at once."""

_SLACK_S = 5.0
"""Events of a second may be told in another order than that of their times, within so much [s]."""

_KINDS = (
    EventKind.ARRIVAL, EventKind.FILL_START, EventKind.FILL_END, EventKind.FILL_INCOMPLETE, EventKind.DAY_END,
)  # fmt: skip


def figures(
    twins: TwinQueries, twin_id: str, from_s: int | None, to_s: int | None, by: By, shifts: Shifts
) -> list[dict[str, Any]]:  # fmt: skip
    """Documents of the windows of a stretch, in order, as `window_document` writes them.

    Raises
    ------
    InputError
        if the record has no such stretch, or it is too long or cut too finely.
    """
    end, stock = twins.record_end(twin_id)  # first: what is told meanwhile is in the record then
    begin = min(twins.epochs(twin_id).values(), default=0)
    windows = windows_of(stretch_of(begin, end, from_s, to_s), by, shifts)
    scenario, layout = twins.scenario(twin_id), twins.layout(twin_id)
    powers, measured = powers_of(layout), is_measured(layout)
    tallies = [WindowTally(scenario, window, powers, measured=measured) for window in windows]
    first, last = windows[0].first, windows[-1].end
    for part in parts(twins, twin_id, max(0, first - 1), last):
        touched = part.time[0], part.time[-1] + part.spans[-1]
        for window, tally in zip(windows, tallies, strict=True):
            if window.end >= touched[0] and window.first <= touched[1]:
                tally.add(part)
    if last == end:
        tallies[-1].end_with(stock)
    told = {(day["from_s"], day["to_s"]): day for day in twins.days(twin_id)}
    firsts = [window.first for window in windows]
    for event in events_within(twins, twin_id, windows[0].first, last, _KINDS):
        if event["kind"] == EventKind.DAY_END:
            told[event["details"]["from_s"], event["details"]["to_s"]] = event["details"]
        place = bisect_right(firsts, event["time"])
        for tally in tallies[max(0, place - 2) : place]:  # what ends a second is of the window before
            tally.event(event)
    return [window_document(tally.figures(), told.get(window)) for window, tally in zip(windows, tallies, strict=True)]


def events_within(
    twins: TwinQueries, twin_id: str, first: float, last: float, kinds: Collection[str]
) -> Iterator[dict[str, Any]]:  # fmt: skip
    """The events of some kinds that happened between two times, both included [s], in order."""
    behind = twins.event_before(twin_id, first - _SLACK_S)
    while found := twins.events(twin_id, behind, EVENTS_AT_ONCE, kinds):
        yield from (event for event in found if first <= event["time"] <= last)
        if found[-1]["time"] > last + _SLACK_S or len(found) < EVENTS_AT_ONCE:
            return
        behind = found[-1]["seq"]


def table_of(items: Sequence[dict[str, Any]]) -> dict[str, np.ndarray]:
    """The windows as columns of `WINDOW_UNITS`, a row each; NaN where a figure is null."""
    refused = [{name: (item["refused"] or {}).get(limit) for name, limit in BY_LIMIT.items()} for item in items]
    plain = [{**item, **more} for item, more in zip(items, refused, strict=True)]
    whole = ("from_s", "to_s", "whole_s")
    return {
        name: np.array([row[name] for row in plain], np.int64 if name in whole else np.float64) for name in WINDOW_UNITS
    }
