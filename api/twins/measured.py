"""A measured twin: it follows a station by what is sent to it, and goes on from the log of that when it was killed."""

from __future__ import annotations

import logging
import threading
import time
from dataclasses import asdict
from functools import partial
from http import HTTPStatus
from typing import Any

import numpy as np

from api.http.problems import ProblemError, conflict
from api.jobs.cores import cores
from api.measurements.payload import decode_batch, digest_of, encode_batch
from api.store.database import StoreError
from api.store.measurements import MeasurementRepository
from api.store.records import StoredMeasurements, StoredTwin, Superseded
from api.twins.checkpointer import RETRY_S
from api.twins.live import LiveTwin
from api.twins.messages import EventKind
from api.twins.schemas import TwinRequest
from station import InputError, Station
from station.alarms.system import AlarmSystem
from station.archives import pack, refuse_other_shapes, unpack
from station.batches import Batch
from station.estimation.alarm_inputs import inputs_of
from station.estimation.assembly import Counts
from station.estimation.belief import Belief
from station.estimation.followed import FollowedRun, FollowedSeconds
from station.measurement import TagMap

log = logging.getLogger(__name__)

SNAPSHOT_VERSION = 1

_MEMORY = "memory_"
"""Before the names of arrays of the journal in a snapshot."""

WAITING_MAX = 100
"""Batches that may wait to be followed; beyond it who sends is told to wait."""

LAG_MAX = 5.0
"""A store that is so long behind with checkpoints is too slow: who sends is told to wait [s]."""

READ_AT_ONCE = 16
"""Batches read from the log between two commands."""

SELDOM = 5
"""A measured twin stores where it stands so many times as seldom as others do: what it lacks then is in its log."""

_FOLLOWING = threading.BoundedSemaphore(max(1, cores() - 1))
"""Twins that compute at once. Where fifty do, each at the end of the same block of seconds, a request that needs the
interpreter for a moment waits for all of them."""

SILENCE_S = 1.0
"""How often it is looked for how long no measurements have come [s]."""

RETRY_AFTER_S = 1
"""When who was told to wait should send again [s]."""


