"""Drills: faults put into a live simulated twin's station, and how another twin that follows it finds them."""

from __future__ import annotations

from concurrent.futures import Future
from typing import Any

from pydantic import TypeAdapter, ValidationError

from api.http.problems import conflict, input_error, not_found
from api.twins.commands import TwinCommands
from api.twins.drill_schemas import Drill
from api.twins.drill_schemas import TwinDrills as Drills
from api.twins.durable import ask
from api.twins.messages import EventKind
from api.twins.schemas import with_faults
from api.twins.simulated import SimulatedTwin
from station import InputError
from station.estimation.detection import Event, latest
from station.estimation.score import score
from station.faults.kinds import FAULTS_MAX, Fault

_FAULT: TypeAdapter[Fault] = TypeAdapter(Fault)

EVENTS_AT_ONCE = 1000
"""Events read from the store at once."""


class TwinDrills(TwinCommands):
    """Drills of simulated twins."""

    def drill(self, twin_id: str, fault: Fault) -> Drills:
        """Put a fault into a live twin's plant, sensor or clock, once however often it is sent; the twin's drills then.

        Raises
        ------
        InputError
            if it begins in the past, the plant cannot have it, or there are FAULTS_MAX.
        NotYet
            if that is not stored within 2 s.
        """
        twin = self._simulated(twin_id)

        def begin() -> Future[None]:
            now, known = twin.current.row[0] + 1 if twin.current else 0.0, list(twin.request.drills)
            if fault in known:  # the request has been sent again, since its answer was lost
                return twin.store_with()
            if fault.begin_s < now:
                raise _wrong("begin_s", f"must be the twin's next second or later, {now:g} s; given {fault.begin_s:g}")
            if len(known) + len(twin.request.scenario.faults) >= FAULTS_MAX:
                known = _without_oldest(known, now)
            told = {**fault.model_dump(mode="json"), "event": fault.event}
            return self._put(twin, [*known, fault], told)

        self._wait_for(ask(twin, begin))
        return self.drills(twin_id)

    def end_drills(self, twin_id: str) -> Drills:
        """End the drills that last, and forget those to come; the twin's drills then."""
        twin = self._simulated(twin_id)

        def end() -> Future[None]:
            now = twin.current.row[0] + 1 if twin.current else 0.0
            kept = [
                each if each.until <= now else each.model_copy(update={"end_s": now})
                for each in twin.request.drills
                if each.begin_s < now
            ]
            return self._put(twin, kept, {"ended_s": now})

        self._wait_for(ask(twin, end))
        return self.drills(twin_id)

    @staticmethod
    def _put(twin: SimulatedTwin, drills: list[Fault], told: dict[str, Any]) -> Future[None]:
        try:
            with_faults(twin.request.scenario, drills)
        except ValidationError as error:
            raise input_error("request", error) from None
        twin.drill(drills, told)
        return twin.store_with()

    def drills(self, twin_id: str, followed_by: str | None = None) -> Drills:
        """The drills of a twin; with `followed_by`, how that twin has found them.

        Raises
        ------
        ProblemError
            404 where there is no such twin; 409 where the other one follows no measurements.
        """
        given = self._now(twin_id)
        faults = [*given["scenario"].get("faults", []), *given.get("drills", [])]
        known = [_FAULT.validate_python(each) for each in faults]
        scored: dict[str, Any] = {"faults": [None] * len(known), "false_events": []}
        if followed_by is not None:
            told, follower = self._found_by(followed_by), self.request_of(followed_by)
            if follower.tags is None:
                raise AssertionError("a measured twin has tags")
            scored = score(told, known, follower.tags, follower.scenario.station)
        items = [_drill(fault, judged) for fault, judged in zip(known, scored["faults"], strict=True)]
        return Drills(twin=twin_id, followed_by=followed_by, items=items, false_events=scored["false_events"])

    def _found_by(self, twin_id: str) -> list[Event]:
        if not self.known(twin_id):
            raise not_found("twin", twin_id)
        if not self.measures(twin_id):
            raise conflict(f"twin {twin_id!r} follows no measurements: it finds nothing")
        told: list[Event] = []
        last = -1
        while found := self.events(twin_id, last, EVENTS_AT_ONCE):
            told += [Event(**each["details"]) for each in found if each["kind"] == EventKind.DETECTED]
            last = found[-1]["seq"]
        return latest(told)


def _wrong(field: str, message: str) -> InputError:
    return InputError("request", [(field, message)])


def _without_oldest(drills: list[Fault], now: float) -> list[Fault]:
    """The drills without the oldest that is over."""
    over = next((each for each in drills if each.until <= now), None)
    if over is None:
        raise _wrong("", f"there are {FAULTS_MAX} faults already, and none of them is over")
    return [each for each in drills if each is not over]


_SCORED = ("found", "delay_s", "begin_error_s", "size_error", "untold")


def _drill(fault: Fault, judged: dict[str, Any] | None) -> Drill:
    scored = judged or dict.fromkeys(_SCORED)
    return Drill(
        fault=fault.model_dump(mode="json"),
        **fault.told(),
        **{name: scored[name] for name in _SCORED},
    )
