"""Twins that begin with the state of another at a second of it: what if another controller had been in the slot."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np

from api.controllers.service import check
from api.http.problems import conflict
from api.settings import Settings
from api.twins.commands import REMOTE
from api.twins.controller_slot import ControllerSlot
from api.twins.durable import ask
from api.twins.messages import EventKind
from api.twins.schemas import ComingVehicle, Source, TwinOrder, TwinRequest
from api.twins.service import Twins
from api.twins.simulated import SimulatedTwin
from controllers import create_from
from controllers.registry import FALLBACK
from station import InputError, StationError
from station.live import LiveRun

LONGEST_S = 172_800
"""A state is simulated again over at most so many seconds."""

PATIENCE_S = 20.0
"""And given up after so long, with the twins as which it began [s]."""

CHAIN_MAX = 20
"""Most twins that began as one another, each at a second of the one before."""

COMPARED = 4096
"""Rows that are compared at once with what was told."""

_EVENTS_AT_ONCE = 1000


class _Budget(NamedTuple):
    """What is left to spend on a state."""

    until: float  # monotonic [s]
    twins: int  # more of them

    def check(self, second: int, controller: str) -> None:
        """Raise InputError if the time is over."""
        if time.monotonic() > self.until:
            raise _refused(f"second {second} is reached after {PATIENCE_S:g} s: {controller} decides too slowly")


class _Standing(NamedTuple):
    """A run at the begin of a second, and what decides it."""

    run: LiveRun
    slot: ControllerSlot
    controller: str
    row: tuple[float, ...]  # of the second before; () where there is none

    def snapshot(self, controller: str) -> bytes:
        """The state, with what the controller remembers where it is the one that acted."""
        memories = self.slot.memories() if controller == self.controller != REMOTE else {}
        row = {"row": np.array(self.row)} if self.row else {}
        return self.run.snapshot(**memories, **row)


def what_if(twins: Twins, order: TwinOrder, settings: Settings) -> tuple[TwinRequest, bytes]:
    """The twin that an order means, and the snapshot of another's state with which it begins.

    The vehicles that came to the other one come to it, too, those added by hand among them; the plant has the same
    faults. A second that has passed is simulated again from the beginning, with the commands that were given, and
    compared with the rows that were told.

    Raises
    ------
    InputError
        if there is no such twin, or the state of that second cannot be had exactly; the reason is said.
    ProblemError
        409 where the other twin follows measurements: its state is estimated, not known.
    """
    of = _simulated(twins, order.of or "")
    known = twins.request_of(of)
    scenario = twins.scenario(of)
    chosen = order.controller if "controller" in order.model_fields_set else None
    if chosen is not None and chosen != REMOTE:
        check(chosen, [scenario], settings)
    budget = _Budget(time.monotonic() + PATIENCE_S, CHAIN_MAX)
    with _standing(twins, of, order.at_s, budget) as there:
        second, controller = there.run.seq, chosen or there.controller
        snapshot = there.snapshot(controller)
    coming = [
        ComingVehicle(at_s=event["time"], figures=_figures(event))
        for event in _commands(twins, of)
        if event["kind"] == EventKind.VEHICLE_ADDED and event["time"] > second
    ]
    coming += [each for each in known.coming if each.at_s >= max(second, twins.samples(of))]  # to itself, still
    changes = {
        "scenario": scenario, "of": of, "at_s": second, "controller": controller, "at_end": known.at_end,
        "replication": known.replication, "seed": known.seed, "coming": coming,
    }  # fmt: skip
    return TwinRequest.model_construct(**{**dict(order), **changes}), snapshot


def _simulated(twins: Twins, of: str) -> str:
    """The simulated twin of that id, or the one that it plays."""
    if not twins.known(of):
        raise InputError("request", [("of", f"no twin is called {of!r}")])
    known = twins.request_of(of)
    if known.source is Source.REPLAY and known.of is not None:
        return _simulated(twins, known.of)
    if known.source is Source.MEASURED:
        raise conflict(
            f"twin {of!r} follows measurements: its state is estimated, not known; a forecast begins with the estimate"
        )
    return of


def _refused(reason: str) -> InputError:
    return InputError("request", [("at_s", reason)])


@contextmanager
def _standing(twins: Twins, of: str, second: int | None, budget: _Budget) -> Iterator[_Standing]:
    """A twin at a second, or as it stands now."""
    known, scenario = twins.request_of(of), twins.scenario(of)
    slot = ControllerSlot(create_from, scenario.known_station)
    run = LiveRun(scenario, known.at_end, known.replication, known.seed)
    try:
        if second is None:
            yield _now(twins, of, run, slot)
        else:
            yield _again(twins, of, second, run, slot, budget)
    finally:
        slot.close()


def _now(twins: Twins, of: str, run: LiveRun, slot: ControllerSlot) -> _Standing:
    """A live twin as it stands between two seconds."""
    live = twins.live(of)
    if not isinstance(live, SimulatedTwin):
        raise _refused(f"must be given: twin {of!r} is {twins.state(of).state}")
    snapshot, controller = ask(live, live.standing)
    memories = run.restore(snapshot)
    if controller != REMOTE:
        slot.take(controller, "max")
        slot.remember(memories)
    return _Standing(run, slot, controller, tuple(memories.get("row", np.zeros(0)).tolist()))


def _again(
    twins: Twins, of: str, second: int, run: LiveRun, slot: ControllerSlot, budget: _Budget
) -> _Standing:  # fmt: skip
    """A twin at a second that has passed: simulated again, and compared with what it told."""
    newest = twins.samples(of)
    if second > newest:
        raise _refused(f"must be at most {newest}, the second that {of!r} simulates next; given {second}")
    controller, row = _beginning(twins, of, run, slot, budget)
    first = run.seq
    if second < first:
        raise _refused(f"must be at least {first}, where {of!r} began; given {second}")
    if second - first > LONGEST_S:
        raise _refused(f"lies {second - first} s behind a known state; at most {LONGEST_S} s are simulated again")
    commands = deque(_commands(twins, of))
    rows: list[tuple[float, ...]] = []
    while True:
        while commands and commands[0]["time"] <= run.time:
            controller = _obeyed(commands.popleft(), controller, run, slot)
        if run.seq == second or len(rows) == COMPARED:
            _compare(twins, of, run.seq - len(rows), rows, whole=run.seq == second)
            rows = []
        if run.over:
            raise _refused(f"twin {of!r} had ended by then")
        if run.seq == second:
            return _Standing(run, slot, controller, row)
        budget.check(run.seq, controller)
        row = run.step(slot.state).row
        rows.append(row)


def _beginning(
    twins: Twins, of: str, run: LiveRun, slot: ControllerSlot, budget: _Budget
) -> tuple[str, tuple[float, ...]]:  # fmt: skip
    """Bring a run to the first second of a twin: who decides, and the row before."""
    known, first = twins.request_of(of), next(iter(twins.events(of, -1, 1)), None)
    if first is None or first["kind"] != EventKind.STARTED:
        raise _refused(f"the first events of twin {of!r} are no longer kept: who decided is not known")
    controller = str(first["details"]["controller"])
    row: tuple[float, ...] = ()
    if known.of is not None and known.at_s is not None:
        if not twins.known(known.of):
            raise _refused(f"twin {of!r} began as {known.of!r}, which is gone; leave at_s out to begin as it is now")
        if not budget.twins:
            raise _refused(f"is that of a twin which began as another, and so on more than {CHAIN_MAX} times")
        with _standing(twins, known.of, known.at_s, budget._replace(twins=budget.twins - 1)) as there:
            memories, row = run.restore(there.snapshot(controller)), there.row
        _take(slot, controller, run)
        slot.remember(memories)
    else:
        _take(slot, controller, run)
    return controller, row


def _take(slot: ControllerSlot, controller: str, run: LiveRun) -> None:
    if controller == REMOTE:
        raise _refused(f"{REMOTE} decided from second {run.seq} on, and cannot be asked again")
    try:
        slot.take(controller, "max")
    except StationError as error:
        raise _refused(f"{controller}, which decided from second {run.seq} on, does not start: {error}") from None


def _obeyed(command: dict[str, Any], controller: str, run: LiveRun, slot: ControllerSlot) -> str:
    """Do what a command, or a restart, did; who decides then."""
    details = command["details"]
    if command["kind"] == EventKind.VEHICLE_ADDED:
        run.add_vehicle(**_figures(command))
        return controller
    if command["kind"] == EventKind.RESUMED and not str(details["memory"]).startswith(f"{FALLBACK} in its place"):
        return controller
    _take(slot, str(details["controller"]), run)
    return str(details["controller"])


def _figures(event: dict[str, Any]) -> dict[str, float]:
    return {name: value for name, value in event["details"].items() if name != "vehicle"}


_COMMANDS = (EventKind.VEHICLE_ADDED, EventKind.CONTROLLER_CHANGED, EventKind.RESUMED)


def _commands(twins: Twins, of: str) -> Iterator[dict[str, Any]]:
    """The events that changed what a twin did, in order."""
    last = -1
    while found := twins.events(of, last, _EVENTS_AT_ONCE):
        yield from (event for event in found if event["kind"] in _COMMANDS)
        last = found[-1]["seq"]


def _compare(twins: Twins, of: str, first: int, rows: list[tuple[float, ...]], *, whole: bool) -> None:
    """Refuse rows that differ from those that were told from second `first` on; `whole`: the last one must be kept."""
    if not rows:
        return
    kept = [sample for sample in twins.history(of, first, len(rows)) if sample.seq < first + len(rows)]
    if whole and (not kept or kept[-1].seq != first + len(rows) - 1):
        raise _refused(f"second {first + len(rows) - 1} of {of!r} is not kept whole: its state cannot be compared")
    if not kept:
        return
    told = np.array([sample.row for sample in kept], np.float64)
    again = np.array([rows[sample.seq - first] for sample in kept], np.float64)
    same = (told == again) | (np.isnan(told) & np.isnan(again))
    if not same.all():
        other = kept[int(np.argmin(same.all(axis=1)))].seq
        raise _refused(
            f"second {other} of {of!r} cannot be had again: something decided there that is not told, such as a "
            "controller that was late"
        )
