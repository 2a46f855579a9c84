"""The service under load, `hrs bench --load`: chunks, requests beside a comparison, streams, twins, a long past."""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from api.comparisons.job import COMPARISON, comparison_spec
from api.runs.job import RUN, run_spec
from api.runs.service import run
from api.settings import Settings
from api.store.database import Database
from api.store.jobs import JobRepository
from api.store.records import Chunk, ChunkResult, JobKind
from benchmarks.measure import Bar, Row
from benchmarks.served import Service, served
from benchmarks.telemetry import LATE, Subscriber, lost, many
from benchmarks.throughput import ended, post
from benchmarks.throughput import rows as throughput
from station import load_scenario

CHUNKS = 1000
STREAMS, SUBSCRIBERS, SPEED = 200, 20, 10
RUNS_STORED = 10_000
REQUESTS_PER_S = 300
CONNECTIONS = 8


def rows(*, long: bool, database: str | None) -> Iterator[Row]:
    """Every promise in turn; `database` names a PostgreSQL database that may be filled."""
    with TemporaryDirectory() as folder:
        yield chunks("SQLite", f"sqlite:///{Path(folder) / 'hrs.db'}", Bar("at most", 5))
    if database is not None:
        yield chunks("PostgreSQL", database, Bar("at most", 12))
    yield from beside_a_comparison(60 if long else 15)
    yield from listeners(60 if long else 20)
    yield from many(50, 600 if long else 30, Bar("at most", 200), Bar("at most", 1))
    yield from long_past(RUNS_STORED)
    yield from throughput(400 if long else 100)


def chunks(name: str, url: str, bar: Bar) -> Row:
    """What a chunk costs but for its computing: a claim, and a result stored; one worker, one after the other."""
    database = Database(url)
    database.migrate()
    jobs = JobRepository(database)
    spec = comparison_spec([load_scenario("S1")], ["logic"], CHUNKS, 0)
    pieces = [Chunk(number, {}, 1) for number in range(CHUNKS)]
    jobs.add(JobKind.COMPARISON, spec, COMPARISON.summarize(spec), pieces, 10)
    result = json.dumps([run(load_scenario("S1"), "logic")[0].as_row()]).encode()
    times = []
    for _ in range(CHUNKS):
        before = time.perf_counter()
        lease = jobs.claim("bench", 60.0, 3)
        if lease is None:
            raise RuntimeError("there are fewer chunks than were stored")
        jobs.complete(lease, ChunkResult(result, 1))
        times.append(1000 * (time.perf_counter() - before))
    database.close()
    return Row(f"{name}: a chunk claimed and stored, {CHUNKS} of a job", tuple(times), "ms", bar)


def beside_a_comparison(seconds: float) -> Iterator[Row]:
    """Requests for a run, sent on time whatever came of those before, while a comparison runs on every core."""
    with served() as service:
        path = f"/v1/runs/{ended(service, [post(service, 'S1', 'minlp1')])[0]['id']}"
        asked = {"scenarios": ["S3", "S4"], "controllers": ["minlp1"], "replications": 10_000}
        comparison = service.request("POST", "/v1/comparisons", asked)
        time.sleep(3)
        before = service.request("GET", f"/v1/comparisons/{comparison['id']}")["runs_done"]
        cpu = service.cpu()
        late = asyncio.run(_ask(service, path, seconds))
        cpu = service.cpu() - cpu
        job = service.request("GET", f"/v1/comparisons/{comparison['id']}")
        if job["state"] != "running":
            raise RuntimeError("the comparison has ended before the requests")
        service.request("POST", f"/v1/comparisons/{comparison['id']}/cancel")
    what = f"GET /v1/runs/{{id}}, {REQUESTS_PER_S} a second on {CONNECTIONS} connections beside a comparison"
    yield Row(f"{what}: answered", (len(late) / seconds,), "requests/s", Bar("at least", REQUESTS_PER_S - 1))
    yield Row(f"{what}: p99 from when it was due", (1000 * float(np.quantile(late, LATE)),), "ms", Bar("at most", 100))
    yield Row(f"{what}: CPU of the server", (1000 * cpu / len(late),), "ms/request")
    yield Row("... the comparison meanwhile", ((job["runs_done"] - before) / seconds,), "runs/s")


