"""Queries about the twins of a server: from memory where they live, from the store otherwise."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from api.http.pagination import FAR, Page
from api.http.problems import conflict, not_found
from api.http.timeseries import Selection, selected
from api.store.database import StoreError
from api.store.records import StoredTwin
from api.store.twins import TwinRepository
from api.twins.alarm_schemas import AlarmSystemFigures, TwinAlarm, TwinAlarms
from api.twins.days import Days, document
from api.twins.live import LiveTwin
from api.twins.messages import Sample, is_measured
from api.twins.minutes import MINUTE_S, RESOLUTION, asked_columns, minutes
from api.twins.schemas import ALIVE, Source, TwinRequest, TwinStateName
from api.twins.segments import columns_of, decode, stored_columns
from api.twins.shown import layout_of, settings_now, state_of
from api.twins.state_schemas import TwinPage, TwinState
from station import InputError, Scenario
from station.alarms.states import AlarmState
from station.live import LiveRun
from station.measurement import TagMap


class TwinQueries:
    """Live twins and those that have ended, to be read by id."""

    def __init__(self, store: TwinRepository) -> None:
        self._store = store
        self._live: dict[str, LiveTwin] = {}
        self._elsewhere: set[str] = set()  # taken over by another server since they lived here

    def known(self, twin_id: str) -> bool:
        """Whether this server has, or had, a twin of that id."""
        return twin_id in self._live or self._store.get(twin_id) is not None

    def live(self, twin_id: str) -> LiveTwin | None:
        """The twin, if it runs or stands still here."""
        twin = self._live.get(twin_id)
        return twin if twin is not None and twin.state in ALIVE else None

    def running(self, twin_id: str) -> LiveTwin | None:
        """The twin, as long as its thread may tell something."""
        twin = self._live.get(twin_id)
        return twin if twin is not None and twin.alive else None

    def begun(self, twin_id: str) -> bool:
        """Whether the twin has told here where its epoch begins; it may have ended since."""
        twin = self._live.get(twin_id)
        return twin is not None and twin.begun

    def ids(self) -> list[str]:
        """Ids of the twins that are live here."""
        return [twin.id for twin in list(self._live.values()) if twin.state in ALIVE]

    def shadowed(self) -> list[LiveTwin]:
        """The twins here that have stretches which are over and not taken; some may have ended since."""
        return [twin for twin in list(self._live.values()) if twin.shadow.due and twin.here]

    def states(self, stored: Mapping[str, str]) -> dict[str, int]:
        """How many twins are in each state: those that live, and of the others what was `stored` by id."""
        states = [*({**stored} | {twin.id: str(twin.state) for twin in list(self._live.values())}).values()]
        return {name: states.count(name) for name in TwinStateName}

    def every(self) -> Sequence[TwinState]:
        """Every twin, the oldest first; those that have ended without their last sample."""
        return [self._shown(stored, whole=False) for stored in self._store.all()]

    def page(self, page: Page) -> TwinPage:
        """The twins of a page, as in `every`; while the store does not answer those that live here."""
        behind = page.behind(float, str)
        try:
            found, complete = self._store.page(behind, page.limit + 1), True
        except StoreError:
            found, complete = self._remembered(behind)[: page.limit + 1], False
        shown, cursor = page.turn(found, _place)
        items = [self._shown(stored, whole=False) for stored in shown]
        return TwinPage(items=items, next=cursor, complete=complete)

    def _remembered(self, behind: tuple[Any, ...] | None) -> list[StoredTwin]:
        """The twins in memory, the oldest first."""
        known = sorted((twin.stored for twin in list(self._live.values()) if twin.here), key=_place)
        return [stored for stored in known if behind is None or _place(stored) > behind]

    def state(self, twin_id: str) -> TwinState:
        """A twin and where it stands; a problem if there is none."""
        return self._shown(self._stored(twin_id), whole=True)

    def scenario(self, twin_id: str) -> Scenario:
        """The scenario a twin runs, with every parameter of the station that it has now."""
        settings = self._now(twin_id)
        given = settings["scenario"]
        if settings.get("drills"):
            given = {**given, "faults": [*given.get("faults", []), *settings["drills"]]}
        if settings.get("station") is not None:
            given = {**given, "station": settings["station"]}
        return Scenario.model_validate(given)

    def tags(self, twin_id: str) -> TagMap:
        """What the tags of a measured twin are; a conflict where it measures nothing."""
        settings = self._stored(twin_id).settings
        if settings.get("source") != Source.MEASURED:
            raise conflict(f"twin {twin_id!r} is {settings.get('source', Source.SIMULATED)}: it measures nothing")
        return TagMap.model_validate(settings["tags"])

    def station_seq(self, twin_id: str) -> int:
        """Number of the first second of what a measured twin estimates now: with its station, by clocks put right."""
        return int(self._now(twin_id).get("station_seq", 0))

    def clocks_seq(self, twin_id: str) -> int:
        """Number of the first second whose readings a measured twin has by clocks put right."""
        return int(self._now(twin_id).get("clocks_seq", 0))

    def _now(self, twin_id: str) -> dict[str, Any]:
        """The settings of a twin as they are now."""
        return settings_now(self._stored(twin_id), self._live.get(twin_id))

    def request_of(self, twin_id: str) -> TwinRequest:
        """A twin as it was asked for, with what was changed since; a problem if there is none."""
        return TwinRequest.model_validate(self._now(twin_id))

    def layout(self, twin_id: str) -> str:
        """The layout of a twin's samples."""
        return layout_of(self._stored(twin_id))

    def created(self, twin_id: str) -> float:
        """When a twin was started [s, Unix time]."""
        return self._stored(twin_id).created

    def measures(self, twin_id: str) -> bool:
        """Whether a twin follows measurements."""
        return is_measured(layout_of(self._stored(twin_id)))

    def remembers(self, twin_id: str) -> bool:
        """Whether a twin's state is in memory."""
        live = self._live.get(twin_id)
        return live is not None and live.here

    def remembers_from(self, twin_id: str, first: int) -> bool:
        """Whether all that a twin has told from sample `first` on is in memory."""
        live = self._live.get(twin_id)
        return live is not None and live.here and live.journal.rows_from(first)[0] <= first

    def _stored(self, twin_id: str) -> StoredTwin:
        live = self._live.get(twin_id)
        if live is not None and live.here:
            return live.stored
        stored = self._store.get(twin_id)
        if stored is None:
            raise not_found("twin", twin_id)
        return stored

    def _shown(self, stored: StoredTwin, *, whole: bool) -> TwinState:
        live = self._live.get(stored.id)
        current = self.current(stored.id) if live or (whole and stored.samples) else None
        return state_of(stored, live, current)

    def current(self, twin_id: str) -> Sample | None:
        """The newest sample; of a twin that is not live here, the last one stored."""
        live = self._live.get(twin_id)
        if live is not None and live.last is not None:
            return live.last
        stored = self._stored(twin_id)
        found = self.history(twin_id, max(0, stored.samples - 1), 1)
        return found[0] if found else None

    def history(self, twin_id: str, first: int, limit: int) -> Sequence[Sample]:
        """At most `limit` samples from number `first` on, or from the first behind it that is kept whole.

        Old ones may be gone, or kept as minutes, by the settings' retention.
        """
        live = self._live.get(twin_id)
        memory_first, memory = live.journal.rows_from(first) if live else (FAR, [])
        layout = layout_of(self._stored(twin_id))
        end = first + limit
        rows = {
            number: _sample(twin_id, epoch, number, row, layout)
            for segment_first, epoch, blob in self._segments(twin_id, first, min(end, memory_first) - 1)
            for number, row in enumerate(decode(blob, layout), segment_first)
            if first <= number < min(end, memory_first)
        }
        for number, row in enumerate(memory[: max(0, end - memory_first)], memory_first):
            rows[number] = _sample(twin_id, live.epoch if live else 0, number, row, layout)
        if not rows and first < memory_first:
            kept = self._store.first_kept(twin_id, first)
            later = min(memory_first, FAR if kept is None else kept)
            return self.history(twin_id, later, limit) if first < later < FAR else []
        return [rows[number] for number in sorted(rows)]

    def alarms(self, twin_id: str, *, every: bool = False) -> TwinAlarms:
        """The alarms of a live twin: those that are shown, or that somebody has put aside, or every one.

        A replay, and a twin that has ended, have none.
        """
        self._stored(twin_id)
        live = self.live(twin_id)
        if live is None or live.alarms is None:
            return TwinAlarms(twin=twin_id, items=[], figures=None)
        found = [alarm for alarm in live.alarms.ordered if every or alarm.state is not AlarmState.NORMAL]
        figures = AlarmSystemFigures.of(live.alarms.figures())
        return TwinAlarms(twin=twin_id, items=[TwinAlarm.of(alarm) for alarm in found], figures=figures)

    def days(self, twin_id: str) -> Sequence[dict[str, Any]]:
        """Figures of a twin's past days and the running one, as `api.twins.days.document` writes them."""
        live = self._live.get(twin_id)
        if self._stored(twin_id).settings.get("source", Source.SIMULATED) != Source.SIMULATED:
            return []  # what was spent is not measured, and a replay has days of another
        found = live.days if live else self._stored_days(twin_id)
        return [document(figures) for figures in found.figures()]

    def _stored_days(self, twin_id: str) -> Days:
        """The days of a twin that does not live here, from its last snapshot."""
        request = TwinRequest.model_validate(self._stored(twin_id).settings)
        days = Days(request.scenario)
        snapshot = self._store.snapshot(twin_id)
        if snapshot:
            run = LiveRun(request.scenario, request.at_end, request.replication, request.seed)
            memories = run.restore(snapshot)
            days.resume(memories, run.seq - run.over)  # the last row of a run that is over is no second
        return days

    def record_end(self, twin_id: str) -> tuple[int, tuple[float, ...]]:
        """How many seconds a twin has told, and the masses of the buffers behind the last [g]; () where not known."""
        live = self._live.get(twin_id)
        if self._stored(twin_id).settings.get("source", Source.SIMULATED) != Source.SIMULATED:
            return self.samples(twin_id), ()
        return (live.days if live else self._stored_days(twin_id)).end()

    def samples(self, twin_id: str) -> int:
        """The number of samples of a twin."""
        live = self._live.get(twin_id)
        return live.journal.rows if live else self._stored(twin_id).samples

    def whole_from(self, twin_id: str) -> int:
        """Number of the first sample from which on every one is kept; of older ones minutes are left, or nothing."""
        live = self._live.get(twin_id)
        kept = self._store.first_kept(twin_id, 0)
        begin = self.samples(twin_id) if live is None else live.journal.rows_from(0)[0]
        return begin if kept is None else min(begin, kept)

    def thinned_to(self, twin_id: str) -> int:
        """Number of the first sample that is kept whole, where older ones are kept as minutes; else 0."""
        return self._store.thinned_to(twin_id)

    def epochs(self, twin_id: str) -> dict[int, int]:
        """First sample of each epoch: what an earlier epoch told from there on does not count."""
        live = self._live.get(twin_id)
        return self._store.epochs(twin_id) | ({live.epoch: live.first} if live else {})

    def told_since(self, twin_id: str, epoch: int) -> tuple[int, int]:
        """The first sample and the first event that a twin has told in later epochs than this one."""
        live = self._live.get(twin_id)
        stored = self._store.first_event(twin_id, epoch)
        events = [number for number in (stored, live.first_event if live else None) if number is not None]
        samples = [first for later, first in self.epochs(twin_id).items() if later > epoch]
        return min(samples, default=FAR), min(events, default=FAR)

    def _segments(self, twin_id: str, first: int, last: int) -> Sequence[tuple[int, int, bytes]]:
        return self._store.segments(twin_id, first, last) if last >= first else ()

    def columns(self, twin_id: str, chosen: Selection) -> dict[str, np.ndarray]:
        """The part of a twin's history that was chosen, as columns; a second is a row, row k begins at k s."""
        layout = layout_of(self._stored(twin_id))
        known = asked_columns(layout)
        unknown = [name for name in chosen.columns if name not in known]
        if unknown:
            raise InputError(
                "query", [("columns", f"no column is called {unknown[0]!r:.60}; there are {', '.join(known)}")]
            )
        first, last = int(chosen.start), FAR if np.isinf(chosen.end) else int(chosen.end)
        live = self._live.get(twin_id)
        memory_first, memory = live.journal.rows_from(first) if live else (FAR, [])
        wanted = list(dict.fromkeys(("time", *chosen.columns))) if chosen.columns else list(known)
        told = [name for name in wanted if name != RESOLUTION]
        parts: list[dict[str, np.ndarray]] = []
        stored_to = min(last, memory_first - 1)
        thin, full = self._store.parts(twin_id, first, stored_to) if stored_to >= first else ((), ())
        for _, _, blob in thin:
            parts.append(minutes(blob, wanted, chosen.fold, first - int(MINUTE_S) + 1, last))
        for segment_first, _, blob in full:
            part = stored_columns(blob, told)
            part[RESOLUTION] = np.ones(len(part["time"]))
            parts.append({name: part[name][: max(0, memory_first - segment_first)] for name in wanted})
        part = columns_of(memory[: max(0, last + 1 - memory_first)], layout, told)
        parts.append({**part, RESOLUTION: np.ones(len(part["time"]))})
        return selected({name: np.concatenate([part[name] for part in parts]) for name in wanted}, chosen)

    def units(self, twin_id: str) -> dict[str, str]:
        """Name and unit of every column of a twin's history."""
        return asked_columns(layout_of(self._stored(twin_id)))

    def events(
        self, twin_id: str, after: int, limit: int, kinds: Collection[str] = ()
    ) -> Sequence[dict[str, Any]]:  # fmt: skip
        """Documents of at most `limit` events behind number `after`, of some kinds if any is named.

        Numbers of old ones may be missing.
        """
        live = self._live.get(twin_id)
        memory = [event.document() for event in live.journal.events_in_memory()] if live else []
        self._stored(twin_id)
        whole = bool(memory) and memory[0]["seq"] <= after + 1
        stored = [] if whole else self._store.events(twin_id, after, limit, kinds)
        known = {event["seq"] for event in stored}
        more = [event for event in memory if event["seq"] > after and event["seq"] not in known]
        return [*stored, *(event for event in more if not kinds or event["kind"] in kinds)][:limit]

    def event_before(self, twin_id: str, time: float) -> int:
        """Number of an event behind which the first is that happened at a time [s] or later; times grow by number."""
        newest = self.last_events(twin_id, FAR, 1)
        low, high = -1, newest[0]["seq"] if newest else -1
        while low < high:
            middle = (low + high) // 2
            next_one = self.events(twin_id, middle, 1)
            if next_one and next_one[0]["time"] < time:
                low = next_one[0]["seq"]
            else:
                high = middle
        return low

    def last_events(
        self, twin_id: str, before: int, limit: int, kinds: Collection[str] = ()
    ) -> Sequence[dict[str, Any]]:  # fmt: skip
        """Documents of the last events below number `before`, at most `limit`, in order; of some kinds if named."""
        live = self._live.get(twin_id)
        recent = live.journal.events_in_memory() if live else []
        memory = [each.document() for each in recent if each.seq < before and (not kinds or each.kind in kinds)]
        self._stored(twin_id)
        stored = [] if len(memory) >= limit else self._store.last_events(twin_id, before, limit, kinds)
        known = {event["seq"] for event in stored}
        return [*stored, *(event for event in memory if event["seq"] not in known)][-limit:]


def _sample(twin_id: str, epoch: int, number: int, row: tuple[float, ...], layout: str) -> Sample:
    """A row of `history_columns` as a sample."""
    *figures, sent = row
    return Sample(twin_id, epoch, number, None if math.isnan(sent) else sent, tuple(figures), layout=layout)


def _place(stored: StoredTwin) -> tuple[float, str]:
    """The place of a twin in the order of lists."""
    return stored.created, stored.id
