"""What a job is made of, and what one chunk of it computes."""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

from api.certificates.questions import Question
from api.runs.service import run
from api.store.records import Chunk, JobKind, Lease
from station import Scenario

CHUNK_RUNS = 50
"""Replications in a chunk: some 2 s of a day with our controllers, against some 5 ms that a chunk costs."""


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
    """The chunks of a job, in the order of its results: scenarios, then controllers, then replications."""
    if kind in {JobKind.RUN, JobKind.CERTIFICATE}:
        return [Chunk({}, 1)]
    replications = spec["replications"]
    return [
        Chunk({"scenario": scenario, "controller": controller, "first": first}, min(CHUNK_RUNS, replications - first))
        for scenario in range(len(spec["scenarios"]))
        for controller in range(len(spec["controllers"]))
        for first in range(0, replications, CHUNK_RUNS)
    ]


def compute(spec: dict[str, Any], lease: Lease) -> tuple[bytes, bytes | None]:
    """A chunk's result rows as JSON, and the record as Parquet where the job is a single run.

    The bytes depend on the job alone: not on who computes it, when, or how often. (A certificate also says how long it
    took; its proof does not depend on that.)
    """
    if "question" in spec:
        from api.certificates.service import answer

        found = answer(Question.model_validate(spec["question"]))
        return _rows([found.model_dump(mode="json")]), None
    if "scenario" in spec:
        result, record = run(
            _parsed(json.dumps(spec["scenario"])), spec["controller"], spec["replication"], seed=spec["seed"]
        )
        return _rows([result.as_row()]), record.parquet()
    scenario = _parsed(json.dumps(spec["scenarios"][lease.work["scenario"]]))
    controller = spec["controllers"][lease.work["controller"]]
    first = lease.work["first"]
    replications = range(first, first + lease.runs)
    return _rows([_row(scenario, controller, k, spec["seed"]) for k in replications]), None


class RunError(Exception):
    """One run of many has failed; its cause says why."""

    def __init__(self, run: dict[str, Any]) -> None:
        super().__init__(str(run))
        self.run = run


def _row(scenario: Scenario, controller: str, replication: int, seed: int) -> dict[str, Any]:
    """The row of one run of a comparison; raises RunError, which names it."""
    try:
        return run(scenario, controller, replication, seed=seed)[0].as_row()
    except Exception as error:
        which = {"scenario": scenario.name, "controller": controller, "replication": replication}
        raise RunError(which) from error


@lru_cache(16)
def _parsed(text: str) -> Scenario:
    """A scenario read once for many chunks: a trace of a week takes longer to check than to run."""
    return Scenario.model_validate_json(text)


def _rows(rows: list[dict[str, Any]]) -> bytes:
    return json.dumps(rows, allow_nan=False, separators=(",", ":")).encode()
