"""Runs as jobs."""

from __future__ import annotations

import json
from functools import lru_cache
from typing import Any

from api.jobs.work import JobType, Spec, encoded_rows, single_chunk, whole_spec
from api.packing import Kept, packed_record
from api.runs.service import run
from api.store.records import ChunkResult
from station import Scenario


def run_spec(scenario: Scenario, controller: str, replication: int, seed: int, record: Kept = Kept.FULL) -> Spec:
    """A job of one run; scenarios are stored whole, so that a preset changed later does not change the job."""
    return {
        "scenario": scenario.model_dump(mode="json"), "controller": controller, "replication": replication,
        "seed": seed, "record": record,
    }  # fmt: skip


def _summary(spec: Spec) -> dict[str, Any]:
    scenario = spec["scenario"]
    return {**spec, "scenario": scenario["name"], "station": scenario["station"]["name"]}


def _compute(task: dict[str, Any]) -> ChunkResult:
    scenario = parsed_scenario(json.dumps(task["scenario"]))
    result, record = run(scenario, task["controller"], task["replication"], seed=task["seed"])
    kept = Kept(task.get("record", Kept.FULL))
    return ChunkResult(encoded_rows([result.as_row()]), 1, parquet=packed_record(record, kept))


@lru_cache(16)
def parsed_scenario(text: str) -> Scenario:
    """A scenario read once for many chunks: a trace of a week takes longer to check than to run."""
    return Scenario.model_validate_json(text)


RUN = JobType(_summary, single_chunk, whole_spec, _compute)
