"""The lease table: every chunk ends with one result, on both databases, whoever comes back from the dead."""

from __future__ import annotations

import threading
import time
from contextlib import suppress

import pytest

from api.store.database import Database, SilentStoreError
from api.store.jobs import JobRepository, newest
from api.store.records import CapacityError, Chunk, ChunkResult, JobKind, JobState, Superseded
from api.store.twins import TwinRepository

CHUNKS = [Chunk(k, {"first": 10 * k}, 10) for k in range(4)]


@pytest.fixture
def repository(database):
    return JobRepository(database)


def _add(repository, kind=JobKind.COMPARISON, pieces=CHUNKS):
    return repository.add(kind, {"seed": 3}, {"seeds": 1}, pieces, open_max=10)


def _done(rows, parquet=None, *, runs=10, rest=()):
    return ChunkResult(rows, runs, rest, parquet)


def _claim(repository, owner="a", lease_s=60.0):
    return repository.claim(owner, lease_s, attempts_max=3)


def test_a_job_runs_through_its_states(repository):
    job = _add(repository)
    assert (job.state, job.runs, job.runs_done, job.summary) == (JobState.QUEUED, 40, 0, {"seeds": 1})
    assert repository.spec(job.id) == {"seed": 3}
    for number in range(4):
        lease = _claim(repository)
        assert (lease.job, lease.chunk, lease.items, lease.attempt) == (job.id, number, {"first": 10 * number}, 1)
        assert repository.get(job.id).state == JobState.RUNNING
        repository.complete(lease, _done(b'[{"n": %d}]' % number))
    assert _claim(repository) is None
    done = repository.get(job.id)
    assert done.state == JobState.SUCCEEDED
    assert done.runs_done == 40
    assert done.created <= done.started <= done.finished
    assert repository.results(job.id) == [{"n": number} for number in range(4)]


def test_what_is_cut_off_a_chunk_is_done_in_its_place(repository):
    job = _add(repository, pieces=[Chunk(0, {"first": 0}, 10), Chunk(10, {"first": 10}, 5)])
    rest = (Chunk(3, {"first": 3}, 4), Chunk(7, {"first": 7}, 3))
    repository.complete(_claim(repository), _done(b"[0,1,2]", runs=3, rest=rest))
    assert repository.get(job.id).runs_done == 3
    for number, runs, rows in ((3, 4, b"[3,4,5,6]"), (7, 3, b"[7,8,9]"), (10, 5, b"[10,11,12,13,14]")):
        lease = _claim(repository)
        assert (lease.chunk, lease.runs, lease.attempt) == (number, runs, 1)
        repository.complete(lease, _done(rows, runs=runs))
    assert repository.results(job.id) == list(range(15))
    assert repository.get(job.id).state == JobState.SUCCEEDED


def test_a_chunk_that_is_lost_is_not_cut(repository):
    _add(repository, pieces=CHUNKS[:1])
    lost = _claim(repository, "a", lease_s=0.05)
    time.sleep(0.1)
    assert _claim(repository, "b").attempt == 2
    with pytest.raises(Superseded):
        repository.complete(lost, _done(b"[1]", runs=1, rest=(Chunk(1, {}, 9),)))
    assert _claim(repository, "c") is None


def test_an_expired_lease_goes_to_another_and_the_first_can_write_nothing(repository, database):
    job = _add(repository, pieces=CHUNKS[:1])
    lost = _claim(repository, "a")
    assert _claim(repository, "b") is None
    with database.write() as connection:
        connection.exec_driver_sql("UPDATE chunks SET lease_until = 1")
    held = _claim(repository, "b")
    assert (held.chunk, held.attempt) == (0, 2)
    for write in (
        lambda: repository.complete(lost, _done(b"[1]")),
        lambda: repository.renew(lost, 9),
        lambda: repository.fail(lost, {}),
    ):
        with pytest.raises(Superseded):
            write()
    assert repository.results(job.id) == []
    repository.complete(held, _done(b"[2]"))
    with pytest.raises(Superseded):
        repository.complete(held, _done(b"[2]"))
    assert repository.results(job.id) == [2]


def test_a_renewed_lease_is_kept(repository):
    _add(repository, pieces=CHUNKS[:1])
    lease = _claim(repository, lease_s=0.3)
    repository.renew(lease, 60)
    time.sleep(0.4)
    assert _claim(repository, "b") is None
    repository.complete(lease, _done(b"[]"))


def test_what_a_dead_worker_held_is_given_back_at_once(repository):
    _add(repository, pieces=CHUNKS[:2])
    first, second = _claim(repository, "hrs/1"), _claim(repository, "hrs2/1")
    repository.release("hrs/*")
    assert _claim(repository, "c").chunk == first.chunk
    assert _claim(repository, "c") is None
    repository.release("hrs2/1")
    assert _claim(repository, "c").chunk == second.chunk


def test_a_chunk_that_takes_down_its_workers_fails_its_job_alone(repository):
    bad = _add(repository, pieces=CHUNKS[:1])
    for _ in range(3):
        assert _claim(repository).job == bad.id
        repository.release("a")
    assert _claim(repository) is None
    job = repository.get(bad.id)
    assert job.state == JobState.FAILED
    assert "attempts_max" in job.error["detail"]
    good = _add(repository, pieces=CHUNKS[:1])
    assert _claim(repository).job == good.id


