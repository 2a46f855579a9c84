"""The checker refuses every history that is broken, and takes the one that is whole."""

from __future__ import annotations

import copy
import json
from types import SimpleNamespace

import pytest

from tests.nemesis.checker import Evidence, canonical
from tests.nemesis.history import History, read
from tests.nemesis.listener import Ear
from tests.nemesis.verdict import verdict

RUN = {"scenario": {"name": "few"}, "controller": "logic", "replication": 0, "seed": 0}
MANY = {"scenarios": [{"name": "few"}], "controllers": ["logic"], "replications": 3, "seed": 0}
ROWS = [{"replication": k, "t_total": 10.0 * k} for k in range(3)]

COMMANDS = [
    ("t", {"state": "running", "speed": 8, "controller": "logic"}), ("t", {"speed": 9.5}),
    ("t", {"controller": "minlp1"}), ("t", {"state": "paused"}), ("there", {"state": "running"}),
    ("ended", {"state": "running"}), ("ended", {"state": "stopped"}), ("gone", {"state": "running"}),
    ("gone", {"state": "stopped"}), ("gone", None),
]  # fmt: skip
"""What operators wanted of twins, as acknowledged; None: that it be gone."""


def _sample(seq, epoch):
    return {"twin": "t", "epoch": epoch, "seq": seq, "values": {"time": float(seq)}}


def _event(seq, epoch, kind, **details):
    return {"twin": "t", "epoch": epoch, "seq": seq, "kind": kind, "details": details}


@pytest.fixture
def whole():
    """A run, a comparison of two chunks, one that was cancelled, a twin that began twice and obeyed, three others."""
    entries = []

    def note(what, **about):
        entries.append({"at": float(len(entries)), "what": what, **about})

    jobs = [
        ("a", "/v1/runs", RUN, "run-1"), ("b", "/v1/comparisons", MANY, "comparison-1"),
        ("c", "/v1/comparisons", MANY, "comparison-2"),
    ]  # fmt: skip
    for key, path, request, job in jobs:
        note("asked", key=key, path=path, request=request)
        note("acknowledged", key=key, status=202, body=json.dumps({"id": job}))
    note("acknowledged", key="a", status=202, body=json.dumps({"id": "run-1"}))
    note("cancel", id="comparison-2", status=200, body="{}")
    note("asked", key="v", path="/v1/twins/t/vehicles", request={"start_pressure_bar": 100.5})
    note("acknowledged", key="v", status=201, body=json.dumps({"id": "t"}))
    for pressure, sent, arrived in ((7.5, 2, 1), (8.5, 1, 0)):
        for _ in range(sent):
            note("sent", path="/v1/twins/t/vehicles", request={"start_pressure_bar": pressure})
        if arrived:
            note("arrived", path="/v1/twins/t/vehicles", request={"start_pressure_bar": pressure})
    stands = {}
    for twin, wants in COMMANDS:
        stands[twin] = stands.get(twin, {}) | (wants or {})
        note("obeyed", twin=twin, wants=wants, status=200, body=json.dumps(stands[twin]) if wants else "")
    note("looked", twin="t", shown={"state": "paused", "speed": 9.5, "controller": "minlp1"})
    note("looked", twin="gone", shown=None)
    note(
        "obeyed", twin="t", wants={"state": "stopped"}, status=200, body=json.dumps(stands["t"] | {"state": "stopped"})
    )
    ear = Ear(SimpleNamespace(note=note))
    for seq, epoch in ((1, 1), (2, 1), (4, 1), (5, 1), (4, 2), (5, 2)):  # 3 was missed, 4 and 5 told again
        ear.hear(_sample(seq, epoch))
    events = [
        _event(0, 1, "started"), _event(1, 1, "vehicle_added", start_pressure=100.5), _event(2, 2, "resumed"),
        _event(3, 2, "vehicle_added", start_pressure=7.5), _event(4, 2, "vehicle_added", start_pressure=7.5),
        _event(5, 2, "speed_changed", speed=9.5), _event(6, 2, "speed_changed", speed=9.5),
        _event(7, 2, "controller_changed", controller="minlp1"), _event(8, 2, "paused"),
    ]  # fmt: skip
    for event in (*events[:2], _event(2, 1, "arrival"), *events[2:]):
        note("streamed event", document=event)
    note("streamed sample", document=_sample(5, 2))
    state = {"problem": None}
    samples = [_sample(seq, 1 if seq < 4 else 2) for seq in range(7)]
    evidence = Evidence(
        jobs={
            "run-1": {"id": "run-1", "state": "succeeded", **state},
            "comparison-1": {"id": "comparison-1", "state": "succeeded", **state},
            "comparison-2": {"id": "comparison-2", "state": "cancelled", **state},
        },
        rows={"run-1": ROWS[:1], "comparison-1": ROWS, "comparison-2": ROWS[1:2]},
        series={"run-1": "digest"},
        expected={canonical(RUN): {"rows": ROWS[:1], "series": "digest"}, canonical(MANY): {"rows": ROWS}},
        chunks={
            "run-1": [{"number": 0, "runs": 1, "open": False, "rows": 1}],
            "comparison-1": [
                {"number": 0, "runs": 1, "open": False, "rows": 1}, {"number": 1, "runs": 2, "open": False, "rows": 2},
            ],
            "comparison-2": [{"number": 0, "runs": 3, "open": False, "rows": 0}],
        },
        samples={"t": samples},
        columns={"t": {"time": [sample["values"]["time"] for sample in samples]}},
        epochs={"t": {1: 0, 2: 4}},
        events={"t": copy.deepcopy(events)},
        twins={
            "t": {"state": "stopped", "speed": 9.5, "controller": "minlp1"}, "ended": {"state": "stopped"},
            "there": {"state": "running"}, "gone": None,
        },
        service={"readyz": "", "integrity": ""},
    )  # fmt: skip
    return entries, evidence


