"""What a job is made of, and what one chunk of it computes."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Any

from api.certificates.questions import Question
from api.comparisons.service import replications_of
from api.packing import Kept, packed_record
from api.runs.service import run
from api.store.records import Chunk, Done, JobKind, Lease
from station import Scenario

PROBE_S = 1.0
"""The first chunk of a controller on a scenario ends after this long: it tells what a run takes [s]."""

CHUNK_S = 4.0
"""What is left is cut into chunks of about this long, against some 5 ms that a chunk costs [s]."""

CHUNK_END_S = 10.0
"""One that takes longer than it should is cut anew after this long; a single run is never cut [s]."""

RECORDS_BYTES = 8 << 20
"""And so that the records of its runs take about this much: they travel and are stored in one piece [bytes]."""

RECORDS_END_BYTES = 2 * RECORDS_BYTES
"""One whose records take more than they should is cut anew [bytes]."""


def run_spec(
    scenario: Scenario, controller: str, replication: int, seed: int, record: Kept = Kept.FULL
) -> dict[str, Any]:
    """A job of one run; scenarios are stored whole, so that a preset changed later does not change the job."""
    return {
        "scenario": scenario.model_dump(mode="json"), "controller": controller, "replication": replication,
        "seed": seed, "record": record,
    }  # fmt: skip


def comparison_spec(
    scenarios: Sequence[Scenario], controllers: Sequence[str], replications: int, seed: int, record: Kept = Kept.NONE
) -> dict[str, Any]:
    """A job that runs every controller on every replication of every scenario, on one where nothing is drawn."""
    return {
        "scenarios": [scenario.model_dump(mode="json") for scenario in scenarios], "controllers": list(controllers),
        "replications": replications, "seed": seed,
        "scenario_replications": [replications_of(scenario, replications) for scenario in scenarios],
        "record": record,
    }  # fmt: skip


def certificate_spec(question: Question) -> dict[str, Any]:
    """A job of one question."""
    return {"question": question.model_dump(mode="json", exclude_none=True)}


def about(kind: JobKind, spec: dict[str, Any]) -> dict[str, Any]:
    """What answers show of a spec: names and numbers instead of whole scenarios."""
    if kind is JobKind.RUN:
        scenario = spec["scenario"]
        return {**spec, "scenario": scenario["name"], "station": scenario["station"]["name"]}
    if kind is JobKind.CERTIFICATE:
        asked = spec["question"]
        return {
            "ask": asked["ask"], "modes": len(asked["modes"]), "states": len(asked["modes"][0]["A"]),
            "constraint": asked["constraint"]["kind"],
        }  # fmt: skip
    return {**spec, "scenarios": [scenario["name"] for scenario in spec["scenarios"]]}


def pieces(kind: JobKind, spec: dict[str, Any]) -> list[Chunk]:
    """The chunks of a job, in the order of its results: scenarios, then controllers, then replications.

    A chunk's number is that of its first run.
    """
    if kind in {JobKind.RUN, JobKind.CERTIFICATE}:
        return [Chunk(0, {}, 1)]
    found: list[Chunk] = []
    number = 0
    for row, replications in enumerate(spec["scenario_replications"]):
        for column in range(len(spec["controllers"])):
            work = {"scenario": row, "controller": column, "first": 0, "end_s": PROBE_S}
            found.append(Chunk(number, work, replications))
            number += replications
    return found


def task(spec: dict[str, Any], lease: Lease) -> dict[str, Any]:
    """What a chunk's computation needs to know of its job, as JSON."""
    if "scenarios" not in spec:
        return spec
    return {
        "scenario": spec["scenarios"][lease.work["scenario"]],
        "controller": spec["controllers"][lease.work["controller"]],
        "seed": spec["seed"], "chunk": lease.chunk, "work": lease.work, "runs": lease.runs,
        "record": spec.get("record", Kept.NONE),
    }  # fmt: skip


def compute(task: dict[str, Any]) -> Done:
    """A chunk's result.

    The bytes of a job's results depend on the job alone: not on who computes them, when, how often, or how they are
    cut. (A certificate also says how long it took; its proof does not depend on that.)
    """
    if "question" in task:
        from api.certificates.service import answer

        found = answer(Question.model_validate(task["question"]))
        return Done(_rows([found.model_dump(mode="json")]), 1)
    scenario = _parsed(json.dumps(task["scenario"]))
    if "work" not in task:
        result, record = run(scenario, task["controller"], task["replication"], seed=task["seed"])
        return Done(_rows([result.as_row()]), 1, parquet=packed_record(record, Kept(task.get("record", Kept.FULL))))
    return _compared(scenario, task)


def _compared(scenario: Scenario, task: dict[str, Any]) -> Done:
    """The first runs of a chunk of a comparison, as many as it has time and room for."""
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
    return Done(_rows(rows), done, tuple(cut(rest, (time.monotonic() - began) / done, size / done)), records=records)


class RunError(Exception):
    """One run of many has failed; `cause` says why. It comes back whole from another process."""

    def __init__(self, run: dict[str, Any], cause: Exception) -> None:
        super().__init__(run, cause)
        self.run, self.cause = run, cause


def _one(
    scenario: Scenario, controller: str, replication: int, seed: int, kept: Kept
) -> tuple[dict[str, Any], bytes | None]:
    """The row and the stored record of one run of a comparison; raises RunError, which names it."""
    try:
        result, record = run(scenario, controller, replication, seed=seed)
        return result.as_row(), packed_record(record, kept)
    except Exception as error:
        which = {"scenario": scenario.name, "controller": controller, "replication": replication}
        raise RunError(which, error) from error


def cut(rest: Chunk, run_s: float, run_bytes: float = 0.0) -> Iterator[Chunk]:
    """Even chunks of about CHUNK_S, or RECORDS_BYTES where that is less, by what a run takes; none of no runs."""
    count = min(rest.runs, math.ceil(rest.runs * max(run_s / CHUNK_S, run_bytes / RECORDS_BYTES)))
    for place in range(count):
        first, last = rest.runs * place // count, rest.runs * (place + 1) // count
        work = {**rest.work, "first": rest.work["first"] + first, "end_s": CHUNK_END_S}
        yield Chunk(rest.number + first, work, last - first)


@lru_cache(16)
def _parsed(text: str) -> Scenario:
    """A scenario read once for many chunks: a trace of a week takes longer to check than to run."""
    return Scenario.model_validate_json(text)


def _rows(rows: list[dict[str, Any]]) -> bytes:
    return json.dumps(rows, allow_nan=False, separators=(",", ":")).encode()
