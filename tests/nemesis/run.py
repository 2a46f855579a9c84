"""One run: seed -> plan of faults -> history -> evidence -> verdict."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path

from tests.nemesis.arena import Arena, LostError, until
from tests.nemesis.checker import Evidence
from tests.nemesis.client import Client
from tests.nemesis.evidence import afterwards, gather
from tests.nemesis.faults import KINDS, Fault
from tests.nemesis.history import History, read
from tests.nemesis.operators import TWINS, stop
from tests.nemesis.stream import Stream
from tests.nemesis.verdict import verdict
from tests.nemesis.workload import Clients

LOGGED = {
    "writes refused by a full store": ("disk I/O error", "disk is full", "could not extend file"),
    "tracebacks": ("Traceback",),
}
"""Words of the service's log that are counted."""

Tell = Callable[[str], None]


@dataclass(frozen=True)
class Report:
    """What a run was, and what was wrong."""

    wrong: list[str]
    faults: dict[str, int]  # how many of each kind
    figures: dict[str, float]
    took_s: float

    def __str__(self) -> str:
        kinds = ", ".join(f"{count} {kind}" for kind, count in sorted(self.faults.items()))
        figures = ", ".join(f"{name} {figure}" for name, figure in self.figures.items())
        end = "\n".join(self.wrong) or "nothing lost, nothing doubled, no repair by hand"
        return f"{sum(self.faults.values())} faults in {self.took_s:.0f} s: {kinds}\n{figures}\n{end}"


def torment(store: str, faults: list[Fault], seed: int, folder: Path, tell: Tell = lambda _: None) -> Report:
    """Inject faults into a service that works for clients of a seed; what came of it. All is left in `folder`."""
    began = time.monotonic()
    history = History()
    with closing(Arena(folder, store)) as arena:
        try:
            evidence = _lived_through(arena, history, faults, seed, tell)
            wrong = verdict(history, evidence)
            figures = _figures(history, evidence)
        except LostError as lost:
            wrong, figures = [str(lost)], {}
        finally:
            history.write(folder / "history.jsonl")
            (folder / "service.log").write_text("".join([*arena.said, *arena.service.said]))
        figures |= {what: sum(word in line for line in arena.said for word in words) for what, words in LOGGED.items()}
        return Report(wrong, dict(Counter(fault.kind for fault in faults)), figures, time.monotonic() - began)


def _lived_through(arena: Arena, history: History, faults: list[Fault], seed: int, tell: Tell) -> Evidence:
    clients = Clients(arena.service.url, history, seed)
    streams = [Stream(arena.service.url, twin, history) for twin in TWINS]
    until(arena.ready, "the service is not ready at first")
    clients.start()
    for stream in streams:
        stream.start()
    try:
        for number, fault in enumerate(faults, 1):
            time.sleep(fault.pause_s)
            _inject(arena, fault, history, f"{number}/{len(faults)}", tell)
    finally:
        clients.ending.set()
    clients.stop()
    until(arena.ready, "the service is not ready behind the last fault")
    _end_twins(arena, streams, history)
    arena.listener.stop()
    for entry in read(arena.heard).of("sample", "gap"):
        if entry["twin"] in TWINS:
            history.note(**{name: value for name, value in entry.items() if name != "at"})
    evidence = gather(arena, history)
    evidence.service = afterwards(arena)
    return evidence


def _inject(arena: Arena, fault: Fault, history: History, number: str, tell: Tell) -> None:
    began = time.monotonic()
    history.note("fault", **asdict(fault))
    with KINDS[arena.store][fault.kind](arena, fault.choice):
        time.sleep(fault.held_s)
    history.note("healed", kind=fault.kind)
    tell(f"{number:>9} {fault.kind:<24} healed after {time.monotonic() - began:.1f} s")


def _end_twins(arena: Arena, streams: list[Stream], history: History) -> None:
    """Stop the twins, and let the streams tell the rest of them."""
    with closing(Client(arena.service.url, history)) as client:
        for stream in streams:
            stop(client, stream.twin)
            last = client.http.get(f"/v1/twins/{stream.twin}").json()["events"] - 1
            until(lambda stream=stream, last=last: stream.seen >= last, f"the stream of {stream.twin} stands still")
            stream.stop()


def _figures(history: History, evidence: Evidence) -> dict[str, float]:
    states = Counter(job["state"] for job in evidence.jobs.values())
    return {
        "jobs": len(evidence.jobs),
        **states,
        "chunks": sum(len(found) for found in evidence.chunks.values()),
        "requests acknowledged": len(history.of("acknowledged")),
        "commands obeyed": len(history.of("obeyed")),
        "requests refused": len(history.of("refused")),
        "samples heard": len(history.of("sample")),
        "samples streamed": len(history.of("streamed sample")),
        "events streamed": len(history.of("streamed event")),
        "samples kept": sum(len(samples) for samples in evidence.samples.values()),
        "gaps": len(history.of("gap")),
        "epochs": max(len(epochs) for epochs in evidence.epochs.values()),
    }
