"""What the twins of a server are and have told: from memory where they live, from the store otherwise."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from api.figures import Selection, selected
from api.paging import FAR, Page
from api.problems import not_found
from api.runs.schemas import moment
from api.store.records import StoredTwin
from api.store.twins import TwinRepository
from api.twins.feed import CERTIFIED, COLUMNS, UNCERTIFIED, Sample
from api.twins.live import LiveTwin
from api.twins.schemas import ALIVE, CHANGEABLE, TwinState, TwinStateName
from api.twins.segments import columns_of, decode, stored_columns
from station import InputError, Scenario


class TwinReader:
    """Live twins and those that have ended, to be read by id."""

    def __init__(self, store: TwinRepository) -> None:
        self._store = store
        self._live: dict[str, LiveTwin] = {}

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

    def states(self) -> dict[str, int]:
        """How many twins are in each state."""
        stored = self._store.states() | {twin.id: str(twin.state) for twin in list(self._live.values())}
        return {name: list(stored.values()).count(name) for name in TwinStateName}

    def list(self) -> Sequence[TwinState]:
        """Every twin, the oldest first; those that have ended without their last sample."""
        return [self._shown(stored, whole=False) for stored in self._store.all()]

    def page(self, page: Page) -> tuple[Sequence[TwinState], str | None]:
        """The twins of a page, as in `list`, and the cursor behind them."""
        found, cursor = page.turn(
            self._store.page(page.behind(float, str), page.limit + 1), lambda stored: (stored.created, stored.id)
        )
        return [self._shown(stored, whole=False) for stored in found], cursor

    def state(self, twin_id: str) -> TwinState:
        """A twin and where it stands; a problem if there is none."""
        return self._shown(self._stored(twin_id), whole=True)

    def scenario(self, twin_id: str) -> Scenario:
        """The scenario a twin runs, with every parameter of its station."""
        return Scenario.model_validate(self._stored(twin_id).settings["scenario"])

    def _stored(self, twin_id: str) -> StoredTwin:
        stored = self._store.get(twin_id)
        if stored is None:
            raise not_found("twin", twin_id)
        return stored

    def _shown(self, stored: StoredTwin, *, whole: bool) -> TwinState:
        live = self._live.get(stored.id)
        current = self.current(stored.id) if live or (whole and stored.samples) else None
        return self._state(stored, live, current)

    @staticmethod
    def _state(stored: StoredTwin, live: LiveTwin | None, current: Sample | None) -> TwinState:
        settings = stored.settings
        if live:
            settings = {**settings, **live.request.model_dump(include=CHANGEABLE)}
        created = moment(stored.created)
        return TwinState(
            id=stored.id,
            state=live.state if live else TwinStateName(stored.state),
            scenario=settings["scenario"]["name"],
            station=settings["scenario"]["station"]["name"],
            service=CERTIFIED if settings.get("certificate") else UNCERTIFIED,
            **{name: settings[name] for name in ("controller", "speed", "at_end", "replication", "seed")},
            epoch=live.epoch if live else stored.epoch,
            samples=max(stored.samples, current.seq + 1 if current else 0),
            events=max(stored.events, live.told.events if live else 0),
            created=created.isoformat() if created else "",
            values=current.document()["values"] if current else None,
            ticks_late=live.ticks_late if live else 0,
            lateness_max_s=live.lateness_max_s if live else 0.0,
        )

    def current(self, twin_id: str) -> Sample | None:
        """The newest sample; of a twin that is not live here, the last one stored."""
        live = self._live.get(twin_id)
        if live is not None and live.current is not None:
            return live.current
        stored = self._stored(twin_id)
        found = self.history(twin_id, max(0, stored.samples - 1), 1)
        return found[0] if found else None

    def history(self, twin_id: str, first: int, limit: int) -> Sequence[Sample]:
        """At most `limit` samples from number `first` on; old ones may be gone by the settings' retention.

        Their `sent` is None.
        """
        live = self._live.get(twin_id)
        memory_first, memory = live.told.rows_from(first) if live else (FAR, [])
        self._stored(twin_id)
        end = first + limit
        rows = {
            number: Sample(twin_id, epoch, number, None, row)
            for segment_first, epoch, blob in self._segments(twin_id, first, min(end, memory_first) - 1)
            for number, row in enumerate(decode(blob), segment_first)
            if first <= number < min(end, memory_first)
        }
        for number, row in enumerate(memory[: max(0, end - memory_first)], memory_first):
            rows[number] = Sample(twin_id, live.epoch if live else 0, number, None, row)
        return [rows[number] for number in sorted(rows)]

    def samples(self, twin_id: str) -> int:
        """How many samples a twin has told."""
        live = self._live.get(twin_id)
        return live.told.rows if live else self._stored(twin_id).samples

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
        self._stored(twin_id)
        unknown = [name for name in chosen.columns if name not in COLUMNS]
        if unknown:
            raise InputError(
                "query", [("columns", f"no column is called {unknown[0]!r:.60}; there are {', '.join(COLUMNS)}")]
            )
        first, last = int(chosen.start), FAR if np.isinf(chosen.end) else int(chosen.end)
        live = self._live.get(twin_id)
        memory_first, memory = live.told.rows_from(first) if live else (FAR, [])
        wanted = list(dict.fromkeys(("time", *chosen.columns))) if chosen.columns else list(COLUMNS)
        parts = []
        for segment_first, _, blob in self._segments(twin_id, first, min(last, memory_first - 1)):
            part = stored_columns(blob, wanted)
            parts.append({name: part[name][: max(0, memory_first - segment_first)] for name in wanted})
        parts.append(columns_of(memory[: max(0, last + 1 - memory_first)], wanted))
        return selected({name: np.concatenate([part[name] for part in parts]) for name in wanted}, chosen)

    def events(self, twin_id: str, after: int, limit: int) -> Sequence[dict[str, Any]]:
        """Documents of at most `limit` events behind number `after`."""
        live = self._live.get(twin_id)
        memory = [event.document() for event in live.told.events_in_memory()] if live else []
        self._stored(twin_id)
        stored = self._store.events(twin_id, after, limit)
        known = {event["seq"] for event in stored}
        more = [event for event in memory if event["seq"] > after and event["seq"] not in known]
        return [*stored, *more][:limit]
