"""Jobs on a lease table: every chunk ends with one result, whoever dies on the way.

A worker claims a chunk for a time and renews its lease while it computes. Each claim raises the chunk's attempt, and
what a worker writes is fenced by the attempt it holds: one that was thought dead, and comes back, changes nothing.
A chunk's result and its end are one transaction.
"""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable, Sequence
from typing import Any

import sqlalchemy as sa

from api.store.database import Database
from api.store.documents import read_json
from api.store.idempotency import keep
from api.store.records import (
    CapacityError,
    Chunk,
    ChunkResult,
    Job,
    JobKind,
    JobState,
    Lease,
    StoredResponse,
    Superseded,
)
from api.store.tables import chunks, jobs, results, run_records, series

_OPEN_STATES = (JobState.QUEUED, JobState.RUNNING)
_PRIORITY = dict.fromkeys(JobKind, 0) | {JobKind.COMPARISON: 1, JobKind.SHADOW: 2}
"""What is one piece of work does not wait for a long comparison to end, and nobody waits for a shadow."""


def new_id(kind: str) -> str:
    """An id whose order is that of creation."""
    return f"{kind}-{int(1000 * time.time()):012x}{secrets.token_hex(4)}"


class JobRepository:
    """Jobs, their chunks and results."""

    def __init__(self, database: Database, keep_s: float = 86_400.0) -> None:
        self._database = database
        self._keep_s = keep_s  # how long answers are kept [s]

    def add(
        self, kind: JobKind, spec: dict[str, Any], summary: dict[str, Any], pieces: Sequence[Chunk], open_max: int,
        keep_answer: Callable[[Job], StoredResponse] | None = None,
    ) -> Job:  # fmt: skip
        """Store a new job with its chunks; `summary` is what answers show of the spec.

        What `keep_answer` makes of the job is kept with it, in one transaction.

        Raises
        ------
        Full
            if `open_max` jobs are waiting or running.
        KeyTaken
            if another request has used the answer's idempotency key; nothing is stored.
        """
        job_id = new_id(kind)
        job = {
            "id": job_id, "kind": kind, "about": summary, "spec": spec, "state": JobState.QUEUED,
            "created": time.time(), "runs": sum(piece.runs for piece in pieces), "runs_done": 0,
        }  # fmt: skip
        rows = [{**_row(job_id, piece), "priority": _PRIORITY[kind]} for piece in pieces]
        with self._database.write() as connection:
            waiting = connection.scalar(
                sa.select(sa.func.count()).select_from(jobs).where(jobs.c.state.in_(_OPEN_STATES))
            )
            if (waiting or 0) >= open_max:
                raise CapacityError(f"{waiting} jobs are waiting or running")
            connection.execute(jobs.insert(), job)
            connection.execute(chunks.insert(), rows)
            added = _job(connection.execute(_BY_ID, {"wanted": job["id"]}).one())
            if keep_answer is not None:
                keep(connection, keep_answer(added), self._keep_s)
            return added

    def get(self, job_id: str) -> Job | None:
        """The job, or None."""
        with self._database.read() as connection:
            row = connection.execute(_BY_ID, {"wanted": job_id}).one_or_none()
        return None if row is None else _job(row)

    def spec(self, job_id: str) -> dict[str, Any] | None:
        """The whole spec of a job."""
        with self._database.read() as connection:
            found: dict[str, Any] | None = connection.scalar(sa.select(jobs.c.spec).where(jobs.c.id == job_id))
        return found

    def get_with_result(self, job_id: str) -> tuple[Job, list[dict[str, Any]]] | None:
        """The job, and the rows of its first chunk if that is done, in one query."""
        with self._database.read() as connection:
            row = connection.execute(_WITH_RESULT, {"wanted": job_id}).one_or_none()
        return None if row is None else (_job(row), read_json(row.rows or "[]"))

    def newest(
        self, kind: JobKind, *, state: JobState | None = None, behind: tuple[float, str] | None = None, limit: int = 50
    ) -> list[Job]:
        """The newest jobs first; `behind` goes on behind the job created at that Unix time [s] with that id."""
        with self._database.read() as connection:
            return [_job(row) for row in connection.execute(newest(kind, state, behind, limit))]

    def of_twin(self, kind: JobKind, twin_id: str, limit: int) -> list[Job]:
        """The jobs of one kind whose summary names a twin, the newest first."""
        query = newest(kind, None, None, limit).where(_names(twin_id))
        with self._database.read() as connection:
            return [_job(row) for row in connection.execute(query)]

    def forget_of_twin(self, kind: JobKind, twin_id: str, but: int = 0) -> int:
        """Forget such jobs, but for the newest `but`; how many there were."""
        kept = newest(kind, None, None, but).where(_names(twin_id)).with_only_columns(jobs.c.id)
        which = jobs.c.kind == kind, _names(twin_id), jobs.c.id.not_in(kept.subquery().select())
        with self._database.write() as connection:
            return connection.execute(jobs.delete().where(*which)).rowcount

    def claim(self, owner: str, lease_s: float, attempts_max: int) -> Lease | None:
        """The next chunk for `owner`, or None. A job whose chunk was lost `attempts_max` times fails."""
        now = time.time()
        free = (
            sa.select(
                chunks.c.job_id, chunks.c.number, chunks.c.attempt, chunks.c.work, chunks.c.runs, chunks.c.priority
            )
            .where(chunks.c.open, chunks.c.lease_until < now)
            .order_by(chunks.c.priority, chunks.c.job_id, chunks.c.number)
            .limit(1)
        )
        with self._database.read() as connection:  # most often there is nothing: do not ask for the write lock
            if connection.execute(free).one_or_none() is None:
                return None
        with self._database.write() as connection:
            found = connection.execute(free.with_for_update(skip_locked=True)).one_or_none()
            if found is None:
                return None
            lease = Lease(found.job_id, found.number, found.attempt + 1, found.work, found.runs, found.priority)
            if lease.attempt > attempts_max:
                problem = {
                    "title": "Workers died",
                    "detail": f"chunk {lease.chunk} took down {attempts_max} workers; the limit is attempts_max",
                }
                _close(connection, lease.job, JobState.FAILED, problem)
                return None
            connection.execute(
                chunks.update().where(_is(lease)).values(owner=owner, attempt=lease.attempt, lease_until=now + lease_s)
            )
            connection.execute(
                jobs.update()
                .where(jobs.c.id == lease.job, jobs.c.state == JobState.QUEUED)
                .values(state=JobState.RUNNING, started=now)
            )
            return lease

    def renew(self, lease: Lease, lease_s: float) -> None:
        """Go on holding a chunk.

        Raises
        ------
        Superseded
            if the chunk is somebody else's or the job has ended.
        """
        with self._database.write() as connection:
            held = chunks.update().where(_is(lease), chunks.c.open, chunks.c.attempt == lease.attempt)
            _fenced(connection.execute(held.values(lease_until=time.time() + lease_s)))

    def advance(self, lease: Lease, part: float) -> None:
        """Tell how much of a job of one chunk is done: 0 to 1.

        Raises
        ------
        Superseded
            as for `renew`.
        """
        held = sa.select(chunks.c.attempt).where(_is(lease), chunks.c.open, chunks.c.attempt == lease.attempt)
        told = jobs.update().where(jobs.c.id == lease.job, sa.exists(held)).values(progress=part)
        with self._database.write() as connection:
            _fenced(connection.execute(told))

    def complete(self, lease: Lease, done: ChunkResult) -> None:
        """Store a chunk's result, close it, and open what was cut off it, in one transaction.

        Raises
        ------
        Superseded
            if the chunk is somebody else's or done, or the job has ended; nothing is written.
        """
        with self._database.write() as connection:
            held = chunks.update().where(_is(lease), chunks.c.open, chunks.c.attempt == lease.attempt)
            _fenced(connection.execute(held.values(open=False, lease_until=0.0, owner=None, runs=done.runs)))
            connection.execute(results.insert(), {"job_id": lease.job, "number": lease.chunk, "rows": done.rows})
            if done.rest:
                priority = sa.select(chunks.c.priority).where(_is(lease)).scalar_subquery()
                rows = [_row(lease.job, piece) for piece in done.rest]
                connection.execute(chunks.insert().values(priority=priority), rows)
            if done.parquet is not None:
                connection.execute(series.insert(), {"job_id": lease.job, "parquet": done.parquet})
            if done.records:
                kept = [{"job_id": lease.job, "number": each, "parquet": blob} for each, blob in done.records.items()]
                connection.execute(run_records.insert(), kept)
            runs_done = jobs.c.runs_done + done.runs
            ended = runs_done == jobs.c.runs
            connection.execute(
                jobs.update()
                .where(jobs.c.id == lease.job)
                .values(
                    runs_done=runs_done,
                    state=sa.case((ended, JobState.SUCCEEDED.value), else_=jobs.c.state),
                    finished=sa.case((ended, time.time()), else_=jobs.c.finished),
                )
            )

    def fail(self, lease: Lease, problem: dict[str, Any]) -> None:
        """End the job of this chunk with a problem.

        Raises
        ------
        Superseded
            as for `complete`.
        """
        with self._database.write() as connection:
            held = chunks.update().where(_is(lease), chunks.c.open, chunks.c.attempt == lease.attempt)
            _fenced(connection.execute(held.values(open=False, lease_until=0.0, owner=None)))
            _close(connection, lease.job, JobState.FAILED, problem)

    def give_back(self, lease: Lease) -> None:
        """Let another have a chunk at once.

        Raises
        ------
        Superseded
            as for `renew`.
        """
        with self._database.write() as connection:
            held = chunks.update().where(_is(lease), chunks.c.open, chunks.c.attempt == lease.attempt)
            _fenced(connection.execute(held.values(owner=None, lease_until=0.0)))

    def release(self, owner: str) -> None:
        """Give back what an owner held who is known to be dead; a name ending in * stands for all that begin so."""
        same = (
            chunks.c.owner.startswith(owner[:-1], autoescape=True) if owner.endswith("*") else chunks.c.owner == owner
        )
        with self._database.write() as connection:
            connection.execute(chunks.update().where(chunks.c.open, same).values(owner=None, lease_until=0.0))

    def cancel(self, job_id: str) -> Job | None:
        """End a job where it stands; its results so far stay. A job that has ended stays as it is."""
        with self._database.write() as connection:
            _close(connection, job_id, JobState.CANCELLED, None)
        return self.get(job_id)

    def remove(self, job_id: str) -> None:
        """Forget a job with its results."""
        with self._database.write() as connection:
            connection.execute(jobs.delete().where(jobs.c.id == job_id))

    def results(self, job_id: str) -> list[dict[str, Any]]:
        """One row a finished run, in the order of the job's chunks."""
        query = sa.select(results.c.rows).where(results.c.job_id == job_id).order_by(results.c.number)
        with self._database.read() as connection:
            return [row for rows in connection.scalars(query) for row in read_json(rows)]

    def results_of(self, job_ids: Sequence[str]) -> dict[str, Sequence[dict[str, Any]]]:
        """The results of several jobs of one chunk each."""
        query = sa.select(results.c.job_id, results.c.rows).where(results.c.job_id.in_(job_ids))
        with self._database.read() as connection:
            return {row.job_id: read_json(row.rows) for row in connection.execute(query)}

    def series(self, job_id: str) -> bytes | None:
        """A run's record as a Parquet file."""
        with self._database.read() as connection:
            return connection.scalar(sa.select(series.c.parquet).where(series.c.job_id == job_id))

    def record(self, job_id: str, number: int) -> bytes | None:
        """The record of one run of a comparison as a Parquet file, by the run's number in the comparison's order."""
        query = sa.select(run_records.c.parquet).where(run_records.c.job_id == job_id, run_records.c.number == number)
        with self._database.read() as connection:
            return connection.scalar(query)

    def counts(self) -> dict[tuple[str, str], int]:
        """How many jobs there are by kind and state."""
        query = sa.select(jobs.c.kind, jobs.c.state, sa.func.count()).group_by(jobs.c.kind, jobs.c.state)
        with self._database.read() as connection:
            return {(row[0], row[1]): row[2] for row in connection.execute(query)}

    def waiting(self) -> int:
        """How many chunks nobody works on yet."""
        free = chunks.c.open, chunks.c.lease_until < time.time()
        with self._database.read() as connection:
            return connection.scalar(sa.select(sa.func.count()).select_from(chunks).where(*free)) or 0

    def prune(self, before: float) -> int:
        """Forget jobs that ended before this Unix time [s]; how many there were."""
        with self._database.write() as connection:
            return connection.execute(jobs.delete().where(jobs.c.finished < before)).rowcount


