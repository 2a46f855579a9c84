"""Comparisons as jobs: cut into chunks of a few seconds, whose runs are the same however they are cut."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Iterator, Sequence
from typing import Any

from api.comparisons.service import replications_of
from api.jobs.work import CHUNK_END_S, JobType, RunError, Spec, encoded_rows
from api.packing import Kept, packed_record
from api.runs.job import parsed_scenario
from api.runs.service import run
from api.store.records import Chunk, ChunkResult, Lease
from station import Scenario

PROBE_S = 1.0
"""The first chunk of a controller on a scenario ends after this long, by which time is known what a run takes [s]."""

CHUNK_S = 4.0
"""The rest is cut into chunks of about this long, against some 5 ms that a chunk costs [s]."""

RECORDS_BYTES = 8 << 20
"""And so that the records of its runs take about this much: they travel and are stored in one piece [bytes]."""

RECORDS_END_BYTES = 2 * RECORDS_BYTES
"""A chunk whose records take more than they should is cut anew [bytes]."""


def comparison_spec(
    scenarios: Sequence[Scenario], controllers: Sequence[str], replications: int, seed: int, record: Kept = Kept.NONE
) -> Spec:
    """A job that runs every controller on every replication of every scenario, on one where nothing is drawn."""
    return {
        "scenarios": [scenario.model_dump(mode="json") for scenario in scenarios], "controllers": list(controllers),
        "replications": replications, "seed": seed,
        "scenario_replications": [replications_of(scenario, replications) for scenario in scenarios],
        "record": record,
    }  # fmt: skip


def _summary(spec: Spec) -> dict[str, Any]:
    return {**spec, "scenarios": [scenario["name"] for scenario in spec["scenarios"]]}


def _chunks(spec: Spec) -> list[Chunk]:
    """One a scenario and controller: scenarios, then controllers, then replications."""
    found: list[Chunk] = []
    number = 0
    for row, replications in enumerate(spec["scenario_replications"]):
        for column in range(len(spec["controllers"])):
            items = {"scenario": row, "controller": column, "first": 0, "end_s": PROBE_S}
            found.append(Chunk(number, items, replications))
            number += replications
    return found


def _task(spec: Spec, lease: Lease) -> dict[str, Any]:
    return {
        "scenario": spec["scenarios"][lease.items["scenario"]],
        "controller": spec["controllers"][lease.items["controller"]],
        "seed": spec["seed"], "chunk": lease.chunk, "work": lease.items, "runs": lease.runs,
        "record": spec.get("record", Kept.NONE),
    }  # fmt: skip


def _compute(task: dict[str, Any]) -> ChunkResult:
    """The first runs of a chunk, as many as it has time and room for, and the chunks that the rest is cut into."""
    scenario = parsed_scenario(json.dumps(task["scenario"]))
    first, began = task["work"]["first"], time.monotonic()
    rows: list[dict[str, Any]] = []
    records: dict[int, bytes] = {}
    size = 0
    end_s = task["work"].get("end_s", math.inf)  # a chunk of an older version is not cut
    while len(rows) < task["runs"] and (
        not rows or (time.monotonic() - began < end_s and size < RECORDS_END_BYTES)
    ):  # fmt: skip
        row, record = _one(scenario, task["controller"], first + len(rows), task["seed"], Kept(task["record"]))
        if record is not None:
            records[task["chunk"] + len(rows)] = record
            size += len(record)
        rows.append(row)
    done = len(rows)
    rest = Chunk(task["chunk"] + done, {**task["work"], "first": first + done}, task["runs"] - done)
    further = tuple(split_chunk(rest, (time.monotonic() - began) / done, size / done))
    return ChunkResult(encoded_rows(rows), done, further, records=records)


def _one(
    scenario: Scenario, controller: str, replication: int, seed: int, kept: Kept
) -> tuple[dict[str, Any], bytes | None]:
    """The row and the stored record of one run; raises RunError, which names it."""
    try:
        result, record = run(scenario, controller, replication, seed=seed)
        return result.as_row(), packed_record(record, kept)
    except Exception as error:
        which = {"scenario": scenario.name, "controller": controller, "replication": replication}
        raise RunError(which, error) from error


def split_chunk(rest: Chunk, run_s: float, run_bytes: float = 0.0) -> Iterator[Chunk]:
    """Even chunks of about CHUNK_S, or RECORDS_BYTES where that is less, by what a run takes; none of no runs."""
    count = min(rest.runs, math.ceil(rest.runs * max(run_s / CHUNK_S, run_bytes / RECORDS_BYTES)))
    for place in range(count):
        first, last = rest.runs * place // count, rest.runs * (place + 1) // count
        items = {**rest.items, "first": rest.items["first"] + first, "end_s": CHUNK_END_S}
        yield Chunk(rest.number + first, items, last - first)


COMPARISON = JobType(_summary, _chunks, _task, _compute)
