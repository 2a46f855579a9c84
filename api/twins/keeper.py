"""The thread that stores what twins tell: one transaction a checkpoint, in order, again if the store fails."""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from api.store.database import StoreError
from api.store.records import Checkpoint, Superseded
from api.store.twins import TwinRepository
from api.twins.segments import encode

log = logging.getLogger(__name__)

RETRY_S = 1.0
"""A store that failed is tried again after this long [s]."""


class Segment:
    """Rows from `first` on that go into one stored file; the twin appends, the keeper reads."""

    def __init__(self, first: int) -> None:
        self.first = first
        self.rows: list[tuple[float, ...]] = []
        self.saved = 0

    @property
    def end(self) -> int:
        """Number behind the last row."""
        return self.first + len(self.rows)


@dataclass(frozen=True)
class Draft:
    """A checkpoint whose rows are not encoded yet."""

    twin: str
    epoch: int
    checkpoint: Checkpoint
    segment: Segment
    saved: Callable[[], None]
    superseded: Callable[[], None]


class Keeper:
    """Stores drafts in the order they came; a twin never waits for the store."""

    def __init__(self, store: TwinRepository) -> None:
        import pyarrow.parquet  # noqa: F401  # before there are twins: its import holds the interpreter for 0.2 s

        self._store = store
        self._drafts: deque[Draft] = deque()
        self._changed = threading.Condition()
        self._closing = False
        self._thread = threading.Thread(target=self._run, name="keeper", daemon=True)
        self._thread.start()

    def keep(self, draft: Draft) -> None:
        """Store this, soon."""
        with self._changed:
            self._drafts.append(draft)
            self._changed.notify()

    @property
    def behind(self) -> int:
        """Drafts waiting."""
        return len(self._drafts)

    def close(self, patience_s: float = 2.0) -> None:
        """Store what is waiting, then end."""
        with self._changed:
            self._closing = True
            self._changed.notify()
        self._thread.join(patience_s)

    def _run(self) -> None:
        while True:
            with self._changed:
                while not self._drafts:
                    if self._closing:
                        return
                    self._changed.wait()
                draft = self._drafts[0]
            try:
                self._save(draft)
            except StoreError as error:
                log.warning("twin %s waits for the store: %s", draft.twin, error)
                with self._changed:
                    if self._closing:
                        return
                    self._changed.wait(RETRY_S)
                continue
            except Exception:
                log.exception("twin %s: a checkpoint is lost", draft.twin)
            self._drafts.popleft()

    def _save(self, draft: Draft) -> None:
        given, segment = draft.checkpoint, draft.segment
        rows = segment.rows[: given.rows]
        blob = encode(rows) if given.rows > segment.saved else None
        checkpoint = Checkpoint(
            given.state, given.changes, given.snapshot, given.first_seq, given.rows, blob, given.events
        )  # fmt: skip
        try:
            self._store.save(draft.twin, draft.epoch, checkpoint)
        except Superseded:
            draft.superseded()
            return
        segment.saved = given.rows
        draft.saved()
