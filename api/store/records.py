"""Records that the store takes and gives, and its errors."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Future
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from api.scopes import Scope


class Conflict(Exception):  # noqa: N818  # named for what it is, as in HTTP
    """Something of that name is there already."""


class Superseded(Exception):  # noqa: N818  # somebody else's state, not a fault
    """Another server or worker has taken this over since: nothing was written."""


class KeyTaken(Exception):  # noqa: N818  # somebody else's state, not a fault
    """An idempotency key has been used meanwhile."""


class NotDurableYet(Exception):  # noqa: N818  # it will be
    """It is done, but the store does not have it yet; `stored` tells when it does."""

    def __init__(self, stored: Future[None]) -> None:
        super().__init__("not stored yet")
        self.stored = stored


class CapacityError(Exception):
    """There are as many of these as the settings allow."""


class StoreFull(Exception):  # noqa: N818  # as in HTTP 507
    """The store takes no new work; what was accepted is still stored."""


class JobState(StrEnum):
    """Where a job stands; the last three are final."""

    QUEUED = "queued"
    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELLED = "cancelled"

    @property
    def final(self) -> bool:
        """Whether nothing happens to the job any more."""
        return self in {JobState.SUCCEEDED, JobState.FAILED, JobState.CANCELLED}


class JobKind(StrEnum):
    """The kind of a job."""

    RUN = "run"
    COMPARISON = "comparison"
    CERTIFICATE = "certificate"
    FORECAST = "forecast"
    CALIBRATION = "calibration"
    SHADOW = "shadow"


@dataclass(frozen=True, slots=True)
class Job:
    """A job as stored, but for its spec."""

    id: str
    kind: JobKind
    summary: dict[str, Any]  # names and numbers of the spec, as answers show them
    state: JobState
    created: float  # Unix time [s]
    started: float | None  # [s]
    finished: float | None  # [s]
    runs: int
    runs_done: int
    error: dict[str, Any] | None  # problem document of a failed job
    progress: float | None = None  # of a job of one chunk, as it was told last: 0 to 1


@dataclass(frozen=True, slots=True)
class Lease:
    """One chunk of a job, lent to a worker; `attempt` fences what it may write."""

    job: str
    chunk: int
    attempt: int
    items: dict[str, Any]
    runs: int
    priority: int = 0  # lower goes first


@dataclass(frozen=True, slots=True)
class Chunk:
    """A piece of a job, of `runs` runs; `items` says which. Results are put together in the order of the numbers."""

    number: int
    items: dict[str, Any]
    runs: int


@dataclass(frozen=True, slots=True)
class ChunkResult:
    """The result of a chunk: of its first `runs` runs, the others being cut into chunks of their own."""

    rows: bytes  # JSON array, one object a run
    runs: int
    rest: tuple[Chunk, ...] = ()
    parquet: bytes | None = None  # the record of a single run
    records: Mapping[int, bytes] = field(default_factory=dict)  # of a comparison, by the number of the run


@dataclass(frozen=True, slots=True)
class StoredTwin:
    """A live twin as stored."""

    id: str
    settings: dict[str, Any]
    state: str
    epoch: int
    samples: int
    events: int
    created: float  # Unix time [s]
    changed: float  # [s]


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """Where a live twin stands, and what it told since the checkpoint before."""

    state: str
    changes: dict[str, Any]  # of the settings the twin was started with
    snapshot: bytes
    first_seq: int  # of the segment
    rows: int
    segment: bytes | None  # whole: it replaces a shorter one that begins at the same row
    events: tuple[dict[str, Any], ...] = field(default=())
    answers: tuple[StoredResponse, ...] = field(default=())  # to commands that this checkpoint holds
    measured: int | None = None  # number of the last measurements that it holds; None where the twin measures nothing


@dataclass(frozen=True, slots=True)
class StoredMeasurements:
    """Where measurements stand in the log of a twin."""

    number: int  # in the order in which they came, from 1
    repeated: bool  # they were there already


@dataclass(frozen=True, slots=True)
class StoredNote:
    """A note on the time axis of a twin."""

    id: str
    time_s: float  # since the twin's start [s]
    to_s: float | None  # None for a moment [s]
    text: str
    author: str
    created: float  # Unix time [s]


@dataclass(frozen=True, slots=True)
class StoredScenario:
    """A user's scenario as stored, but for its document."""

    name: str
    about: dict[str, Any]  # what lists show of the document
    digest: str  # SHA-256 of the document
    changed: float  # Unix time [s]


@dataclass(frozen=True, slots=True)
class StoredResponse:
    """The answer to a request with an idempotency key."""

    owner: str  # name of the API key; empty where none is needed
    key: str
    request: bytes  # SHA-256 of method, path and body
    created: float  # Unix time [s]
    status: int
    location: str
    body: bytes


@dataclass(frozen=True, slots=True)
class Key:
    """An API key; the key itself is not stored."""

    name: str
    created: float  # Unix time [s]
    revoked: float | None  # [s]
    scopes: tuple[Scope, ...]
    digest: bytes = field(repr=False)  # SHA-256 of the key
