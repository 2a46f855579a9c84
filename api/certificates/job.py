"""Questions about switched systems as jobs."""

from __future__ import annotations

from typing import Any

from api.certificates.questions import Question
from api.jobs.work import JobType, Spec, encoded_rows, single_chunk, whole_spec
from api.store.records import ChunkResult


def certificate_spec(question: Question) -> Spec:
    """A job of one question."""
    return {"question": question.model_dump(mode="json", exclude_none=True)}


def _summary(spec: Spec) -> dict[str, Any]:
    asked = spec["question"]
    return {
        "ask": asked["ask"], "modes": len(asked["modes"]), "states": len(asked["modes"][0]["A"]),
        "constraint": asked["constraint"]["kind"],
    }  # fmt: skip


def _compute(task: dict[str, Any]) -> ChunkResult:
    """The answer; it says how long it took, on which its proof does not depend."""
    from api.certificates.service import answer

    found = answer(Question.model_validate(task["question"]))
    return ChunkResult(encoded_rows([found.model_dump(mode="json")]), 1)


CERTIFICATE = JobType(_summary, single_chunk, whole_spec, _compute)