async def _ask(service: Service, path: str, seconds: float) -> list[float]:
    """How long after its time each request was answered [s]; a client that waits does not make fewer."""
    due: asyncio.Queue[float] = asyncio.Queue()
    late: list[float] = []
    request = f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{service.port}\r\n\r\n".encode()

    async def ask() -> None:  # bytes on a socket: a client library would take as much of the cores as the service
        reader, writer = await asyncio.open_connection("127.0.0.1", service.port)
        while (when := await due.get()) >= 0:
            writer.write(request)
            head = await reader.readuntil(b"\r\n\r\n")
            length = next(line for line in head.lower().splitlines() if line.startswith(b"content-length:"))
            await reader.readexactly(int(length.partition(b":")[2]))
            if b" 200 " not in head.partition(b"\r\n")[0]:
                raise RuntimeError(f"{path} was answered {head!r}")
            late.append(time.perf_counter() - when)
        writer.close()

    askers = [asyncio.create_task(ask()) for _ in range(CONNECTIONS)]
    began = time.perf_counter()
    for number in range(int(seconds * REQUESTS_PER_S)):
        when = began + number / REQUESTS_PER_S
        await asyncio.sleep(max(0.0, when - time.perf_counter()))
        due.put_nowait(when)
    for _ in askers:
        due.put_nowait(-1.0)
    await asyncio.gather(*askers)
    return late


def listeners(seconds: float) -> Iterator[Row]:
    """Event streams and zenoh subscribers on one twin at ten samples a second."""
    with served("--workers", "0") as service:
        asked = {"id": "bench", "scenario": "S1", "speed": SPEED, "at_end": "repeat"}
        service.request("POST", "/v1/twins", asked)
        subscribers = [Subscriber(service, "bench") for _ in range(SUBSCRIBERS)]
        command = [sys.executable, "-m", "benchmarks.streams", f"{service.url}/v1/twins/bench/stream", str(STREAMS)]
        streams = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        if streams.stdout is None or streams.stdout.readline() != "ready\n":
            raise RuntimeError("the streams did not open")
        cpu = service.cpu()
        time.sleep(seconds)
        share = (service.cpu() - cpu) / seconds
        heard = json.loads(streams.communicate("\n", timeout=60)[0])
        results = [subscriber.result() for subscriber in subscribers]
    what = f"{STREAMS} event streams and {SUBSCRIBERS} zenoh subscribers at {SPEED}x, {seconds:g} s"
    streamed = [([seq for seq, _ in one], [late for _, late in one]) for one in heard]
    for name, found in (("streams", streamed), ("zenoh", results)):
        p99 = tuple(1000 * float(np.quantile(late, LATE)) for _, late in found)
        yield Row(f"{what}: p99 of lateness, each of {name}", p99, "ms", Bar("at most", 150))
        yield Row(f"{what}: ... of the worst of {name}", (max(p99),), "ms", Bar("at most", 150))
        fewest, missing = min(len(numbers) for numbers, _ in found), sum(lost(numbers) for numbers, _ in found)
        yield Row(f"{what}: samples heard, fewest of {name}", (float(fewest),), "samples",
                  Bar("at least", 0.99 * SPEED * seconds))  # fmt: skip
        yield Row(f"{what}: samples lost, {name}", (float(missing),), "1", Bar("at most", 0))
    yield Row(f"{what}: CPU of the server", (share,), "cores")


def long_past(count: int) -> Iterator[Row]:
    """Start of a service that has many runs, each with its record, as a service that has computed them leaves them."""
    scenario = load_scenario("S1")
    result, record = run(scenario, "logic")
    done = ChunkResult(json.dumps([result.as_row()]).encode(), 1, parquet=record.parquet())
    spec = run_spec(scenario, "logic", 0, 0)
    with TemporaryDirectory() as data:
        service = Service(data, "--workers", "1")
        service.start()
        service.stop()
        database = Database(Settings(data=Path(data)).database_url)
        jobs = JobRepository(database)
        for _ in range(count):
            jobs.add(JobKind.RUN, spec, RUN.summarize(spec), [Chunk(0, {}, 1)], 10)
            lease = jobs.claim("bench", 60.0, 3)
            if lease is None:
                raise RuntimeError("a run that was stored is not there")
            jobs.complete(lease, done)
        database.close()
        started = []
        for _ in range(5):
            started.append(service.start("/readyz"))
            listed = service.request("GET", "/v1/runs?limit=50")["items"]
            if len(listed) != 50:
                raise RuntimeError("the runs are not there")
            service.stop()
    yield Row(f"start with {count} stored runs, from the shell until /readyz says ready", tuple(started), "s",
              Bar("at most", 4))  # fmt: skip