def test_a_failed_chunk_ends_the_job(repository):
    job = _add(repository)
    first, second = _claim(repository), _claim(repository)
    repository.fail(first, {"title": "no", "detail": "it cannot be"})
    assert repository.get(job.id).state == JobState.FAILED
    assert repository.get(job.id).error == {"title": "no", "detail": "it cannot be"}
    with pytest.raises(Superseded):
        repository.complete(second, _done(b"[]"))
    assert _claim(repository) is None


def test_cancelled_work_is_not_finished(repository):
    job = _add(repository)
    lease = _claim(repository)
    assert repository.cancel(job.id).state == JobState.CANCELLED
    with pytest.raises(Superseded):
        repository.complete(lease, _done(b"[]"))
    assert _claim(repository) is None
    assert repository.cancel(job.id).finished == repository.get(job.id).finished
    assert repository.cancel("none") is None


def test_a_run_does_not_wait_for_a_comparison(repository):
    _add(repository)
    run = _add(repository, JobKind.RUN, CHUNKS[:1])
    lease = _claim(repository)
    assert lease.job == run.id
    repository.complete(lease, _done(b"[]", b"PAR1"))
    assert repository.series(run.id) == b"PAR1"


def test_newest_jobs_come_first_in_pages(repository):
    ids = [_add(repository, pieces=CHUNKS[:1]).id for _ in range(5)][::-1]
    assert [job.id for job in repository.newest(JobKind.COMPARISON, limit=3)] == ids[:3]
    third = repository.get(ids[2])
    behind = {"behind": (third.created, third.id)}
    assert [job.id for job in repository.newest(JobKind.COMPARISON, **behind)] == ids[3:]
    _add(repository, pieces=CHUNKS[:1])
    repository.remove(third.id)
    assert [job.id for job in repository.newest(JobKind.COMPARISON, **behind)] == ids[3:]
    assert repository.newest(JobKind.RUN) == []
    assert repository.newest(JobKind.COMPARISON, state=JobState.SUCCEEDED) == []


@pytest.mark.parametrize("behind", [None, (1.0e9, "run-0")])
@pytest.mark.parametrize("state", [None, JobState.RUNNING])
def test_a_page_is_read_from_an_index(database, state, behind):
    of_jobs = f"ix_jobs_kind_{'state_' if state else ''}created_id"
    _read_from(database, newest(JobKind.RUN, state, behind, 10), of_jobs)
    _read_from(database, TwinRepository(database, "one").oldest(behind, 10), "ix_twins_instance_created_id")


def _read_from(database, query, index):
    text = str(query.compile(database.engine, compile_kwargs={"literal_binds": True}))
    with database.read() as connection:
        if database.sqlite:
            plan = "\n".join(row[3] for row in connection.exec_driver_sql(f"EXPLAIN QUERY PLAN {text}"))
            assert f"USING INDEX {index}" in plan, plan
            assert "TEMP B-TREE" not in plan, plan
        else:
            connection.exec_driver_sql("SET LOCAL enable_seqscan = off")  # the tables are empty
            connection.exec_driver_sql("SET LOCAL enable_bitmapscan = off")
            plan = "\n".join(row[0] for row in connection.exec_driver_sql(f"EXPLAIN {text}"))
            assert f"using {index}" in plan, plan
            assert "Sort" not in plan, plan


def test_there_is_a_limit_on_open_jobs(repository):
    for _ in range(10):
        _add(repository, pieces=CHUNKS[:1])
    with pytest.raises(CapacityError):
        _add(repository)
    repository.cancel(repository.newest(JobKind.COMPARISON, limit=1)[0].id)
    _add(repository)


def test_old_jobs_are_forgotten_with_all_they_left(repository, database):
    job = _add(repository, JobKind.RUN, CHUNKS[:1])
    repository.complete(_claim(repository), ChunkResult(b"[1]", 10, parquet=b"PAR1", records={3: b"PAR1"}))
    assert repository.record(job.id, 3) == b"PAR1"
    assert repository.prune(time.time() - 60) == 0
    assert repository.prune(time.time() + 60) == 1
    assert repository.get(job.id) is None
    with database.read() as connection:
        for table in ("chunks", "results", "series", "run_records"):
            assert connection.exec_driver_sql(f"SELECT count(*) FROM {table}").scalar() == 0  # noqa: S608  # names of ours


def _insist(call, *arguments):
    """What a worker does while a store, busy with others, does not answer: it asks again."""
    for _ in range(50):
        with suppress(SilentStoreError):
            return call(*arguments)
    return call(*arguments)


@pytest.mark.slow
def test_many_workers_do_each_chunk_once(repository, database_url):
    job = _add(repository, pieces=[Chunk(k, {"k": k}, 1) for k in range(60)])
    done: list[int] = []

    def work(owner: str) -> None:
        database = Database(database_url)
        own = JobRepository(database)
        while (lease := _insist(own.claim, owner, 60, 3)) is not None:
            _insist(own.complete, lease, _done(b"[%d]" % lease.chunk, runs=1))
            done.append(lease.chunk)
        database.close()

    workers = [threading.Thread(target=work, args=(f"w{k}",)) for k in range(6)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert sorted(done) == list(range(60))
    assert repository.results(job.id) == list(range(60))
    assert repository.get(job.id).state == JobState.SUCCEEDED
