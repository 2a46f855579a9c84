"""Whether twins did what was acknowledged, no more, and went on so: their operators' history against the evidence."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator
from itertools import groupby, zip_longest
from typing import Any

from tests.nemesis.checker import Document, Evidence
from tests.nemesis.history import Entry, History

CHANGED = {
    "speed_changed": "speed", "controller_changed": "controller", "paused": "state", "continued": "state",
}  # fmt: skip
"""What each event of a change is about."""


def vehicles(history: History, evidence: Evidence) -> Iterator[str]:
    """A vehicle under a key arrived once; one without arrived if that was acknowledged, and no oftener than sent."""
    for twin, events in evidence.events.items():
        added = Counter(event["details"]["start_pressure"] for event in events if event["kind"] == "vehicle_added")
        path = f"/v1/twins/{twin}/vehicles"
        for pressure in _pressures(history, "asked", path):
            if (count := added.pop(pressure, 0)) != 1:
                yield f"a vehicle of {pressure} bar for {twin} was acknowledged and arrived {count} times"
        acknowledged = _pressures(history, "arrived", path)
        for pressure, sent in _pressures(history, "sent", path).items():
            if not acknowledged[pressure] <= (count := added.pop(pressure, 0)) <= sent:
                times = f"sent {sent} times, acknowledged {acknowledged[pressure]} times"
                yield f"a vehicle of {pressure} bar without a key, {times}, arrived at {twin} {count} times"
        for pressure in added:
            yield f"a vehicle of {pressure} bar arrived at {twin}, and nobody sent it"


def _pressures(history: History, what: str, path: str) -> Counter[float]:
    """How often each vehicle for one twin is noted."""
    found = (entry["request"] for entry in history.of(what) if entry["path"] == path)
    return Counter(request["start_pressure_bar"] for request in found)


def obeyed(history: History, evidence: Evidence) -> Iterator[str]:
    """A twin is what was acknowledged last: in that answer, whenever its operator looked, and in the end."""
    stands: dict[str, Document | None] = {}
    for entry in history.of("obeyed", "looked"):
        twin = entry["twin"]
        if entry["what"] == "obeyed":
            stands[twin] = None if entry["wants"] is None else (stands.get(twin) or {}) | entry["wants"]
        if (shown := _shown(entry)) is not None:
            yield from _other(f"{twin}, {entry['what']} at {entry['at']:g} s,", stands.get(twin), *shown)
    for twin, found in evidence.twins.items():
        yield from _other(f"{twin}, in the end,", stands.get(twin), found)


def _shown(entry: Entry) -> tuple[Document | None] | None:
    """What an entry says of a twin; None if it says nothing."""
    if entry["what"] == "looked":
        return (entry["shown"],)
    return (json.loads(entry["body"]),) if entry.get("body") and entry["wants"] is not None else None


def _other(when: str, wanted: Document | None, shown: Document | None) -> Iterator[str]:
    if wanted is None or shown is None:
        if wanted is not None:
            yield f"{when} is lost"
        elif shown is not None:
            yield f"{when} is {shown['state']}, and should not be there"
        return
    for name, value in wanted.items():
        if shown[name] != value:
            yield f"{when} has {name} {shown[name]}; {value} was acknowledged"


def announced(history: History, evidence: Evidence) -> Iterator[str]:
    """Each change that was acknowledged is an event, in the order of asking; there are no others, but for retries."""
    for twin, events in evidence.events.items():
        entries = [entry for entry in history.of("obeyed") if entry["twin"] == twin]
        wanted = [next(iter(entry["wants"].items())) for entry in entries if len(entry["wants"]) == 1]
        changes = [change for change in wanted if change != ("state", "stopped")]
        told = [change for change, _ in groupby(_change(event) for event in events if event["kind"] in CHANGED)]
        for place, (change, event) in enumerate(zip_longest(changes, told)):
            if change != event:
                yield f"{twin}: its change {place} was acknowledged as {change} and is told as {event}"
                break


def _change(event: Document) -> tuple[str, Any]:
    """What an event says has changed, as its operator notes it."""
    name = CHANGED[event["kind"]]
    if name == "state":
        return name, "paused" if event["kind"] == "paused" else "running"
    return name, event["details"][name]
