"""What every executor promises, on processes of this machine and on a Dask cluster alike."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from api.comparisons.job import comparison_spec
from api.comparisons.service import compare
from api.jobs.executor import make_executor
from api.packing import Kept, whole
from api.runs.job import run_spec
from api.server.job_kinds import JOB_TYPES
from api.settings import Settings
from api.store.database import StoreError
from api.store.jobs import JobRepository
from api.store.records import JobKind, JobState
from controllers import create
from station import Record, load_scenario, simulate
from tests.api.conftest import free_port

SCENARIOS = [load_scenario(name) for name in ("S1", "S2")]
FOUR = ["logic", "minlp1", "minlp2", "minlp3"]
ENDLESS = "minlp1:horizon=12:node_limit=1000000000"


class Cluster:
    """A Dask scheduler and workers in processes of their own, which die with one another as real ones do."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        port = str(free_port())
        self.address = f"127.0.0.1:{port}"
        self._scheduler = self._start("scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard")
        self.workers: list[subprocess.Popen[bytes]] = []

    def _start(self, what: str, *options: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.dask_{what}", *options]
        quiet = subprocess.DEVNULL
        return subprocess.Popen(command, cwd=self._folder, stdout=quiet, stderr=quiet, start_new_session=True)

    def join(self) -> subprocess.Popen[bytes]:
        """One more worker, under its nanny."""
        options = ("--nthreads", "1", "--no-dashboard", "--local-directory", str(self._folder))
        worker = self._start("worker", f"tcp://{self.address}", *options)
        self.workers.append(worker)
        return worker

    @staticmethod
    def kill(process: subprocess.Popen[bytes]) -> None:
        """A worker with its nanny, or the scheduler, as a power cut would."""
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()

    def close(self) -> None:
        for process in (*self.workers, self._scheduler):
            if process.poll() is None:
                self.kill(process)


class Processes:
    """Worker processes, as many as the settings say."""

    executor = "processes"

    def kill_one(self, executor, chance) -> None:
        with executor._lock:
            alive = [member.process for member in executor._members if member.process.is_alive()]
        if alive:
            chance.choice(alive).kill()

    def close(self) -> None:
        pass


class OnDask:
    """Two workers of a cluster."""

    def __init__(self, folder: Path) -> None:
        self.cluster = Cluster(folder)
        self.executor = f"dask://{self.cluster.address}"
        for _ in range(2):
            self.cluster.join()

    def kill_one(self, executor, chance) -> None:
        if executor.alive == 0:  # until those that joined last are there
            return
        alive = [worker for worker in self.cluster.workers if worker.poll() is None]
        self.cluster.kill(chance.choice(alive))
        self.cluster.join()

    def close(self) -> None:
        self.cluster.close()


ON_DASK = (
    pytest.param(("dask", "sqlite"), marks=pytest.mark.slow),
    pytest.param(("dask", "postgresql"), marks=pytest.mark.full),
)


@pytest.fixture(params=[("processes", "sqlite"), ("processes", "postgresql"), *ON_DASK], ids="-".join)
def setting(request):
    """Executor and database."""
    return request.param


@pytest.fixture
def database_url(request, setting, tmp_path):
    return f"sqlite:///{tmp_path / 'hrs.db'}" if setting[1] == "sqlite" else request.getfixturevalue("postgres_url")


@pytest.fixture
def place(setting, tmp_path):
    """Where chunks are computed."""
    if setting[0] == "processes":
        made = Processes()
    else:
        pytest.importorskip("distributed", reason="the extra `dask` is not installed")
        made = OnDask(tmp_path)
    yield made
    made.close()


@pytest.fixture
def repository(database):
    return JobRepository(database)


@pytest.fixture
def settings(database_url, place):
    return Settings(database=database_url, workers=2, lease_s=2.0, executor=place.executor)


@pytest.fixture
def executor(settings, repository):
    made = make_executor(settings, repository, JOB_TYPES)
    made.start()
    yield made
    made.close()


def _submit(repository, kind, spec):
    of = JOB_TYPES[kind]
    return repository.add(kind, spec, of.summarize(spec), of.initial_chunks(spec), open_max=10)


def _wait(repository, job, seconds=120.0):
    until = time.monotonic() + seconds
    while not (found := repository.get(job.id)).state.final:
        assert time.monotonic() < until, found
        time.sleep(0.05)
    return found


def _started(repository, job, seconds=60.0):
    until = time.monotonic() + seconds
    while repository.get(job.id).state == JobState.QUEUED:
        assert time.monotonic() < until
        time.sleep(0.02)


@pytest.mark.slow
def test_a_comparison_comes_out_as_in_this_process(repository, executor):
    job = _submit(repository, JobKind.COMPARISON, comparison_spec(SCENARIOS, FOUR, 30, 5))
    executor.wake()
    done = _wait(repository, job)
    assert (done.state, done.runs_done) == (JobState.SUCCEEDED, 240)
    expected = [result.as_row() for result in compare(SCENARIOS, FOUR, replications=30, seed=5)]
    assert repository.results(job.id) == expected


@pytest.mark.slow
def test_a_run_leaves_its_record(repository, executor):
    job = _submit(repository, JobKind.RUN, run_spec(SCENARIOS[0], "minlp1:horizon=2", 3, 7))
    executor.wake()
    assert _wait(repository, job).state == JobState.SUCCEEDED
    expected = simulate(SCENARIOS[0], create("minlp1", horizon=2), replication=3, seed=7)
    assert Record.from_parquet(whole(repository.series(job.id))).to_bytes() == expected.to_bytes()


@pytest.mark.slow
def test_a_comparison_leaves_the_record_of_each_run(repository, executor):
    job = _submit(repository, JobKind.COMPARISON, comparison_spec(SCENARIOS, ["logic", "minlp1"], 3, 5, Kept.FULL))
    executor.wake()
    assert _wait(repository, job).state == JobState.SUCCEEDED
    for number, row in enumerate(repository.results(job.id)):
        scenario = next(each for each in SCENARIOS if each.name == row["scenario"])
        expected = simulate(scenario, create(row["controller"]), replication=row["replication"], seed=5)
        assert Record.from_parquet(whole(repository.record(job.id, number))).to_bytes() == expected.to_bytes()


@pytest.mark.slow
def test_a_controller_that_fails_fails_its_job_alone(repository, executor):
    bad = _submit(repository, JobKind.RUN, run_spec(SCENARIOS[0], "nobody", 0, 0))
    good = _submit(repository, JobKind.RUN, run_spec(SCENARIOS[0], "logic", 0, 0))
    executor.wake()
    failed = _wait(repository, bad)
    assert failed.state == JobState.FAILED
    assert "nobody" in failed.error["errors"][0]["message"]
    assert _wait(repository, good).state == JobState.SUCCEEDED


@pytest.mark.slow
def test_a_run_goes_before_a_comparison(repository, executor):
    long = _submit(repository, JobKind.COMPARISON, comparison_spec(SCENARIOS, ["minlp1:horizon=3"], 300, 1))
    executor.wake()
    _started(repository, long)
    quick = _submit(repository, JobKind.RUN, run_spec(SCENARIOS[0], "logic", 0, 0))
    executor.wake()
    assert _wait(repository, quick).state == JobState.SUCCEEDED
    assert not repository.get(long.id).state.final
    repository.cancel(long.id)


@pytest.mark.slow
def test_a_cancelled_run_frees_its_worker(repository, executor):
    endless = [_submit(repository, JobKind.RUN, run_spec(SCENARIOS[0], ENDLESS, 0, 0)) for _ in range(2)]
    executor.wake()
    for job in endless:
        _started(repository, job)
        repository.cancel(job.id)
    after = _submit(repository, JobKind.RUN, run_spec(SCENARIOS[0], "logic", 0, 0))
    executor.wake()
    assert _wait(repository, after).state == JobState.SUCCEEDED
    assert {repository.get(job.id).state for job in endless} == {JobState.CANCELLED}


@pytest.mark.slow
def test_a_run_that_takes_too_long_fails(repository, settings):
    executor = make_executor(settings.model_copy(update={"chunk_max_s": 1.0}), repository, JOB_TYPES)
    executor.start()
    try:
        job = _submit(repository, JobKind.RUN, run_spec(SCENARIOS[0], ENDLESS, 0, 0))
        executor.wake()
        failed = _wait(repository, job)
        assert failed.state == JobState.FAILED
        assert "chunk_max_s" in failed.error["detail"]
    finally:
        executor.close()


@pytest.mark.slow
def test_workers_die_and_join_and_nothing_is_lost_or_doubled(repository, place, executor):
    spec = comparison_spec(SCENARIOS, ["logic", "minlp1:horizon=2"], 120, 3)
    job = _submit(repository, JobKind.COMPARISON, spec)
    executor.wake()
    _started(repository, job)
    chance = random.Random(11)
    for _ in range(4):
        time.sleep(chance.uniform(0.2, 1.0))
        place.kill_one(executor, chance)
    done = _wait(repository, job)
    assert (done.state, done.runs_done) == (JobState.SUCCEEDED, 480)
    expected = [result.as_row() for result in compare(SCENARIOS, spec["controllers"], replications=120, seed=3)]
    assert repository.results(job.id) == expected


@pytest.mark.parametrize("setting", ON_DASK, indirect=True, ids="-".join)
def test_a_result_waits_for_a_store_in_trouble(repository, executor, monkeypatch):
    """Of chunks that are stored here: workers of `processes` store by themselves (test_jobs.py)."""
    complete, tries = repository.complete, []

    def full(lease, done):
        tries.append(lease.attempt)
        if len(tries) < 3:
            raise StoreError("full")
        complete(lease, done)

    monkeypatch.setattr(repository, "complete", full)
    job = _submit(repository, JobKind.RUN, run_spec(SCENARIOS[0], "logic", 0, 0))
    executor.wake()
    assert _wait(repository, job).state == JobState.SUCCEEDED
    assert len(tries) >= 3
    assert len(repository.results(job.id)) == 1


def test_what_is_not_done_at_the_end_is_given_back(repository, settings, database):
    executor = make_executor(settings, repository, JOB_TYPES)
    executor.start()
    job = _submit(repository, JobKind.RUN, run_spec(SCENARIOS[0], ENDLESS, 0, 0))
    executor.wake()
    _started(repository, job)
    executor.close()
    assert repository.claim("another", 10.0, 20).attempt >= 2, (
        "free at once; a worker of a busy cluster may have died before"
    )
