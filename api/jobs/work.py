"""A type of job, as executors and the queue see it: four functions of its spec."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from api.store.records import Chunk, ChunkResult, JobKind, Lease

CHUNK_END_S = 10.0
"""A chunk that takes longer than it should is cut anew after this long; a single run is never cut [s]."""

Spec = dict[str, Any]
"""All that a job's results depend on, as JSON."""


@dataclass(frozen=True, slots=True)
class JobType:
    """How the jobs of one kind are shown, cut and computed. Functions of modules: other processes find them by name.

    The bytes of a job's results depend on its spec alone: not on who computes them, when, how often, or how they are
    cut.

    Attributes
    ----------
    summarize
        Names and numbers of a spec, which answers show instead of whole scenarios.
    initial_chunks
        The chunks of a new job, in the order of its results; a chunk's number is that of its first run.
    task
        All that the computation of a leased chunk needs of its job's spec, as JSON.
    compute
        The result of a chunk, given its task.
    """

    summarize: Callable[[Spec], dict[str, Any]]
    initial_chunks: Callable[[Spec], list[Chunk]]
    task: Callable[[Spec, Lease], dict[str, Any]]
    compute: Callable[[dict[str, Any]], ChunkResult]


JobTypes = Mapping[JobKind, JobType]


def kind_of(lease: Lease) -> JobKind:
    """The kind of the job that a leased chunk belongs to: its id begins with it."""
    return JobKind(lease.job.partition("-")[0])


class RunError(Exception):
    """One run of many has failed; `cause` says why. It comes back whole from another process."""

    def __init__(self, run: dict[str, Any], cause: Exception) -> None:
        super().__init__(run, cause)
        self.run, self.cause = run, cause


def single_chunk(_spec: Spec) -> list[Chunk]:
    """The one chunk of a job that is not cut."""
    return [Chunk(0, {}, 1)]


def whole_spec(spec: Spec, _lease: Lease) -> dict[str, Any]:
    """The task of the one chunk of a job that is not cut."""
    return spec


def encoded_rows(rows: list[dict[str, Any]]) -> bytes:
    """Rows of results as they are stored."""
    return json.dumps(rows, allow_nan=False, separators=(",", ":")).encode()
