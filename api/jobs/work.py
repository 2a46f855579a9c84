"""What a job is made of, and what one chunk of it computes."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Any

from api.certificates.questions import Question
from api.runs.service import run
from api.store.records import Chunk, Done, JobKind, Lease
from station import Scenario

PROBE_S = 1.0
"""The first chunk of a controller on a scenario ends after this long: it tells what a run takes [s]."""

CHUNK_S = 4.0
"""What is left is cut into chunks of about this long, against some 5 ms that a chunk costs [s]."""

CHUNK_END_S = 10.0
"""One that takes longer than it should is cut anew after this long; a single run is never cut [s]."""


def run_spec(scenario: Scenario, controller: str, replication: int, seed: int) -> dict[str, Any]:
    """A job of one run; scenarios are stored whole, so that a preset changed later does not change the job."""
    return {
        "scenario": scenario.model_dump(mode="json"), "controller": controller, "replication": replication,
        "seed": seed,
    }  # fmt: skip


def comparison_spec(
    scenarios: Sequence[Scenario], controllers: Sequence[str], replications: int, seed: int
) -> dict[str, Any]:
    """A job that runs every controller on every replication of every scenario."""
    return {
        "scenarios": [scenario.model_dump(mode="json") for scenario in scenarios], "controllers": list(controllers),
        "replications": replications, "seed": seed,
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
    replications, columns = spec["replications"], len(spec["controllers"])
    return [
        Chunk(
            (row * columns + column) * replications,
            {"scenario": row, "controller": column, "first": 0, "end_s": PROBE_S},
            replications,
        )
        for row in range(len(spec["scenarios"]))
        for column in range(columns)
    ]


def task(spec: dict[str, Any], lease: Lease) -> dict[str, Any]:
    """What a chunk's computation needs to know of its job, as JSON."""
    if "scenarios" not in spec:
        return spec
    return {
        "scenario": spec["scenarios"][lease.work["scenario"]],
        "controller": spec["controllers"][lease.work["controller"]],
        "seed": spec["seed"], "chunk": lease.chunk, "work": lease.work, "runs": lease.runs,
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
        return Done(_rows([result.as_row()]), 1, parquet=record.parquet())
    first, began = task["work"]["first"], time.monotonic()
    rows: list[dict[str, Any]] = []
    end_s = task["work"].get("end_s", math.inf)  # a chunk of an older version is not cut
    while len(rows) < task["runs"] and (not rows or time.monotonic() - began < end_s):
        rows.append(_row(scenario, task["controller"], first + len(rows), task["seed"]))
    rest = Chunk(task["chunk"] + len(rows), {**task["work"], "first": first + len(rows)}, task["runs"] - len(rows))
    return Done(_rows(rows), len(rows), tuple(cut(rest, (time.monotonic() - began) / len(rows))))


class RunError(Exception):
    """One run of many has failed; `cause` says why. It comes back whole from another process."""

    def __init__(self, run: dict[str, Any], cause: Exception) -> None:
        super().__init__(run, cause)
        self.run, self.cause = run, cause


def _row(scenario: Scenario, controller: str, replication: int, seed: int) -> dict[str, Any]:
    """The row of one run of a comparison; raises RunError, which names it."""
    try:
        return run(scenario, controller, replication, seed=seed)[0].as_row()
    except Exception as error:
        which = {"scenario": scenario.name, "controller": controller, "replication": replication}
        raise RunError(which, error) from error


def cut(rest: Chunk, run_s: float) -> Iterator[Chunk]:
    """Even chunks of about CHUNK_S where a run takes `run_s`; none of no runs."""
    count = min(rest.runs, math.ceil(rest.runs * run_s / CHUNK_S))
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