def test_what_is_whole_is_taken(whole):
    entries, evidence = whole
    assert verdict(History(entries), evidence) == []


def _drop(what, nth=0, **about):
    """Take the nth entry of a kind out of the history."""

    def broken(entries, evidence):
        found = [entry for entry in entries if entry["what"] == what and about.items() <= entry.items()]
        entries.remove(found[nth])

    return broken


def _set(path, value):
    """Change one thing of the evidence."""

    def broken(entries, evidence):
        place = evidence
        for name in path[:-1]:
            place = getattr(place, name) if isinstance(name, str) and isinstance(place, Evidence) else place[name]
        if isinstance(place, Evidence):
            setattr(place, path[-1], value)
        else:
            place[path[-1]] = value

    return broken


def _add(what, **about):
    return lambda entries, evidence: entries.append({"at": 99.0, "what": what, **about})


def _lose(*path):
    def broken(entries, evidence):
        place = getattr(evidence, path[0])
        for name in path[1:-1]:
            place = place[name]
        del place[path[-1]]

    return broken


def _same_job(entries, evidence):
    for entry in entries:
        if entry.get("body") == json.dumps({"id": "comparison-2"}):
            entry["body"] = json.dumps({"id": "comparison-1"})


def _come_twice(pressure):
    def broken(entries, evidence):
        evidence.events["t"] += [_event(seq, 2, "vehicle_added", start_pressure=pressure) for seq in (9, 10)]

    return broken


