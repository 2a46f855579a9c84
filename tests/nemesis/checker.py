"""Whether a service kept its promises: what its clients noted, held against what it says and stores in the end.

Pure functions of a history and of the evidence gathered when it was over. Each gives what is wrong, in words; nothing
is wrong where they give nothing.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from tests.nemesis.history import Entry, History

Document = dict[str, Any]

FINAL = ("succeeded", "failed", "cancelled")


@dataclass
class Evidence:
    """What the service says when all is over."""

    jobs: dict[str, Document]  # by id, as the API shows them
    rows: dict[str, list[Document]]  # results of each job, as the API shows them
    series: dict[str, str]  # digest of each run's record
    expected: dict[str, Document]  # by request: `rows`, and `series` of a run, as computed undisturbed
    chunks: dict[str, list[Document]]  # of each job as stored: number, runs, open, rows (results stored)
    samples: dict[str, list[Document]]  # of each twin: epoch, seq, values, as `history` answers
    columns: dict[str, Document]  # of each twin: columns of its history, as REST answers
    epochs: dict[str, dict[int, int]]  # of each twin: first sample of each epoch
    events: dict[str, list[Document]]  # of each twin
    twins: dict[str, Document | None]  # each, and each that came and went, as the API shows it; None if there is none
    service: dict[str, str] = field(
        default_factory=dict
    )  # what it says of itself, and its store; empty where all is well


def canonical(request: Document) -> str:
    """A request as a key."""
    return json.dumps(request, sort_keys=True)


def _jobs_asked(history: History) -> dict[str, Entry]:
    """Requests for jobs by key."""
    return {entry["key"]: entry for entry in history.of("asked") if entry["path"] in ("/v1/runs", "/v1/comparisons")}


def _answers(history: History) -> Iterator[tuple[str, Document, str]]:
    """(key, answer, its bytes) of every good answer."""
    for entry in history.of("acknowledged"):
        yield entry["key"], json.loads(entry["body"]), entry["body"]


def acknowledged(history: History, evidence: Evidence) -> Iterator[str]:
    """What was acknowledged is there, and has ended; cancelled only where somebody asked for it."""
    asked = _jobs_asked(history)
    cancelled = {entry["id"] for entry in history.of("cancel")}
    for key in asked.keys() - {key for key, _, _ in _answers(history)}:
        yield f"{key} was never acknowledged"
    for key, answer, _ in _answers(history):
        if key not in asked:
            continue
        job = evidence.jobs.get(answer["id"])
        if job is None:
            yield f"{answer['id']} was acknowledged and is lost"
        elif job["state"] not in FINAL:
            yield f"{answer['id']} was acknowledged and is {job['state']} for ever"
        elif job["state"] == "failed":
            yield f"{answer['id']} failed: {job['problem']}"
        elif job["state"] == "cancelled" and answer["id"] not in cancelled:
            yield f"{answer['id']} is cancelled, and nobody asked for it"


def once(history: History, evidence: Evidence) -> Iterator[str]:
    """One key, one answer, one thing."""
    first: dict[str, str] = {}
    for key, _, body in _answers(history):
        if first.setdefault(key, body) != body:
            yield f"key {key} was answered twice, differently"
    asked = _jobs_asked(history)
    ids = {json.loads(first[key])["id"] for key in asked if key in first}
    if len(ids) < len(asked.keys() & first.keys()):
        yield "two keys were answered with one job"
    for job in evidence.jobs.keys() - ids:
        yield f"{job} is there, and nobody was told: a request was done twice"


def results(history: History, evidence: Evidence) -> Iterator[str]:
    """Results are those of an undisturbed run: every one once, in order, the same figures; of cancelled jobs, some."""
    asked = _jobs_asked(history)
    for key, answer, _ in _answers(history):
        job = evidence.jobs.get(answer["id"])
        if key not in asked or job is None or job["state"] not in ("succeeded", "cancelled"):
            continue
        expected, found = evidence.expected[canonical(asked[key]["request"])], evidence.rows[answer["id"]]
        if job["state"] == "succeeded" and found != expected["rows"]:
            yield f"{answer['id']} has other results than an undisturbed run"
        if job["state"] == "cancelled" and not _among(found, expected["rows"]):
            yield f"{answer['id']}, cancelled, has results no undisturbed run has"
        if job["state"] == "succeeded" and "series" in expected and evidence.series[job["id"]] != expected["series"]:
            yield f"{answer['id']} has another record than an undisturbed run"


def _among(found: list[Document], expected: list[Document]) -> bool:
    """Whether these rows stand among others in the same order, none of them twice."""
    rest = iter(expected)
    return all(row in rest for row in found)


def chunks(_: History, evidence: Evidence) -> Iterator[str]:
    """Every run belongs to one chunk, every chunk of a job that succeeded has one result, none is open at the end."""
    for job, found in evidence.chunks.items():
        if evidence.jobs.get(job, {}).get("state") == "succeeded":
            ends = [(chunk["number"], chunk["number"] + chunk["runs"]) for chunk in found]
            if any(end != begin for (_, end), (begin, _) in pairwise(ends)):
                yield f"{job}: its chunks overlap, or leave runs out: {ends}"
            for chunk in found:
                if chunk["rows"] != chunk["runs"]:
                    yield f"{job}: chunk {chunk['number']} has {chunk['rows']} results of {chunk['runs']}"
        if any(chunk["open"] for chunk in found):
            yield f"{job}: a chunk is open for ever"


def replay(history: History, evidence: Evidence) -> Iterator[str]:
    """History has every sample once; each that was heard is there bit for bit, unless a later epoch replaced it."""
    kept: dict[tuple[str, int], Document] = {}
    for twin, samples in evidence.samples.items():
        numbers = [sample["seq"] for sample in samples]
        if numbers != list(range(len(numbers))):
            yield f"{twin}: history has holes or doubles: {_breaks(numbers)}"
        kept |= {(twin, sample["seq"]): sample for sample in samples}
        for name, column in evidence.columns[twin].items():
            if column != [sample["values"][name] for sample in samples]:
                yield f"{twin}: {name} of the history over REST is not that over zenoh"
    for sample in _heard(history):
        twin, seq, epoch = sample["twin"], sample["seq"], sample["epoch"]
        found = kept.get((twin, seq))
        if found is None:
            if not _retold(evidence, twin, epoch, seq):
                yield f"{twin}: sample {seq} of epoch {epoch} was told and is lost"
        elif found["epoch"] == epoch and found["values"] != sample["values"]:
            yield f"{twin}: sample {seq} of epoch {epoch} is not what was told"
        elif found["epoch"] < epoch or (found["epoch"] > epoch and not _retold(evidence, twin, epoch, seq)):
            yield f"{twin}: sample {seq} was told in epoch {epoch} and is kept as one of {found['epoch']}"


def _heard(history: History) -> Iterator[Document]:
    """Samples that were published, over zenoh and on the event stream."""
    yield from history.of("sample")
    for entry in history.of("streamed sample"):
        yield entry["document"]


def _retold(evidence: Evidence, twin: str, epoch: int, seq: int) -> bool:
    """Whether a later epoch began at that sample or before."""
    return any(later > epoch and first <= seq for later, first in evidence.epochs[twin].items())


def _breaks(numbers: list[int]) -> list[tuple[int, int]]:
    return [pair for pair in pairwise(numbers) if pair[1] != pair[0] + 1][:5]


def gaps(history: History, evidence: Evidence) -> Iterator[str]:
    """What a subscriber missed within an epoch it saw: a gap that it reported, which the history fills."""
    reported = Counter((gap["twin"], gap["epoch"], gap["first"], gap["last"]) for gap in history.of("gap"))
    last: dict[str, tuple[int, int]] = {}
    for sample in history.of("sample"):
        twin, epoch, seq = sample["twin"], sample["epoch"], sample["seq"]
        before, last[twin] = last.get(twin, (0, 0)), (epoch, seq)
        if epoch < before[0] or (epoch == before[0] and seq <= before[1]):
            yield f"{twin}: sample {seq} of epoch {epoch} was published behind {before[1]} of {before[0]}"
        if epoch == before[0] and seq > before[1] + 1:
            hole = (twin, epoch, before[1] + 1, seq - 1)
            if not reported[hole]:
                yield f"{twin}: samples {hole[2]} to {hole[3]} of epoch {epoch} were missed and not reported"
            reported[hole] -= 1
    for (twin, epoch, first, final), count in reported.items():
        if count > 0:
            yield f"{twin}: a gap {first} to {final} of epoch {epoch} was reported that was none"
        known = {sample["seq"] for sample in evidence.samples[twin][first : final + 1]}
        missing = set(range(first, final + 1)) - known
        if missing and not _retold(evidence, twin, epoch, min(missing)):
            yield f"{twin}: the history does not fill the gap {first} to {final}"


def told(_: History, evidence: Evidence) -> Iterator[str]:
    """Events are numbered without holes, in epochs that only rise, one start of each."""
    for twin, events in evidence.events.items():
        numbers = [event["seq"] for event in events]
        if numbers != list(range(len(numbers))):
            yield f"{twin}: events have holes or doubles: {_breaks(numbers)}"
        epochs = [event["epoch"] for event in events]
        if epochs != sorted(epochs):
            yield f"{twin}: an event of an earlier epoch stands behind a later one's"
        begun = Counter(event["epoch"] for event in events if event["kind"] in ("started", "resumed"))
        if doubled := [epoch for epoch, count in begun.items() if count > 1]:
            yield f"{twin}: epochs {doubled} began twice"


def streamed(history: History, evidence: Evidence) -> Iterator[str]:
    """An event stream that was resumed told every event, in order; each is kept unless a later epoch replaced it."""
    shown: dict[str, list[Document]] = {}
    for entry in history.of("streamed event"):
        shown.setdefault(entry["document"]["twin"], []).append(entry["document"])
    for twin, events in shown.items():
        kept = {event["seq"]: event for event in evidence.events[twin]}
        newest = max((event["epoch"] for event in evidence.events[twin]), default=0)
        for event in events:
            found = kept.get(event["seq"])
            lost = newest <= event["epoch"] if found is None else found["epoch"] < event["epoch"]
            if lost:
                yield f"{twin}: event {event['seq']} of epoch {event['epoch']} was streamed and is lost"
            elif found is not None and found["epoch"] == event["epoch"] and found != event:
                yield f"{twin}: event {event['seq']} of epoch {event['epoch']} is not what was streamed"
        seen = {(event["epoch"], event["seq"]) for event in events}
        if len(seen) < len(events):
            yield f"{twin}: an event was streamed twice"
        for event in evidence.events[twin]:
            if event["seq"] >= events[0]["seq"] and (event["epoch"], event["seq"]) not in seen:
                yield f"{twin}: event {event['seq']} of epoch {event['epoch']} was never streamed"
