"""The generated parts of docs/scaling.md: what was measured here, and what it says of 1000 stations.

Run as `python -m benchmarks.scaling_document` on a machine that does nothing else; some four minutes on two cores.
`HRS_BENCH_POSTGRES` names an empty PostgreSQL database that may be filled.
"""

from __future__ import annotations

import json
import os
import sys
import time
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from api.comparisons.job import CHUNK_S, PROBE_S
from api.runs.service import run
from benchmarks.documents import recompute, seconds, table
from benchmarks.load import chunks
from benchmarks.machine import machine
from benchmarks.measure import Bar, Row, cells
from benchmarks.throughput import COMPARED, rows
from station import load_scenario

DOCUMENT = "scaling.md"

JOBS = 200
STATIONS, REPLICATIONS = 1000, 1000
CONTROLLERS = ("logic", "minlp1", "switched", "scenario")
CORES = (2, 64, 1000)
MEASURED_RUNS = 5


@cache
def chunk_rows() -> tuple[Row, ...]:
    """What a chunk costs the store."""
    with TemporaryDirectory() as folder:
        found = [chunks("SQLite", f"sqlite:///{Path(folder) / 'hrs.db'}", Bar("at most", 5))]
    if url := os.environ.get("HRS_BENCH_POSTGRES"):
        found.append(chunks("PostgreSQL", url, Bar("at most", 12)))
    return tuple(found)


@cache
def throughput_rows() -> tuple[Row, ...]:
    """Jobs and runs a second."""
    return tuple(rows(JOBS))


@cache
def run_s(scenario: str, controller: str) -> float:
    """CPU time of a run within a long job, kernels compiled [s]."""
    asked = load_scenario(scenario)
    run(asked, controller, 0)
    began = time.process_time()
    for replication in range(MEASURED_RUNS):
        run(asked, controller, replication)
    return (time.process_time() - began) / MEASURED_RUNS


def throughput_part() -> str:
    """What this machine did."""
    about = machine()
    shown = [(what, measured) for what, measured, _, _ in map(cells, (*throughput_rows(), *chunk_rows()))]
    return (
        f"{about['CPU']}, {about['cores']} cores, Python {about['Python']}: medians, with the range of three repeats "
        "(of every chunk for the last rows).\n\n" + table(("what", "measured"), shown)
    )


def _time(hours: float) -> str:
    """Two digits, in hours or minutes."""
    shown, unit = (hours, "h") if hours > 1 else (60 * hours, "min")
    return f"{shown:.0f} {unit}" if shown >= 10 else f"{shown:.2g} {unit}"


def model_part() -> str:
    """Core-hours, chunks and bytes of a million runs, and what the model says of the comparison that was measured."""
    scenario = COMPARED[0]
    chunk_ms = {row.what.partition(":")[0]: row.median for row in chunk_rows()}
    lines = []
    for controller in CONTROLLERS:
        cost = run_s(scenario, controller)
        hours = STATIONS * REPLICATIONS * cost / 3600
        chunk_count = STATIONS * (1 + round((REPLICATIONS * cost - PROBE_S) / CHUNK_S))
        wall = (_time(hours / cores) for cores in CORES)
        store = " / ".join(f"{chunk_count * chunk / 1000:.0f}" for chunk in chunk_ms.values())
        lines.append((f"`{controller}`", f"{1000 * cost:.0f}", f"{hours:.1f}", *wall, seconds(chunk_count), store))
    headings = (
        "controller", "a run [ms of CPU]", "core-hours", *(f"on {cores} cores" for cores in CORES), "chunks",
        f"store busy [s], {' / '.join(chunk_ms)}",
    )  # fmt: skip
    row_bytes = len(json.dumps(run(load_scenario(scenario), COMPARED[1])[0].as_row()))
    said = [f"- The store keeps {row_bytes} bytes a run: {STATIONS * REPLICATIONS * row_bytes / 1e9:.1f} GB in all."]
    for name, chunk in chunk_ms.items():
        most = CHUNK_S / (chunk / 1000)
        said.append(
            f"- {name}, one chunk after the other, keeps up with {1000 / chunk:.0f} chunks a second: {most:.0f} cores."
        )
    for row in throughput_rows():
        if "in one comparison" in row.what:
            workers = 1 if row.what.startswith("1 worker:") else 2
            expected = workers / run_s(*COMPARED)
            said.append(
                f"- {row.what}: {row.median:.0f} a second were measured, {expected:.0f} would be {workers} / run: "
                f"{100 * row.median / expected:.0f} %."
            )
    return f"{table(headings, lines)}\n\n" + "\n".join(said)


if __name__ == "__main__":
    recompute(DOCUMENT, {"throughput": throughput_part, "model": model_part}, sys.argv[1:])
