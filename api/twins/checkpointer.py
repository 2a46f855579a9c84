"""The thread that stores checkpoints of twins: one transaction each, in order, again if the store fails."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from api.packing import Basis
from api.store.database import StoreError
from api.store.records import Checkpoint, Superseded
from api.store.twins import TwinRepository
from api.twins.segments import encode

log = logging.getLogger(__name__)

RETRY_S = 1.0
"""A store that failed is tried again after this long [s]."""

STALL_S, CLOSING_MAX_S = 2.0, 6.0
"""A store that stores nothing for the first, or not everything in the second, is not waited for on closing [s]."""

TRIES_MAX = 5
"""So often a checkpoint is tried whose failure is not the database's: others wait behind it."""


class Segment:
    """Rows from `first` on that go into one stored file; the twin appends, the checkpointer reads."""

    def __init__(self, first: int, basis: Basis, layout: str) -> None:
        self.first = first
        self.basis = basis
        self.layout = layout
        self.rows: list[tuple[float, ...]] = []
        self.saved = 0

    @property
    def end(self) -> int:
        """Number behind the last row."""
        return self.first + len(self.rows)


@dataclass(frozen=True)
class PendingCheckpoint:
    """A checkpoint that is not stored yet; its rows are not encoded."""

    twin: str
    epoch: int
    checkpoint: Checkpoint
    segment: Segment
    saved: Callable[[Checkpoint], None]
    superseded: Callable[[], None]
    urgent: bool = False  # a request waits until it is stored
    since: float = field(default_factory=time.monotonic)  # when it, or the one whose place it took, began to wait [s]


class Checkpointer:
    """Stores checkpoints in the order they came; a twin never waits for the store."""

    def __init__(self, store: TwinRepository) -> None:
        import pyarrow.parquet  # noqa: F401  # before there are twins: its import holds the interpreter for 0.2 s

        self._store = store
        self._drafts: deque[PendingCheckpoint] = deque()
        self._saving: PendingCheckpoint | None = None  # is being stored right now
        self._changed = threading.Condition()
        self._closing = False
        self._last_try = False  # what is being stored was begun while closing
        self._thread = threading.Thread(target=self._run, name="checkpointer", daemon=True)
        self._thread.start()

    def keep(self, draft: PendingCheckpoint) -> None:
        """Store this, soon. It takes the place of the last that waits with fewer rows of the same segment."""
        with self._changed:
            places = [n for n, waiting in enumerate(self._drafts) if waiting.segment is draft.segment]
            place = places[-1] if places else None
            if place is None or self._drafts[place] is self._saving:
                self._drafts.append(draft)
            else:
                before = self._drafts[place]
                events = (*before.checkpoint.events, *draft.checkpoint.events)
                checkpoint = replace(draft.checkpoint, events=events)
                self._drafts[place] = replace(draft, checkpoint=checkpoint, since=before.since)
            self._changed.notify_all()

    def forget(self, twin: str) -> None:
        """Drop what waits of a twin that has ended; returns when nothing of it is being stored."""
        with self._changed:
            while self._saving is not None and self._saving.twin == twin:
                self._changed.wait()
            self._drafts = deque(draft for draft in self._drafts if draft.twin != twin)
            self._changed.notify_all()

    @property
    def behind(self) -> int:
        """Drafts waiting."""
        return len(self._drafts)

    @property
    def lag(self) -> float:
        """How long the oldest draft has waited [s]."""
        with self._changed:
            return time.monotonic() - self._drafts[0].since if self._drafts else 0.0

    def close(self) -> None:
        """Store what is waiting, then end; earlier where nothing is stored for STALL_S, or CLOSING_MAX_S are over."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        until, waiting = time.monotonic() + CLOSING_MAX_S, math.inf
        while self._thread.is_alive() and time.monotonic() < until and self.behind < waiting:
            waiting = self.behind
            self._thread.join(STALL_S)

    def _run(self) -> None:
        tries = 0
        while (draft := self._next()) is not None:
            try:
                self._save(draft)
            except StoreError as error:
                log.warning("twin %s waits for the store: %s", draft.twin, error)
                again = True
            except Exception:
                tries += 1
                again = tries < TRIES_MAX
                log.exception("twin %s: a checkpoint %s", draft.twin, "is tried again" if again else "is lost")
            else:
                again = False
            tries = tries if again else 0
            if not self._done(again=again):
                return

    def _next(self) -> PendingCheckpoint | None:
        """The next draft to store; None when the checkpointer closes and none is left."""
        with self._changed:
            while not self._drafts:
                if self._closing:
                    return None
                self._changed.wait()
            self._saving, self._last_try = self._first(), self._closing
            return self._saving

    def _first(self) -> PendingCheckpoint:
        """The checkpoint that is stored next: of a twin that a request waits for, if there is one; else the oldest.

        Twins as fast as possible keep the checkpointer busy for seconds, for which no other twin should wait.
        """
        asked = {draft.twin for draft in self._drafts if draft.urgent}
        return next((draft for draft in self._drafts if draft.twin in asked), self._drafts[0])

    def _done(self, *, again: bool) -> bool:
        """Take the first draft from the queue, or wait before it is tried again; False if it failed on closing.

        A try that had begun before is followed by one more: what kept the store from it may be over.
        """
        with self._changed:
            (saved, self._saving), last = (self._saving, None), self._last_try
            if not again:
                self._drafts = deque(draft for draft in self._drafts if draft is not saved)
            self._changed.notify_all()
            if again and not last:
                self._changed.wait_for(lambda: self._closing, RETRY_S)
            return not (again and last)

    def _save(self, draft: PendingCheckpoint) -> None:
        given, segment = draft.checkpoint, draft.segment
        rows = segment.rows[: given.rows]
        blob = encode(rows, segment.basis, segment.layout) if given.rows > segment.saved else None
        checkpoint = replace(given, segment=blob)
        try:
            self._store.save(draft.twin, draft.epoch, checkpoint)
        except Superseded:
            draft.superseded()
            return
        segment.saved = given.rows
        draft.saved(checkpoint)