def _jobs() -> sa.Select[Any]:
    return sa.select(*(column for column in jobs.c if column is not jobs.c.spec))


_BY_ID = _jobs().where(jobs.c.id == sa.bindparam("wanted"))

_WITH_RESULT = (
    _jobs()
    .add_columns(results.c.rows)
    .join_from(jobs, results, sa.and_(results.c.job_id == jobs.c.id, results.c.number == 0), isouter=True)
    .where(jobs.c.id == sa.bindparam("wanted"))
)


def _row(job_id: str, piece: Chunk) -> dict[str, Any]:
    """A chunk nobody has claimed yet, but for its priority."""
    return {
        "job_id": job_id, "number": piece.number, "work": piece.items, "runs": piece.runs, "open": True, "attempt": 0,
        "lease_until": 0.0,
    }  # fmt: skip


def newest(kind: JobKind, state: JobState | None, behind: tuple[float, str] | None, limit: int) -> sa.Select[Any]:
    """The query of `JobRepository.newest`; an index has its order, so that a page costs what it shows."""
    query = _jobs().where(jobs.c.kind == kind).order_by(jobs.c.created.desc(), jobs.c.id.desc()).limit(limit)
    if state:
        query = query.where(jobs.c.state == state)
    if behind:
        created, last = behind
        query = query.where(sa.tuple_(jobs.c.created, jobs.c.id) < sa.tuple_(sa.literal(created), sa.literal(last)))
    return query


def _names(twin_id: str) -> sa.ColumnElement[bool]:
    return jobs.c.about["twin"].as_string() == twin_id


def _is(lease: Lease) -> sa.ColumnElement[bool]:
    return sa.and_(chunks.c.job_id == lease.job, chunks.c.number == lease.chunk)


def _fenced(done: sa.CursorResult[Any]) -> None:
    if done.rowcount != 1:
        raise Superseded


def _close(connection: sa.Connection, job_id: str, state: JobState, problem: dict[str, Any] | None) -> None:
    """End a job that has not ended; chunks before jobs, as everywhere, so that nobody waits in a circle."""
    connection.execute(
        chunks.update().where(chunks.c.job_id == job_id, chunks.c.open).values(open=False, owner=None, lease_until=0.0)
    )
    connection.execute(
        jobs.update()
        .where(jobs.c.id == job_id, jobs.c.state.in_(_OPEN_STATES))
        .values(state=state, finished=time.time(), error=problem)
    )


def _job(row: Any) -> Job:
    return Job(
        row.id, JobKind(row.kind), row.about, JobState(row.state), row.created, row.started, row.finished, row.runs,
        row.runs_done, row.error, row.progress,
    )  # fmt: skip
