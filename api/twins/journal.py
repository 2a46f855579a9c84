"""The journal of a live twin: its rows and events, kept in memory until the checkpointer has stored them."""

from __future__ import annotations

import threading
from collections.abc import Mapping

import numpy as np

from api.packing import Basis
from api.store.records import Checkpoint
from api.twins.checkpointer import Segment
from api.twins.messages import COLUMNS, Event, sample_columns

SEGMENT_ROWS = 512
"""Rows of a full segment: at 1x it is stored anew with every checkpoint until then, some 3 ms each."""

SEGMENT_ROWS_MAX = 4096
"""A fast twin stores as soon as it has so many."""


class TwinJournal:
    """Rows in segments, and events. The twin's thread adds, the checkpointer's says what is stored, others read."""

    def __init__(self, events: int, basis: Basis, layout: str) -> None:
        self._lock = threading.Lock()
        self._basis = basis
        self._layout = layout
        self._segments = [Segment(0, basis, layout)]
        self._new_events: list[Event] = []  # in no checkpoint yet
        self._unsaved_events: list[Event] = []
        self.events = events  # told since the twin was first started
        self.last_row: tuple[float, ...] = ()

    def memories(self) -> dict[str, np.ndarray]:
        """Arrays for a snapshot, by name."""
        found = {"told": np.array(self.events)}
        return {**found, "row": np.array(self.last_row)} if self.last_row else found

    def resume(self, memories: Mapping[str, np.ndarray], first: int) -> None:
        """Begin at row `first` behind the stored ones; no event gets a number that one before the snapshot has."""
        row = tuple(memories.get("row", np.zeros(0)).ravel().tolist())
        self._segments = [Segment(first, self._basis, self._layout)]
        self.events = max(self.events, int(memories.get("told", np.zeros(()))))
        whole = len(sample_columns(self._layout))
        if len(row) == len(COLUMNS):  # an older version kept no column of the plant's own
            row += (float("nan"),) * (whole - len(row))
        self.last_row = row if len(row) == whole else ()

    def add(self, row: tuple[float, ...], sent: float) -> None:
        """The row of one more second, told at this Unix time [s]."""
        self._segments[-1].rows.append((*row, sent))
        self.last_row = row

    def add_event(self, event: Event) -> None:
        """One more event; it has the number `events`."""
        self.events += 1
        with self._lock:
            self._new_events.append(event)
            self._unsaved_events.append(event)

    @property
    def segment(self) -> Segment:
        """The last one, which grows."""
        return self._segments[-1]

    @property
    def full(self) -> bool:
        """Whether it is time to store, whatever the clock says."""
        return len(self.segment.rows) >= SEGMENT_ROWS_MAX

    @property
    def waiting(self) -> bool:
        """Whether there is anything no checkpoint has."""
        return len(self.segment.rows) > self.segment.saved or bool(self._new_events)

    def take_events(self) -> list[Event]:
        """The events in no checkpoint yet; they are then."""
        with self._lock:
            taken, self._new_events = self._new_events, []
        return taken

    def turn(self) -> None:
        """Begin another segment if this one is full."""
        if len(self.segment.rows) >= SEGMENT_ROWS:
            with self._lock:
                self._segments.append(Segment(self.segment.end, self._basis, self._layout))

    def saved(self, checkpoint: Checkpoint) -> None:
        """The checkpointer has stored a checkpoint: what was only in memory may go."""
        stored = {document["seq"] for document in checkpoint.events}
        with self._lock:
            self._unsaved_events = [event for event in self._unsaved_events if event.seq not in stored]
            while len(self._segments) > 1 and self._segments[0].saved == len(self._segments[0].rows):
                self._segments.pop(0)

    def rows_from(self, first: int) -> tuple[int, list[tuple[float, ...]]]:
        """(number of the first, rows of a history) in memory, from `first` on; every row before them is stored."""
        with self._lock:
            segments = list(self._segments)
        begin = max(first, segments[0].first)
        rows = [row for segment in segments for row in segment.rows[max(0, begin - segment.first) :]]
        return begin, rows

    @property
    def rows(self) -> int:
        """Rows told since the twin was first started."""
        return self.segment.end

    @property
    def stored(self) -> bool:
        """Whether all rows and events are."""
        with self._lock:
            return self.segment.saved == len(self.segment.rows) and not self._unsaved_events

    def events_in_memory(self) -> list[Event]:
        """Events that may not be stored yet."""
        with self._lock:
            return list(self._unsaved_events)
