"""Jobs in worker processes: same results as in this process, whoever is killed."""

from __future__ import annotations

import os
import random
import signal
import time

import pytest

from api.comparisons.service import compare
from api.jobs.pool import WorkerPool
from api.jobs.work import about, comparison_spec, pieces, run_spec
from api.jobs.worker import Worker
from api.settings import Settings
from api.store.jobs import JobRepository
from api.store.records import JobKind, JobState
from controllers import create
from station import Record, load_scenario, simulate

SCENARIOS = [load_scenario(name) for name in ("S1", "S2")]
FOUR = ["logic", "minlp1", "minlp2", "minlp3"]


@pytest.fixture
def settings(database_url):
    return Settings(database=database_url, workers=2, lease_s=2.0)


@pytest.fixture
def repository(database):
    return JobRepository(database)


def _submit(repository, kind, spec):
    return repository.add(kind, spec, about(kind, spec), pieces(kind, spec), open_max=10)


def _wait(repository, job, seconds=60.0):
    until = time.monotonic() + seconds
    while not (found := repository.get(job.id)).state.final:
        assert time.monotonic() < until, found
        time.sleep(0.05)
    return found


def _rows(scenarios, controllers, replications=1, seed=0):
    return [result.as_row() for result in compare(scenarios, controllers, replications=replications, seed=seed)]


def test_pieces_cover_every_run_once():
    spec = comparison_spec(SCENARIOS, ["logic", "minlp1"], 120, 0)
    runs = [
        (chunk.work["scenario"], chunk.work["controller"], chunk.work["first"] + k)
        for chunk in pieces(JobKind.COMPARISON, spec)
        for k in range(chunk.runs)
    ]
    assert runs == [(s, c, k) for s in range(2) for c in range(2) for k in range(120)]


def test_a_run_leaves_its_record(repository, settings):
    job = _submit(repository, JobKind.RUN, run_spec(SCENARIOS[0], "minlp1:horizon=2", 3, 7))
    worker = Worker(repository, settings, "here")
    assert worker.step()
    assert not worker.step()
    assert repository.get(job.id).state == JobState.SUCCEEDED
    expected = simulate(SCENARIOS[0], create("minlp1", horizon=2), replication=3, seed=7)
    assert Record.from_parquet(repository.series(job.id)).to_bytes() == expected.to_bytes()
    assert repository.results(job.id) == _rows(SCENARIOS[:1], ["minlp1:horizon=2"], 4, 7)[3:]


def test_a_controller_that_fails_fails_its_job_and_not_the_worker(repository, settings, monkeypatch):
    job = _submit(repository, JobKind.RUN, run_spec(SCENARIOS[0], "nobody", 0, 0))
    good = _submit(repository, JobKind.RUN, run_spec(SCENARIOS[0], "logic", 0, 0))
    worker = Worker(repository, settings, "here")
    assert worker.step()
    assert worker.step()
    failed = repository.get(job.id)
    assert failed.state == JobState.FAILED
    assert "nobody" in failed.error["detail"]
    assert repository.get(good.id).state == JobState.SUCCEEDED


def test_a_run_that_fails_ends_its_comparison_and_is_named(repository, settings):
    job = _submit(repository, JobKind.COMPARISON, comparison_spec(SCENARIOS, ["logic", "nobody"], 2, 0))
    worker = Worker(repository, settings, "here")
    assert worker.step()
    assert worker.step()
    assert not worker.step()
    failed = repository.get(job.id)
    assert (failed.state, failed.runs_done) == (JobState.FAILED, 2)
    assert failed.error["run"] == {"scenario": SCENARIOS[0].name, "controller": "nobody", "replication": 0}
    assert "nobody" in failed.error["detail"]
    assert repository.results(job.id) == _rows(SCENARIOS[:1], ["logic"], 2)


def test_workers_that_are_killed_again_and_again_lose_and_double_nothing(repository, settings):
    replications = 40
    spec = comparison_spec(SCENARIOS, FOUR, replications, 5)
    job = _submit(repository, JobKind.COMPARISON, spec)
    pool = WorkerPool(settings, repository)
    pool.start()
    chance = random.Random(11)
    kills = 0
    try:
        while not repository.get(job.id).state.final and kills < 10:
            time.sleep(chance.uniform(0.05, 0.3))
            with pool._lock:
                victim = chance.choice(pool._members).process if pool._members else None
            if victim is not None and victim.is_alive():
                victim.kill()
                kills += 1
        done = _wait(repository, job)
    finally:
        pool.close()
    assert kills > 0
    assert done.state == JobState.SUCCEEDED
    assert done.runs_done == 8 * replications
    assert repository.results(job.id) == _rows(SCENARIOS, FOUR, replications, 5)


def test_a_frozen_worker_loses_its_chunk_and_cannot_write_it_later(repository, settings):
    pool = WorkerPool(settings.model_copy(update={"lease_s": 1.0}), repository)
    pool.start()
    try:
        slow = "minlp1:horizon=5:node_limit=5000"  # some 2.5 s a run
        job = _submit(repository, JobKind.COMPARISON, comparison_spec(SCENARIOS[:1], [slow], 2, 0))
        pool.wake()
        while repository.get(job.id).state == JobState.QUEUED:
            time.sleep(0.02)
        frozen = [member.process.pid for member in pool._members]
        for pid in frozen:
            os.kill(pid, signal.SIGSTOP)
        time.sleep(1.2)
        quick = Worker(repository, settings, "other")
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
    assert quick.step()
    assert repository.get(job.id).state == JobState.SUCCEEDED
    assert len(repository.results(job.id)) == 2


def test_a_cancelled_job_frees_its_worker(repository, settings):
    pool = WorkerPool(settings.model_copy(update={"lease_s": 1.0, "workers": 1}), repository)
    pool.start()
    try:
        endless = "minlp1:horizon=12:node_limit=1000000000"
        job = _submit(repository, JobKind.RUN, run_spec(SCENARIOS[0], endless, 0, 0))
        while repository.get(job.id).state == JobState.QUEUED:
            time.sleep(0.02)
        repository.cancel(job.id)
        after = _submit(repository, JobKind.RUN, run_spec(SCENARIOS[0], "logic", 0, 0))
        assert _wait(repository, after).state == JobState.SUCCEEDED
        assert repository.get(job.id).state == JobState.CANCELLED
    finally:
        pool.close()


def test_a_chunk_that_takes_too_long_fails_its_job(repository, settings):
    pool = WorkerPool(settings.model_copy(update={"lease_s": 1.0, "workers": 1, "chunk_max_s": 1.0}), repository)
    pool.start()
    try:
        endless = "minlp1:horizon=12:node_limit=1000000000"
        job = _submit(repository, JobKind.RUN, run_spec(SCENARIOS[0], endless, 0, 0))
        failed = _wait(repository, job)
        assert failed.state == JobState.FAILED
        assert "chunk_max_s" in failed.error["detail"]
    finally:
        pool.close()


def test_workers_are_gone_when_the_pool_is_closed(repository, settings):
    pool = WorkerPool(settings, repository)
    pool.start()
    while len(pool._members) < 2:
        time.sleep(0.01)
    pids = [member.process.pid for member in pool._members]
    began = time.monotonic()
    pool.close()
    assert time.monotonic() - began < 5
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)
