"""Measurements of fifty stations at once, and a day from a file: `python -m benchmarks.ingest [--station h70-light]`.

Each station sends thirty readings a second, every sensor's and some faster ones twice, in a request a second. Another
process sends them, each station at its own part of the second, whatever became of the requests before.
"""

from __future__ import annotations

import argparse
import asyncio
import multiprocessing
import os
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import httpx
import numpy as np
import orjson
import pyarrow as pa
from pyarrow import csv, parquet

from benchmarks.measure import Bar, Row, cells
from benchmarks.measured_forecasts import day_of
from benchmarks.served import Service, served
from controllers import create_from
from station import load_station, simulate
from station.frames import frames_of
from station.measured_day import measured_day, tags_of_day
from station.measurement import read_table, samples_of
from station.sensor_names import ANALOG, SENSORS

STATIONS, TAGS = 50, 30
RATE, HOURS, SEED = 5.0, 24, 2650
TWICE = ANALOG[: TAGS - len(SENSORS)] + ("power_compressor",) * max(0, TAGS - len(SENSORS) - len(ANALOG))
"""Sensors that are read twice a second: with one reading of each there are TAGS."""

CORES, READ_S = Bar("at most", 0.5), Bar("at most", 1.0)
SETTLING_S = 20
"""Seconds before CPU is counted: filters start, and what is imported late has been."""


class Sent(NamedTuple):
    """What became of the requests."""

    answers: list[float]  # [s] from when each was due to its answer
    refused: int


def measured_table(preset: str) -> pa.Table:
    """A measured day of a station, a row a second."""
    return measured_day(simulate(day_of(load_station(preset), RATE, HOURS), create_from("logic"), seed=SEED), SEED)


def bodies(table: pa.Table, first: int, seconds: int, begin: float) -> list[bytes]:
    """A body of JSON for each of so many seconds of a day from one on, whose first is told at a Unix time [s]."""
    rows = table.slice(first, seconds).to_pylist()
    found = []
    for number, row in enumerate(rows):
        samples = [{"tag": name, "time": begin + number + 0.1, "value": row[name]} for name in SENSORS if name in row]
        again = [{"tag": name, "time": begin + number + 0.6, "value": row[name]} for name in TWICE if name in row]
        found.append(orjson.dumps(samples + again))
    return found


async def _send(url: str, each: list[list[bytes]], begin: float) -> Sent:
    answers: list[float] = []
    refused = 0

    async def station(number: int, client: httpx.AsyncClient) -> None:
        nonlocal refused
        for sequence, body in enumerate(each[number]):
            due = begin + sequence + 1 + number / len(each)
            await asyncio.sleep(max(0.0, due - time.time()))
            answer = await client.post(
                f"/v1/twins/s{number}/measurements", params={"source": "gateway", "sequence": sequence}, content=body,
                headers={"Content-Type": "application/json"},
            )  # fmt: skip
            answers.append(time.time() - due)
            refused += answer.status_code != httpx.codes.ACCEPTED

    limits = httpx.Limits(max_connections=len(each), max_keepalive_connections=len(each))
    async with httpx.AsyncClient(base_url=url, timeout=30, limits=limits, trust_env=False) as client:
        await asyncio.gather(*(station(number, client) for number in range(len(each))))
    return Sent(answers, refused)


def _sender(url: str, each: list[list[bytes]], begin: float, found: multiprocessing.Queue[Sent]) -> None:
    found.put(asyncio.run(_send(url, each, begin)))