class MeasuredTwin(LiveTwin):
    """A twin whose seconds are those of a real station; row `k` is the second `k` after the first that was measured."""

    def __init__(
        self, stored: StoredTwin, request: TwinRequest, *, log_of: MeasurementRepository, checkpoint_s: float,
        **kept: Any,
    ) -> None:  # fmt: skip
        super().__init__(stored, request, checkpoint_s=SELDOM * checkpoint_s, **kept)
        self._log = log_of
        self._run = new_run(request)
        self._taken = 0  # number of the last measurements that the run has taken
        self._stored_taken = 0  # of those that a checkpoint has, or soon
        self._known = 0  # number of the last that the log is known to hold
        self._sent, self._received = 0, 0  # batches put into the queue of commands, and taken out of it
        self._look_at = 0.0  # when the log may be read [s, monotonic]
        self._unread = False  # whether the log has to be read to go on
        self._feeding = threading.Lock()  # so that measurements are told in the order of the log
        self._ended = False  # measurements are no longer accepted
        self._seq = 0
        self._first_time: float | None = None  # of row 0 [s]

    # Starting.

    def start(self) -> None:
        """Begin; the first second is that of the first measurements."""
        scenario = self.request.scenario
        self._begin(EventKind.STARTED, {"scenario": scenario.name, "station": scenario.station.name})

    def resume(self, snapshot: bytes) -> None:
        """Go on from the last stored state, and follow what the log holds behind it.

        Raises
        ------
        InputError
            if the snapshot cannot be read.
        """
        arrays = _read(snapshot)
        self._run = new_run(self.request, arrays["followed"].tobytes())
        self._taken = self._stored_taken = self._known = int(arrays["taken"])
        self._seq, first_time = int(arrays["seq"]), float(arrays["first_time"])
        self._first_time = None if np.isnan(first_time) else first_time
        memories = {name.removeprefix(_MEMORY): each for name, each in arrays.items() if name.startswith(_MEMORY)}
        self._resume_told(memories, self._seq)
        self._unread = True
        if self._run.renewed:  # what another version of the service estimated says nothing of what this one does
            self._change(station_seq=self._seq)
        details = {"from_seq": self.first, "measurements": self._taken, "renewed": self._run.renewed}
        self._begin(EventKind.RESUMED, details)

    # The thread.

    @property
    def _time(self) -> float:
        return float(max(self._seq - 1, 0))

    def _wait(self, due: float) -> float | None:  # noqa: ARG002  # no second is due by the clock
        return max(0.0, self._look_at - time.monotonic()) if self._unread else SILENCE_S

    def _tick(self, due: float) -> float:
        """Follow the next measurements that only the log has; else look for how long none have come."""
        if not self._unread:
            if self.alarms is not None:
                self._tell_alarms(self.alarms.silence(time.monotonic() - self._heard))
            return due
        try:
            found = self._log.after(self.id, self._taken, READ_AT_ONCE)
        except StoreError as error:
            log.warning("twin %s waits for its measurements: %s", self.id, error)
            self._look_at = time.monotonic() + RETRY_S
            return due
        for number, payload in found:
            self._take(number, decode_batch(payload))
        if len(found) < READ_AT_ONCE:
            if self._taken < self._known:
                raise RuntimeError(f"measurements of twin {self.id} behind {self._taken} are not in its log")
            self._unread = False
        while self._checkpoints.behind and self._commands.empty:
            time.sleep(0.001)
        return due

    def _told(self, number: int, batch: Batch) -> None:
        """Follow measurements just stored; where some are missing before them, the log is read first."""
        self._received += 1
        self._heard = time.monotonic()
        self._known = max(self._known, number)
        if number == self._taken + 1:
            self._take(number, batch)
        elif number > self._taken:
            self._unread = True

    def _take(self, number: int, batch: Batch) -> None:
        if number != self._taken + 1:
            raise RuntimeError(f"measurements {number} of twin {self.id} came behind {self._taken}")
        try:
            with _FOLLOWING:
                found = self._run.push(batch)
            self._follow(found)
        except InputError as error:  # whatever is sent again is refused again
            details = {"number": number, "samples": len(batch), "problem": str(error)[:500]}
            self._tell(self._time, EventKind.MEASUREMENTS_REFUSED, details)
        self._taken = number

    def _follow(self, found: FollowedSeconds) -> None:
        for source_time, figures in zip(found.time.tolist(), found.table().tolist(), strict=True):
            if self._first_time is None:
                self._first_time = source_time
            row = (source_time - self._first_time, source_time, *figures)
            self._sample(self._seq, row)
            self.shadow.close(self._seq)
            if self.shadow.begins(self._seq):
                self.shadow.open(self._seq, "", {"row": np.array(row)})
            self._seq += 1
        for event in found.events:
            self._tell(self._time, EventKind.DETECTED, asdict(event))
        if found.anew is not None and self._first_time is not None:  # what was estimated before was of wrong clocks
            first = round(found.anew - self._first_time)
            self._change(station_seq=first, clocks_seq=first)
        if self.alarms is not None and len(found) and self._first_time is not None:
            self._tell_alarms(self.alarms.advance(found.time - self._first_time, inputs_of(found)))

    # What is kept.

    @property
    def _changed(self) -> bool:
        return self._taken > self._stored_taken

    @property
    def _measured(self) -> int:
        return self._taken

    def _snapshot(self, memories: dict[str, np.ndarray]) -> bytes:
        self._stored_taken = self._taken
        first_time = np.nan if self._first_time is None else self._first_time
        numbers = {"version": SNAPSHOT_VERSION, "taken": self._taken, "seq": self._seq, "first_time": first_time}
        arrays: dict[str, Any] = {name: np.array(number) for name, number in numbers.items()}
        arrays["followed"] = np.frombuffer(self._run.snapshot(), np.uint8)
        arrays |= {_MEMORY + name: memory for name, memory in memories.items()}
        return pack(arrays)

    def _close(self) -> None:
        """There is nothing to let go of."""

    # From other threads.

    def measure(self, source: str, sequence: int, batch: Batch) -> StoredMeasurements:
        """Store measurements, once, and follow them soon.

        Raises
        ------
        ProblemError
            503 `behind` while too much waits to be followed, or to be stored; 409 where the twin has ended or runs
            elsewhere.
        Conflict
            if the sequence was stored with other content, or is too old.
        """
        payload = encode_batch(batch)
        with self._feeding:
            if self._ended or not self.here:
                raise conflict(f"twin {self.id!r} takes no measurements any more")
            if (waiting := self._sent - self._received) >= WAITING_MAX:
                raise _behind(f"{waiting} batches wait to be followed")
            if (lag := self._checkpoints.lag) > LAG_MAX:
                raise _behind(f"the store is {lag:.0f} s behind with what twins have told")
            try:
                stored = self._log.append(
                    self.id, self.epoch, source, sequence, digest_of(payload), len(batch), payload
                )  # fmt: skip
            except Superseded:
                raise conflict(f"twin {self.id!r} runs elsewhere now") from None
            self._sent += 1
            self._commands.tell(partial(self._told, stored.number, batch))
        return stored

    @property
    def tags(self) -> TagMap:
        """What the tags of measurements are."""
        return tags_of(self.request)

    @property
    def counts(self) -> Counts:
        """What became of the samples so far."""
        return self._run.counts

    @property
    def active(self) -> tuple[str, ...]:
        """Names of the events that last, in order."""
        return self._run.active

    @property
    def taken(self) -> int:
        """Number of the last measurements that are followed."""
        return self._taken

    def move(self, station: Station, calibration: str) -> None:
        """Follow with another station from the next second on. In the twin's thread."""
        self._check_alive()
        if calibration == self.request.calibration:
            return
        self._run, events = self._run.moved(station)
        for event in events:
            self._tell(self._time, EventKind.DETECTED, asdict(event))
        self._change(station=station, calibration=calibration, station_seq=self._seq)
        if self.alarms is not None:
            alarms = AlarmSystem(station)
            alarms.resume(self.alarms.memories())
            self.alarms = alarms
        details = {"station": station.name, "calibration": calibration, "from_seq": self._seq}
        self._tell(self._time, EventKind.STATION_CHANGED, details)

    def belief(self) -> tuple[int, Belief | None]:
        """The number of the second that comes next, and what is believed before it. In the twin's thread."""
        self._check_alive()
        return self._seq, self._run.belief()

    def stop(self) -> None:
        """Follow what was accepted, and the seconds held back; then end for good."""
        with self._feeding:
            self._ended = True
        while found := self._log.after(self.id, self._taken, READ_AT_ONCE):
            for number, payload in found:
                self._take(number, decode_batch(payload))
        self._follow(self._run.finish())
        super().stop()


def _behind(why: str) -> ProblemError:
    return ProblemError(HTTPStatus.SERVICE_UNAVAILABLE, "behind", "Behind", why, retry_after_s=RETRY_AFTER_S)


def new_run(request: TwinRequest, snapshot: bytes | None = None) -> FollowedRun:
    """The run of a measured twin, at its beginning or from a snapshot.

    Raises
    ------
    InputError
        if the station cannot be followed, or by these tags; or the snapshot is none of such a run.
    """
    station, tags = request.followed_station, tags_of(request)
    return FollowedRun(station, tags) if snapshot is None else FollowedRun.restore(station, tags, snapshot)


def tags_of(request: TwinRequest) -> TagMap:
    """The tags of a measured twin."""
    if request.tags is None:
        raise InputError("twin", [("tags", "must be given where source is measured")])
    return request.tags


def _read(snapshot: bytes) -> dict[str, np.ndarray]:
    arrays = unpack(snapshot)
    refuse_other_shapes(arrays, {"version": np.array(SNAPSHOT_VERSION)})
    if (version := int(arrays["version"])) != SNAPSHOT_VERSION:
        raise InputError("snapshot", [("version", f"must be {SNAPSHOT_VERSION}; given {version}")])
    return arrays
