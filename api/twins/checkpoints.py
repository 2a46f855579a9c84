"""Checkpoints of one live twin: when one is due, what goes into it, and who waits until it is stored."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from functools import partial
from typing import Any

from api.http.problems import conflict
from api.store.records import Checkpoint, StoredResponse
from api.twins.checkpointer import Checkpointer, PendingCheckpoint
from api.twins.journal import TwinJournal
from api.twins.schemas import ALIVE, TwinStateName

log = logging.getLogger(__name__)

BEHIND_MAX = 8
"""A twin as fast as possible waits when so many checkpoints are not stored yet."""


class Checkpoints:
    """Hands checkpoints of a twin to the checkpointer.

    The twin's thread makes them; the checkpointer's says which are stored, or that another server has the twin.

    Parameters
    ----------
    twin_id, epoch
        Whose checkpoints: the store takes none of an epoch that has passed.
    checkpointer
        Stores them.
    journal
        The rows and events of the twin.
    period_s
        How often one is due while there is something to store [s].
    on_superseded
        Called when another server has taken the twin over.
    """

    def __init__(
        self, twin_id: str, epoch: int, checkpointer: Checkpointer, journal: TwinJournal, period_s: float,
        on_superseded: Callable[[], None],
    ) -> None:  # fmt: skip
        self._twin_id = twin_id
        self._epoch = epoch
        self._checkpointer = checkpointer
        self._journal = journal
        self.period_s = period_s
        self._on_superseded = on_superseded
        self._stored = -period_s  # when the last was made [s, monotonic]; that a twin begins is stored at once
        self._awaited: dict[
            Future[None], StoredResponse | None
        ] = {}  # commands obeyed that no stored checkpoint has yet
        self.superseded = False  # another server has the twin
        self.end_stored: Future[None] = Future()  # that it has ended for good; done, too, if nobody will store it

    def due(self, *, changed: bool = False) -> bool:
        """Whether it is time for one; `changed` says that there is more to store than what was told."""
        journal = self._journal
        return journal.full or ((journal.waiting or changed) and time.monotonic() - self._stored >= self.period_s)

    @property
    def behind(self) -> bool:
        """Whether so many wait to be stored that a twin as fast as possible must wait, too."""
        return self._checkpointer.behind > BEHIND_MAX

    @property
    def lag(self) -> float:
        """For how long the store has been behind with checkpoints, of this twin or another [s]."""
        return self._checkpointer.lag

    def store(
        self, state: TwinStateName, changes: dict[str, Any], snapshot: bytes, measured: int | None = None
    ) -> None:  # fmt: skip
        """Hand over where the twin stands, and what it has told since the last one.

        `measured` is the number of the last measurements that the snapshot holds.
        """
        segment = self._journal.segment
        events = tuple(event.document() for event in self._journal.take_events())
        awaited = dict(self._awaited)
        answers = tuple(answer for answer in awaited.values() if answer is not None)
        checkpoint = Checkpoint(
            str(state), changes, snapshot, segment.first, len(segment.rows), None, events, answers, measured,
        )  # fmt: skip
        saved = partial(self._saved, tuple(awaited))
        urgent = bool(awaited) or state not in ALIVE
        self._checkpointer.keep(
            PendingCheckpoint(self._twin_id, self._epoch, checkpoint, segment, saved, self._superseded, urgent=urgent)
        )
        self._journal.turn()
        self._stored = time.monotonic()

    def awaited(self, answer: StoredResponse | None) -> Future[None]:
        """The next checkpoint is waited for, and holds the answer to a command; done when it is stored."""
        stored: Future[None] = Future()
        self._awaited[stored] = answer
        return stored

    def _saved(self, awaited: Iterable[Future[None]], checkpoint: Checkpoint) -> None:
        self._journal.saved(checkpoint)
        if checkpoint.state not in ALIVE and not self.end_stored.done():
            self.end_stored.set_result(None)
        for stored in awaited:
            if stored in self._awaited:
                del self._awaited[stored]
                stored.set_result(None)

    def _superseded(self) -> None:
        log.warning("twin %s runs elsewhere now", self._twin_id)
        self.superseded = True
        self._on_superseded()
        if not self.end_stored.done():
            self.end_stored.set_result(None)
        while self._awaited:
            stored, _ = self._awaited.popitem()
            stored.set_exception(conflict(f"twin {self._twin_id!r} runs elsewhere now"))
