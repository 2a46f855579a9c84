"""A replay: a twin that tells again what another one told, second by second, at a speed of its own."""

from __future__ import annotations

import logging
import time
from collections import deque
from typing import Any

import numpy as np

from api.http.problems import conflict
from api.store.database import StoreError
from api.store.records import StoredTwin
from api.twins.checkpointer import RETRY_S
from api.twins.messages import EventKind
from api.twins.paced import PacedTwin
from api.twins.queries import TwinQueries
from api.twins.schemas import TwinOrder, TwinRequest, TwinStateName
from station import InputError
from station.archives import pack, refuse_other_shapes, unpack

log = logging.getLogger(__name__)

SNAPSHOT_VERSION = 1

READ_AT_ONCE = 512
"""Samples read from the history of the twin that is played, at once: as many as a stored segment has."""

EVENTS_AT_ONCE = 200
"""Events likewise."""

_MEMORY = "memory_"
"""Before the names of arrays of the journal in a snapshot."""

OF_THE_TWIN = (
    EventKind.STARTED, EventKind.RESUMED, EventKind.PAUSED, EventKind.CONTINUED, EventKind.SPEED_CHANGED,
    EventKind.FINISHED, EventKind.STOPPED,
)  # fmt: skip
"""Kinds of events that are not played: they tell how the other twin was run, not what happened at its station."""

_OF_THE_STATION = frozenset(str(kind) for kind in EventKind if kind not in OF_THE_TWIN)