BROKEN = {
    "never answered": (_drop("acknowledged", key="b"), "b was never acknowledged"),
    "a lost job": (_lose("jobs", "run-1"), "run-1 was acknowledged and is lost"),
    "a job that does not end": (_set(["jobs", "run-1", "state"], "running"), "run-1 was acknowledged and is running"),
    "a job that fails": (_set(["jobs", "run-1", "state"], "failed"), "run-1 failed"),
    "cancelled by nobody": (_drop("cancel"), "comparison-2 is cancelled, and nobody asked"),
    "a job nobody was told of": (
        _set(["jobs", "run-9"], {"id": "run-9", "state": "succeeded"}), "run-9 is there, and nobody was told"
    ),
    "two answers": (_add("acknowledged", key="a", status=202, body='{"id": "run-2"}'), "answered twice, differently"),
    "one job for two keys": (_same_job, "two keys were answered with one job"),
    "another result": (_set(["rows", "run-1"], ROWS[1:2]), "run-1 has other results"),
    "a lost result": (_set(["rows", "comparison-1"], ROWS[:2]), "comparison-1 has other results"),
    "a doubled result": (_set(["rows", "comparison-1"], [*ROWS, ROWS[2]]), "comparison-1 has other results"),
    "a doubled result of what was cancelled": (
        _set(["rows", "comparison-2"], [ROWS[1], ROWS[1]]), "comparison-2, cancelled, has results"
    ),
    "another record": (_set(["series", "run-1"], "other"), "run-1 has another record"),
    "a doubled chunk": (_set(["chunks", "comparison-1", 0, "runs"], 2), "its chunks overlap"),
    "a chunk without result": (_set(["chunks", "comparison-1", 1, "rows"], 0), "chunk 1 has 0 results of 2"),
    "an open chunk": (_set(["chunks", "comparison-2", 0, "open"], True), "a chunk is open for ever"),
    "a vehicle that did not come": (_set(["events", "t", 1, "kind"], "arrival"), "and arrived 0 times"),
    "a vehicle that came twice": (
        _set(["events", "t", 0], _event(0, 1, "vehicle_added", start_pressure=100.5)), "arrived 2 times"
    ),
    "a vehicle without a key that did not come": (
        _lose("events", "t", slice(3, 5)), "sent 2 times, acknowledged 1 times, arrived at t 0 times"
    ),
    "a vehicle without a key that came too often": (_drop("sent"), "sent 1 times, acknowledged 1 times, arrived"),
    "a vehicle without a key that was not acknowledged, and doubled": (
        _come_twice(8.5), "sent 1 times, acknowledged 0 times, arrived at t 2 times"
    ),
    "a change that is forgotten": (_set(["twins", "t", "speed"], 8), "in the end, has speed 8; 9.5 was acknowledged"),
    "a change that was forgotten for a while": (
        _add("looked", twin="there", shown={"state": "paused"}), "has state paused; running was acknowledged"
    ),
    "an answer that tells another state": (
        _add("obeyed", twin="ended", wants={"state": "stopped"}, body='{"state": "running"}'),
        "ended, obeyed at 99 s, has state running; stopped was acknowledged",
    ),
    "a twin that was stopped and runs": (
        _set(["twins", "ended", "state"], "running"), "ended, in the end, has state running; stopped was acknowledged"
    ),
    "a twin that is lost": (_set(["twins", "there"], None), "there, in the end, is lost"),
    "a twin that was deleted and is there": (
        _set(["twins", "gone"], {"state": "stopped"}), "gone, in the end, is stopped, and should not be there"
    ),
    "a change without an event": (
        _set(["events", "t", 8, "kind"], "arrival"), "acknowledged as ('state', 'paused') and is told as None"
    ),
    "a change that is told as another": (
        _set(["events", "t", 7, "details"], {"controller": "minlp2"}),
        "acknowledged as ('controller', 'minlp1') and is told as ('controller', 'minlp2')",
    ),
    "a change nobody asked for": (
        _set(["events", "t", 1], _event(1, 1, "continued")), "its change 0 was acknowledged as ('speed', 9.5)"
    ),
    "changes told in another order": (
        _set(["events", "t", 4], _event(4, 2, "paused")), "as ('speed', 9.5) and is told as ('state', 'paused')"
    ),
    "a vehicle nobody sent": (
        _set(["events", "t", 0], _event(0, 1, "vehicle_added", start_pressure=9.0)), "of 9.0 bar arrived at t"
    ),
    "a hole in the history": (_lose("samples", "t", 3), "history has holes"),
    "a changed sample": (_set(["samples", "t", 2, "values"], {"time": 2.5}), "2 of epoch 1 is not what was told"),
    "a lost sample": (_lose("samples", "t", slice(5, 7)), "sample 5 of epoch 2 was told and is lost"),
    "a sample replaced by no later epoch": (
        _set(["samples", "t", 2, "epoch"], 2), "sample 2 was told in epoch 1 and is kept as one of 2"
    ),
    "a sample of an epoch before": (
        _set(["samples", "t", 5, "epoch"], 1), "sample 5 was told in epoch 2 and is kept as one of 1"
    ),
    "REST that differs": (_set(["columns", "t", "time", 3], 7.0), "time of the history over REST"),
    "an unreported gap": (_drop("gap"), "samples 3 to 3 of epoch 1 were missed and not reported"),
    "a gap that was none": (_add("gap", twin="t", epoch=1, first=1, last=1), "a gap 1 to 1 of epoch 1 was reported"),
    "a sample told late": (
        _add("sample", **_sample(4, 2)), "sample 4 of epoch 2 was published behind 5 of 2"
    ),
    "a hole in the events": (_lose("events", "t", 0), "events have holes"),
    "an epoch that began twice": (_set(["events", "t", 1, "kind"], "resumed"), "epochs [1] began twice"),
    "events of mixed epochs": (_set(["events", "t", 0, "epoch"], 3), "stands behind a later one's"),
    "a lost event": (_lose("events", "t", slice(2, 9)), "event 2 of epoch 1 was streamed and is lost"),
    "a changed event": (_set(["events", "t", 0, "details"], {"x": 1}), "0 of epoch 1 is not what was streamed"),
    "an event streamed twice": (_add("streamed event", document=_event(2, 2, "resumed")), "was streamed twice"),
    "an event never streamed": (_drop("streamed event", 3), "event 2 of epoch 2 was never streamed"),
    "a service that is not ready": (_set(["service", "readyz"], "is not ready"), "readyz: is not ready"),
    "a torn store": (_set(["service", "integrity"], "row 3 missing"), "integrity: row 3 missing"),
}  # fmt: skip


@pytest.mark.parametrize("what", BROKEN)
def test_what_is_broken_is_refused(whole, what):
    entries, evidence = copy.deepcopy(whole)
    breaking, message = BROKEN[what]
    breaking(entries, evidence)
    assert any(message in problem for problem in verdict(History(entries), evidence))


def test_a_history_is_read_as_it_was_written(whole, tmp_path):
    entries, evidence = whole
    History(entries).write(tmp_path / "history.jsonl")
    with (tmp_path / "history.jsonl").open("a") as lines:
        lines.write('{"at": 99.0, "wh')  # a kill
    assert verdict(read(tmp_path / "history.jsonl"), evidence) == []
    assert read(tmp_path / "history.jsonl").of("gap") == [entry for entry in entries if entry["what"] == "gap"]
