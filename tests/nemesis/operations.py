"""Every operation of the store that writes, as `test_statements.py` tries it, with clock and random numbers held."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from api.store import backup, idempotency, jobs, keys, measurements, scenarios, twins
from api.store.database import Database
from api.store.idempotency import IdempotencyRepository
from api.store.jobs import JobRepository
from api.store.keys import KeyRepository
from api.store.notes import NoteRepository
from api.store.records import (
    Checkpoint,
    Chunk,
    ChunkResult,
    Conflict,
    JobKind,
    KeyTaken,
    StoredMeasurements,
    StoredNote,
    StoredResponse,
    StoredScenario,
    Superseded,
)
from api.store.scenarios import ScenarioRepository
from api.store.tables import metadata
from api.store.twins import TwinRepository

NOW = 1_790_000_000.0
"""What the clock shows [s]: a fault must not be told from another by the time at which it came."""


def fix(seed: int) -> None:
    """The same clock and the same random numbers for the store in every run."""
    drawn = random.Random(seed)
    clock = SimpleNamespace(time=lambda: NOW)
    bits = SimpleNamespace(
        token_hex=lambda n=32: drawn.randbytes(n).hex(), token_urlsafe=lambda n=32: drawn.randbytes(n).hex()
    )
    for module in (jobs, twins, keys, idempotency, scenarios, measurements):
        module.time = clock
    for module in (jobs, keys):
        module.secrets = bits


SAME: tuple[str, ...] = ()


@dataclass(frozen=True)
class Operation:
    """One writing operation.

    `prepare(database, folder)` fills the database and returns what `act(database, prepared)` needs. `again` is what a
    repetition does when the first one took effect but nobody was told: it changes these tables alone, or raises that.
    """

    of: str
    prepare: Callable[[Database, Path], Any]
    act: Callable[[Database, Any], Any]
    again: Any = SAME
    label: str = ""

    def __str__(self) -> str:
        return f"{self.of}{': ' * bool(self.label)}{self.label}"


def _answer(key: str = "once") -> StoredResponse:
    return StoredResponse("ann", key, b"r" * 32, NOW, 202, "/v1/x", b"{}")


PIECES = [Chunk(0, {"first": 0}, 2), Chunk(1, {"first": 2}, 1)]


def _job(database, _folder=None, pieces=PIECES):
    return JobRepository(database).add(JobKind.COMPARISON, {"s": 1}, {"a": 1}, pieces, 10)


def _leased(database, _folder=None, pieces=PIECES):
    _job(database, pieces=pieces)
    return JobRepository(database).claim("worker", 60.0, 3)


def _add_job(database, _prepared):
    added = JobRepository(database).add(
        JobKind.RUN, {"s": 2}, {"a": 2}, PIECES, 10, keep_answer=lambda job: _answer("job")
    )
    return added.state


def _worn_out(database, _folder):
    _job(database)
    repository = JobRepository(database)
    for _ in range(2):
        repository.give_back(repository.claim("worker", 60.0, 3))


def _claimed(database, attempts_max):
    return JobRepository(database).claim("other", 60.0, attempts_max)


def _ended(database, _folder):
    repository = JobRepository(database)
    lease = _leased(database, pieces=[Chunk(0, {}, 1)])
    repository.complete(lease, ChunkResult(b"[1]", 1, parquet=b"p"))


def _twin(database, _folder=None):
    repository = TwinRepository(database, "hrs")
    repository.add("demo", {"speed": 1}, _answer("made"))
    epoch, _ = repository.open("demo")
    return epoch


def _checkpoint(first, rows, events, *answers):
    told = tuple({"seq": seq, "kind": "arrival"} for seq in events)
    return Checkpoint("running", {"speed": 2}, b"state", first, rows, b"parquet", told, answers)


def _told(database, _folder):
    epoch = _twin(database)
    TwinRepository(database, "hrs").save("demo", epoch, _checkpoint(0, 2, (0, 1)))
    return epoch


def _change_scenario(database, about):
    wanted = StoredScenario("day", {"about": about}, about, NOW)
    return ScenarioRepository(database).put(wanted, {"name": "day"}, 10, lambda _: None)


def _scenario(database, _folder):
    _change_scenario(database, "before")


def _save(database, epoch):
    TwinRepository(database, "hrs").save("demo", epoch, _checkpoint(0, 5, (2, 3), _answer("vehicle")))


def _kept(database, _folder):
    with database.write() as connection:
        for number in range(3):
            idempotency.keep(connection, _answer(f"old-{number}"), 1e6)


def _held(database, _folder):
    return KeyRepository(database).create("ann")


def _empty(database, _folder):
    with database.write() as connection:
        metadata.drop_all(connection)
        connection.exec_driver_sql("DROP TABLE alembic_version")


def _backed_up(database, folder):
    _told(database, folder)
    _ended(database, folder)
    backup.backup(database, folder / "a.backup", lambda *_: None)
    KeyRepository(database).create("later")
    return folder / "a.backup"


def _restore(database, file):
    return backup.restore(database, file, lambda *_: None, replace=True)


LATER = NOW + 1.0


def _append(database: Database, epoch: int) -> StoredMeasurements:
    return TwinRepository(database, "hrs").measurements.append("demo", epoch, "gateway", 7, "digest", 3, b"payload")


def _add_note(database: Database, _prepared: Any) -> None:
    note = StoredNote("note-1", 60.0, None, "hose changed", "ann", NOW)
    NoteRepository(database).add("demo", note, _answer("note"))


def _noted(database, _folder):
    _twin(database)
    _add_note(database, None)


def _shadows(database, _folder):
    for twin in ("demo", "demo", "other"):
        JobRepository(database).add(JobKind.SHADOW, {"s": 1}, {"twin": twin}, PIECES, 10)


OPERATIONS = [
    Operation("JobRepository.add", lambda *_: None, _add_job, KeyTaken),
    Operation("JobRepository.claim", _job, lambda database, _: _claimed(database, 3), ("chunks",)),
    Operation("JobRepository.claim", _worn_out, lambda database, _: _claimed(database, 2), SAME, "worn out"),
    Operation("JobRepository.advance", _leased, lambda database, lease: JobRepository(database).advance(lease, 0.5)),
    Operation("JobRepository.renew", _leased, lambda database, lease: JobRepository(database).renew(lease, 99.0)),
    Operation(
        "JobRepository.complete", _leased,
        lambda database, lease: JobRepository(database).complete(lease, ChunkResult(b"[1]", 1, (Chunk(2, {}, 1),))),
        Superseded, "a part",
    ),
    Operation(
        "JobRepository.complete", lambda database, _: _leased(database, pieces=[Chunk(0, {}, 1)]),
        lambda database, lease: JobRepository(database).complete(lease, ChunkResult(b"[1]", 1, parquet=b"p")),
        Superseded, "the last",
    ),
    Operation(
        "JobRepository.fail", _leased, lambda database, lease: JobRepository(database).fail(lease, {"title": "no"}),
        Superseded,
    ),
    Operation("JobRepository.give_back", _leased, lambda database, lease: JobRepository(database).give_back(lease)),
    Operation("JobRepository.release", _leased, lambda database, _: JobRepository(database).release("work*")),
    Operation("JobRepository.cancel", _job, lambda database, job: JobRepository(database).cancel(job.id)),
    Operation("JobRepository.remove", _job, lambda database, job: JobRepository(database).remove(job.id)),
    Operation("JobRepository.prune", _ended, lambda database, _: JobRepository(database).prune(LATER)),
    Operation(
        "TwinRepository.add", lambda *_: None,
        lambda database, _: TwinRepository(database, "hrs").add("demo", {"speed": 1}, _answer()), Conflict,
    ),
    Operation(
        "TwinRepository.open", _told, lambda database, _: TwinRepository(database, "hrs").open("demo"), ("twins",)
    ),
    Operation("TwinRepository.save", _told, _save),
    Operation("MeasurementRepository.append", _told, _append),
    Operation(
        "TwinRepository.thin", _told,
        lambda database, epoch: TwinRepository(database, "hrs").thin("demo", epoch, 0, 2, 1.5, b"minutes"), Superseded,
    ),
    Operation(
        "TwinRepository.remove", _told,
        lambda database, _: TwinRepository(database, "hrs").remove("demo", _answer("made")),
    ),
    Operation(
        "TwinRepository.thin_events", _told,
        lambda database, _: TwinRepository(database, "hrs").thin_events("demo", ["arrival"], LATER, -1, 10),
    ),
    Operation("ScenarioRepository._changing", lambda *_: None, lambda database, _: _change_scenario(database, "new"),
              SAME, "a new one"),
    Operation("ScenarioRepository._changing", _scenario, lambda database, _: _change_scenario(database, "other"),
              SAME, "another in its place"),
    Operation(
        "ScenarioRepository._changing", _scenario,
        lambda database, _: ScenarioRepository(database).remove("day", lambda _: None), SAME, "none",
    ),
    Operation("NoteRepository.add", _twin, _add_note, KeyTaken),
    Operation("NoteRepository.remove", _noted, lambda database, _: NoteRepository(database).remove("demo", "note-1")),
    Operation(
        "JobRepository.forget_of_twin", _shadows,
        lambda database, _: JobRepository(database).forget_of_twin(JobKind.SHADOW, "demo"),
    ),
    Operation("TwinRepository.prune", _told, lambda database, _: TwinRepository(database, "hrs").prune(LATER)),
    Operation("IdempotencyRepository.prune", _kept, lambda database, _: IdempotencyRepository(database).prune(LATER)),
    Operation("KeyRepository.create", lambda *_: None, lambda database, _: KeyRepository(database).create("ann"),
              Conflict),
    Operation("KeyRepository.revoke", _held, lambda database, _: KeyRepository(database).revoke("ann")),
    Operation("Database.migrate", _empty, lambda database, _: database.migrate()),
    Operation("_restored", _backed_up, _restore, ("twins",)),  # whose epochs are later each time
]  # fmt: skip
BY_NAME = {str(operation): operation for operation in OPERATIONS}