class ReplayTwin(PacedTwin):
    """A twin that plays a stretch of another's history: the same rows under the same numbers, the same events."""

    def __init__(self, stored: StoredTwin, request: TwinRequest, *, twins: TwinQueries, **kept: Any) -> None:
        super().__init__(stored, request, **kept)
        if request.of is None or request.from_s is None or request.to_s is None:
            raise InputError("twin", [("of", "must be given with from_s and to_s where source is replay")])
        self._twins = twins
        self._of, self._from, self._last = request.of, request.from_s, request.to_s
        self._seq = request.from_s  # of the next row
        self._after: int | None = None  # number of the other's last event that is told or passed; None: not looked for
        self._rows: deque[tuple[float, ...]] = deque()  # from `_seq` on
        self._events: deque[dict[str, Any]] = deque()  # behind `_after`, up to those rows and further
        self._look_at = 0.0  # when to read again [s, monotonic]

    # Starting.

    def start(self) -> None:
        """Begin at the first second of the stretch."""
        self._resume_told({}, self._seq)
        stretch = {"of": self._of, "from_s": self._from, "to_s": self._last}
        self._begin(EventKind.STARTED, {**stretch, "speed": self.request.speed})

    def resume(self, snapshot: bytes) -> None:
        """Go on from the last stored state.

        Raises
        ------
        InputError
            if the snapshot cannot be read.
        """
        arrays = unpack(snapshot)
        refuse_other_shapes(arrays, {"numbers": np.zeros(3, np.int64)})
        version, self._seq, after = arrays["numbers"].tolist()
        if version != SNAPSHOT_VERSION:
            raise InputError("snapshot", [("version", f"must be {SNAPSHOT_VERSION}; given {version}")])
        self._after = None if after < -1 else after
        memories = {name.removeprefix(_MEMORY): each for name, each in arrays.items() if name.startswith(_MEMORY)}
        self._resume_told(memories, self._seq)
        self._begin(EventKind.RESUMED, {"from_seq": self._seq, "of": self._of})

    @property
    def _time(self) -> float:
        return float(self._seq)

    # The thread.

    def _wait(self, due: float) -> float | None:
        """Seconds until the next tick; None while there is none to come."""
        wait = super()._wait(due)
        return None if wait is None else max(wait, self._look_at - time.monotonic())

    def _tick(self, due: float) -> float:
        """Tell a second that was due; when the next one is [s, monotonic]."""
        if not self._rows and not self._read():
            self._look_at = time.monotonic() + RETRY_S
            return due
        return super()._tick(due)

    def _second(self) -> None:
        row = self._rows.popleft()
        self._sample(self._seq, row)
        self._seq += 1
        while self._events and self._events[0]["time"] <= row[0]:
            self._play(self._events.popleft())
        if self._seq > self._last:
            self.state, self._stopping = TwinStateName.FINISHED, True
            self._tell(self._time, EventKind.FINISHED, {"samples": self._seq})

    def _play(self, event: dict[str, Any]) -> None:
        """Tell an event of the other twin, unless it is of how that was run."""
        self._after = event["seq"]
        if event["kind"] in _OF_THE_STATION and event["time"] >= self._from:
            self._tell(event["time"], EventKind(event["kind"]), event["details"])

    def _read(self) -> bool:
        """Read the next rows, and the events up to them; False where the store, or the other twin, must be waited for.

        Raises
        ------
        RuntimeError
            if a row is no longer kept whole.
        """
        try:
            count = min(READ_AT_ONCE, self._last + 1 - self._seq)
            found = self._twins.history(self._of, self._seq, count)
            if found and found[0].seq == self._seq:
                self._read_events(found[-1].row[0])
        except StoreError as error:
            log.warning("twin %s waits for what it plays: %s", self.id, error)
            return False
        if not found and self._twins.live(self._of) is not None:
            return False  # it was killed before these were stored, and will tell them again
        if not found or found[0].seq != self._seq:
            raise RuntimeError(f"second {self._seq} of twin {self._of}, which {self.id} plays, is no longer kept whole")
        self._rows.extend(sample.row for sample in found)
        return True

    def _read_events(self, until: float) -> None:
        """Read the other's events up to one that is later than a time [s]."""
        if self._after is None:
            self._after = self._twins.event_before(self._of, self._from)
        while not self._events or self._events[-1]["time"] <= until:
            last = self._events[-1]["seq"] if self._events else self._after
            more = self._twins.events(self._of, last, EVENTS_AT_ONCE)
            self._events.extend(more)
            if not more:
                return

    # What is kept.

    def _snapshot(self, memories: dict[str, np.ndarray]) -> bytes:
        after = -2 if self._after is None else self._after
        kept = {_MEMORY + name: memory for name, memory in memories.items()}
        return pack({"numbers": np.array([SNAPSHOT_VERSION, self._seq, after], np.int64), **kept})

    def _close(self) -> None:
        """There is nothing to let go of."""


def replay_request(twins: TwinQueries, order: TwinOrder) -> TwinRequest:
    """The replay that an order means, with the scenario of the twin that it plays.

    Raises
    ------
    InputError
        if there is no such twin, or its stretch was not told, or is not kept whole.
    ProblemError
        409 where it has told no second yet.
    """
    of = order.of or ""
    if not twins.known(of):
        raise InputError("request", [("of", f"no twin is called {of!r}")])
    newest = twins.samples(of) - 1
    if newest < 0:
        raise conflict(f"twin {of!r} has told no second yet")
    last = newest if order.to_s is None else order.to_s
    if last > newest:
        raise InputError("request", [("to_s", f"must be at most {newest}, the newest second of {of!r}; given {last}")])
    begin = twins.whole_from(of)
    first = begin if order.from_s is None else order.from_s
    if first > last:
        raise InputError("request", [("from_s", f"must not lie behind second {last}; given {first}")])
    if first < begin:
        left = f"of older seconds minutes are left (resolution 60 s), or nothing; given {first}"
        raise InputError("request", [("from_s", f"must be at least {begin}: {left}")])
    changes = {
        "scenario": twins.scenario(of), "from_s": first, "to_s": last, "plays": twins.layout(of),
        "station_seq": twins.station_seq(of),
    }  # fmt: skip
    return TwinRequest.model_construct(**{**dict(order), **changes})
