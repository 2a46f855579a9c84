"""Jobs in worker processes: same results as in this process, whoever is killed."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from multiprocessing.context import ForkServerProcess
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from api.comparisons import job as comparison_job
from api.comparisons.job import CHUNK_S, RECORDS_BYTES, comparison_spec, split_chunk
from api.comparisons.service import compare
from api.jobs import pool as pools
from api.jobs import worker
from api.jobs.pool import WorkerPool
from api.jobs.worker import Worker
from api.packing import Kept, whole
from api.runs.job import run_spec
from api.server.job_kinds import JOB_TYPES
from api.settings import Settings
from api.store.database import StoreError
from api.store.jobs import JobRepository
from api.store.records import Chunk, JobKind, JobState, Superseded
from controllers import create
from station import Record, load_scenario, simulate
from tests.pace import slowness
from tests.waiting import wait_until

SCENARIOS = [load_scenario(name) for name in ("S1", "S2")]
FOUR = ["logic", "minlp1", "minlp2", "minlp3"]


@pytest.fixture
def settings(database_url):
    return Settings(database=database_url, workers=2, lease_s=2.0)


@pytest.fixture
def repository(database):
    return JobRepository(database)


def _submit(repository, kind, spec):
    of = JOB_TYPES[kind]
    return repository.add(kind, spec, of.summarize(spec), of.initial_chunks(spec), open_max=10)


def _rows(scenarios, controllers, replications=1, seed=0):
    return [result.as_row() for result in compare(scenarios, controllers, replications=replications, seed=seed)]


def test_pieces_cover_every_run_once():
    spec = comparison_spec(SCENARIOS, ["logic", "minlp1"], 120, 0)
    found = JOB_TYPES[JobKind.COMPARISON].initial_chunks(spec)
    runs = [(chunk.items["scenario"], chunk.items["controller"], k) for chunk in found for k in range(chunk.runs)]
    assert runs == [(s, c, k) for s in range(2) for c in range(2) for k in range(120)]
    assert [chunk.number for chunk in found] == [0, 120, 240, 360]


@given(st.integers(0, 5000), st.integers(0, 5000), st.floats(1e-4, 100), st.floats(0, 1e8))
def test_what_is_cut_covers_every_run_once_in_even_chunks(number, runs, run_s, run_bytes):
    found = list(split_chunk(Chunk(number, {"first": 7, "end_s": 1.0, "scenario": 3}, runs), run_s, run_bytes))
    assert [number + k for k in range(runs)] == [chunk.number + k for chunk in found for k in range(chunk.runs)]
    assert [7 + k for k in range(runs)] == [chunk.items["first"] + k for chunk in found for k in range(chunk.runs)]
    sizes = [chunk.runs for chunk in found]
    assert max(sizes, default=0) - min(sizes, default=0) <= 1
    assert all(size == 1 or (size - 1) * run_s <= CHUNK_S for size in sizes)
    assert all(size == 1 or (size - 1) * run_bytes <= RECORDS_BYTES for size in sizes)
    assert all(chunk.items["scenario"] == 3 for chunk in found)


@pytest.mark.slow
def test_results_do_not_depend_on_how_chunks_are_cut(repository, settings, monkeypatch):
    monkeypatch.setattr(comparison_job, "PROBE_S", 0.0)
    monkeypatch.setattr(comparison_job, "CHUNK_S", 0.01)
    job = _submit(repository, JobKind.COMPARISON, comparison_spec(SCENARIOS, ["logic", "minlp3"], 9, 4))
    worker = Worker(repository, settings, "here", JOB_TYPES)
    chunks = 0
    while worker.step():
        chunks += 1
    assert 8 < chunks <= 36
    assert repository.get(job.id).state == JobState.SUCCEEDED
    assert repository.results(job.id) == _rows(SCENARIOS, ["logic", "minlp3"], 9, 4)


def _cut_by_time(monkeypatch):
    monkeypatch.setattr(comparison_job, "PROBE_S", 0.0)
    monkeypatch.setattr(comparison_job, "CHUNK_S", 0.01)


def _cut_by_size(monkeypatch):
    monkeypatch.setattr(comparison_job, "RECORDS_BYTES", 100_000)
    monkeypatch.setattr(comparison_job, "RECORDS_END_BYTES", 100_000)


@pytest.mark.slow
@pytest.mark.parametrize("shorten", [_cut_by_time, _cut_by_size])
def test_records_of_a_comparison_do_not_depend_on_how_chunks_are_cut(repository, settings, monkeypatch, shorten):
    """Nor on an attempt that was lost: what it computed is stored by the next one alone."""
    shorten(monkeypatch)
    spec = comparison_spec(SCENARIOS, ["logic", "minlp3"], 4, 4, Kept.FULL)
    job = _submit(repository, JobKind.COMPARISON, spec)
    late = repository.claim("late", 0.0, 3)
    of = JOB_TYPES[JobKind.COMPARISON]
    computed = of.compute(of.task(spec, late))
    assert computed.records
    worker = Worker(repository, settings, "here", JOB_TYPES)
    chunks = 0
    while worker.step():
        chunks += 1
    assert chunks > 4
    with pytest.raises(Superseded):
        repository.complete(late, computed)
    runs = [(scenario, name, k) for scenario in SCENARIOS for name in ("logic", "minlp3") for k in range(4)]
    for number, (scenario, name, replication) in enumerate(runs):
        expected = simulate(scenario, create(name), replication=replication, seed=4)
        assert Record.from_parquet(whole(repository.record(job.id, number))).to_bytes() == expected.to_bytes()
    assert repository.record(job.id, len(runs)) is None


def test_a_controller_that_fails_fails_its_job_and_not_the_worker(repository, settings, monkeypatch):
    job = _submit(repository, JobKind.RUN, run_spec(SCENARIOS[0], "nobody", 0, 0))
    good = _submit(repository, JobKind.RUN, run_spec(SCENARIOS[0], "logic", 0, 0))
    worker = Worker(repository, settings, "here", JOB_TYPES)
    assert worker.step()
    assert worker.step()
    failed = repository.get(job.id)
    assert failed.state == JobState.FAILED
    assert "nobody" in failed.error["detail"]
    assert repository.get(good.id).state == JobState.SUCCEEDED


def test_a_run_that_fails_ends_its_comparison_and_is_named(repository, settings):
    job = _submit(repository, JobKind.COMPARISON, comparison_spec(SCENARIOS, ["logic", "nobody"], 2, 0))
    worker = Worker(repository, settings, "here", JOB_TYPES)
    while worker.step():
        pass
    failed = repository.get(job.id)
    assert (failed.state, failed.runs_done) == (JobState.FAILED, 2)
    assert failed.error["run"] == {"scenario": SCENARIOS[0].name, "controller": "nobody", "replication": 0}
    assert "nobody" in failed.error["detail"]
    assert repository.results(job.id) == _rows(SCENARIOS[:1], ["logic"], 2)


def _freeze(pids, repository):
    """Stop processes, none of them inside a transaction: SQLite has one writer, and would wait for that one."""
    while True:
        for pid in pids:
            os.kill(pid, signal.SIGSTOP)
        try:
            repository.release("nobody")
        except StoreError:
            for pid in pids:
                os.kill(pid, signal.SIGCONT)
            time.sleep(0.05)
        else:
            return


@pytest.mark.slow
def test_a_frozen_worker_loses_its_chunk_and_cannot_write_it_later(repository, settings):
    pool = WorkerPool(settings.model_copy(update={"lease_s": 1.0}), repository, JOB_TYPES)
    pool.start()
    try:
        slow = "minlp1:horizon=5:node_limit=5000"  # some 2.5 s a run
        job = _submit(repository, JobKind.COMPARISON, comparison_spec(SCENARIOS[:1], [slow], 2, 0))
        pool.wake()
        while repository.get(job.id).state == JobState.QUEUED:
            time.sleep(0.02)
        frozen = [member.process.pid for member in pool._members]
        _freeze(frozen, repository)
        time.sleep(1.2)
        quick = Worker(repository, settings, "other", JOB_TYPES)
        taken = repository.claim("other", 60, 20)
        assert taken is not None
        assert taken.attempt == 2
        for pid in frozen:
            os.kill(pid, signal.SIGCONT)
        time.sleep(1.0)
        assert repository.results(job.id) == []
    finally:
        pool.close()  # a worker of the pool would take the chunk when it is given back
    repository.release("other")
    while quick.step():
        pass
    assert repository.get(job.id).state == JobState.SUCCEEDED
    assert len(repository.results(job.id)) == 2


@pytest.mark.slow
def test_a_frozen_worker_keeps_nobody_from_submitting(repository, settings):
    """What wakes it fills its queue; a hundredth of these did, and the next request waited for ever."""
    pool = WorkerPool(settings.model_copy(update={"workers": 1}), repository, JOB_TYPES)
    pool.start()
    while not pool._members:
        time.sleep(0.01)
    frozen = [pool._members[0].process.pid]
    _freeze(frozen, repository)
    try:
        waking = threading.Thread(target=lambda: [pool.wake() for _ in range(30_000)], daemon=True)
        waking.start()
        waking.join(60)
        assert not waking.is_alive()
        assert pool.alive == 1
    finally:
        os.kill(frozen[0], signal.SIGCONT)
        pool.close()


def test_waking_a_worker_that_has_died_is_no_error(repository, settings):
    """Its link is closed before another takes its place."""
    pool = WorkerPool(settings, repository, JOB_TYPES)
    here, there = multiprocessing.Pipe()
    pool._members.append(SimpleNamespace(link=here))
    pool.wake()
    assert there.poll(0)
    here.close()
    pool.wake()
    there.close()


@pytest.mark.slow
def test_a_fork_server_that_dies_while_it_makes_a_worker_costs_none(repository, settings, monkeypatch):
    monkeypatch.setattr(pools, "SHORT_LIFE_S", 0.05)
    dying = iter([EOFError("unexpected EOF"), ConnectionRefusedError()])
    begin = ForkServerProcess.start

    def start(process):
        if (error := next(dying, None)) is not None:
            raise error
        begin(process)

    monkeypatch.setattr(ForkServerProcess, "start", start)
    pool = WorkerPool(settings, repository, JOB_TYPES)
    pool.start()
    try:
        wait_until(lambda: pool.alive == pool.wanted)
    finally:
        pool.close()
    assert next(dying, None) is None


def test_what_a_worker_has_computed_waits_for_a_store_that_is_full(repository, settings, monkeypatch):
    monkeypatch.setattr(worker, "IDLE_S", 0.01)
    job = _submit(repository, JobKind.RUN, run_spec(SCENARIOS[0], "logic", 0, 0))
    bad = _submit(repository, JobKind.RUN, run_spec(SCENARIOS[0], "nobody", 0, 0))
    tries = []

    def troubled(name):
        write = getattr(repository, name)

        def tried(lease, what):
            tries.append((name, lease.attempt))
            if len(tries) % 4:
                raise StoreError("full")
            write(lease, what)

        monkeypatch.setattr(repository, name, tried)

    troubled("complete")
    troubled("fail")
    here = Worker(repository, settings, "here", JOB_TYPES)
    assert here.step()
    assert here.step()
    assert tries == [("complete", 1)] * 4 + [("fail", 1)] * 4
    assert repository.get(job.id).state == JobState.SUCCEEDED
    assert repository.get(bad.id).state == JobState.FAILED


def test_a_result_whose_storing_nobody_heard_of_is_stored_once(repository, settings, monkeypatch):
    job = _submit(repository, JobKind.RUN, run_spec(SCENARIOS[0], "logic", 0, 0))
    complete = repository.complete

    def unheard(lease, done):
        complete(lease, done)
        raise StoreError("the connection was lost")

    monkeypatch.setattr(repository, "complete", unheard)
    told = []
    assert Worker(repository, settings, "here", JOB_TYPES, lambda *about: told.append(about[-1])).step()
    assert told == ["superseded"]
    assert (repository.get(job.id).state, len(repository.results(job.id))) == (JobState.SUCCEEDED, 1)


def test_workers_are_gone_when_the_pool_is_closed(repository, settings):
    pool = WorkerPool(settings, repository, JOB_TYPES)
    pool.start()
    while len(pool._members) < 2:
        time.sleep(0.01)
    pids = [member.process.pid for member in pool._members]
    began = time.monotonic()
    pool.close()
    assert time.monotonic() - began < 5 * slowness()
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


@pytest.mark.slow
def test_a_worker_whose_server_is_gone_ends_without_a_word(settings, database, capfd):
    ours, theirs = multiprocessing.Pipe()
    process = multiprocessing.get_context("spawn").Process(target=worker.work, args=(settings, "w", JOB_TYPES, theirs))
    process.start()
    theirs.close()
    ours.close()
    process.join(60)
    assert process.exitcode == 0
    assert capfd.readouterr().err == ""