def cpu_of_all(service: Service) -> float:
    """CPU time of the server's process and of those it started [s]."""
    parents = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        parents[int(path.parent.name)] = int(fields[1]), (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    family, found = {service.process.pid}, 0.0
    while grown := {pid for pid, (parent, _) in parents.items() if parent in family} - family:
        family |= grown
    for pid in family:
        found += parents[pid][1]
    return found


def of_service(preset: str, table: pa.Table, seconds: int, options: Sequence[str]) -> Iterator[Row]:
    """Rows of a service, with these options, that fifty stations send to."""
    tags = tags_of_day().model_dump(mode="json")
    law = {"kind": "poisson", "rate_per_h": RATE, "period_s": 3600.0 * HOURS}
    scenario = {"name": "sent", "station": {"preset": preset}, "arrivals": law}
    first = np.random.default_rng(SEED).integers(0, len(table) - seconds, STATIONS)
    with served(*options) as service:
        for number in range(STATIONS):
            twin = {"id": f"s{number}", "scenario": scenario, "source": "measured", "tags": tags}
            service.request("POST", "/v1/twins", twin)
        begin = float(np.ceil(time.time())) + 5
        each = [bodies(table, int(at), seconds, begin) for at in first]
        begin = max(begin, float(np.ceil(time.time())) + 1)
        found: multiprocessing.Queue[Sent] = multiprocessing.Queue()
        sender = multiprocessing.get_context("fork").Process(target=_sender, args=(service.url, each, begin, found))
        sender.start()
        time.sleep(max(0.0, begin + SETTLING_S - time.time()))
        parts = []
        for _ in range(3):
            before, clock = cpu_of_all(service), time.monotonic()
            time.sleep((seconds - SETTLING_S - 5) / 3)
            parts.append((cpu_of_all(service) - before) / (time.monotonic() - clock))
        sent = found.get(timeout=60)
        sender.join()
        time.sleep(5)
        states = [service.request("GET", f"/v1/twins/s{number}") for number in range(STATIONS)]
    what = f"{preset}, {STATIONS} stations, {len(orjson.loads(each[0][0]))} readings a second each"
    yield Row(f"{what}: CPU of the service", tuple(parts), "cores", CORES)
    late = 1000 * np.array(sent.answers)
    yield Row(f"{what}: stored and answered, p99 of {len(late)}", (float(np.quantile(late, 0.99)),), "ms")
    yield Row(f"{what}: refused", (float(sent.refused),), "1", Bar("at most", 0.0))
    missing = [seconds - state["samples"] for state in states]
    yield Row(f"{what}: newest seconds not yet followed, at most", (float(max(missing)),), "s")


def of_file(table: pa.Table, repeats: int) -> Iterator[Row]:
    """Rows of reading a day from a file: with as many columns as TAGS, of which the map names every sensor's."""
    for name in (f"other_{number}" for number in range(TAGS - table.num_columns + 1)):
        table = table.append_column(name, table["pressure_high"])
    for kind, write in (("csv", csv.write_csv), ("parquet", parquet.write_table)):
        took = []
        with TemporaryDirectory() as folder:
            path = Path(folder, f"day.{kind}")
            write(table, path)
            megabytes = path.stat().st_size / 1e6
            for _ in range(repeats):
                clock = time.perf_counter()
                frames = frames_of(samples_of(read_table(path), tags_of_day(), str(path)))
                took.append(time.perf_counter() - clock)
        what = f"{len(frames.values)} s of {table.num_columns - 1} columns, {megabytes:.0f} MB of {kind}"
        yield Row(f"{what}, brought to seconds", tuple(took), "s", READ_S)


def main() -> None:
    """Parse the arguments and print; status 1 where a bar is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--station", default="thesis-fit")
    parser.add_argument("--seconds", type=int, default=115, help="so long each station sends")
    parser.add_argument("--repeats", type=int, default=5, help="of reading a file")
    parser.add_argument("--database", metavar="URL", help="an empty PostgreSQL database; SQLite if left out")
    asked = parser.parse_args()
    missed = False
    table = measured_table(asked.station)
    options = ("--database", asked.database) if asked.database else ()
    for rows in (of_file(table, asked.repeats), of_service(asked.station, table, asked.seconds, options)):
        for row in rows:
            print(*cells(row), sep=" | ", flush=True)
            missed |= row.ok is False
    sys.exit(int(missed))


if __name__ == "__main__":
    main()
