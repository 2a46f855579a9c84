"""The slot filled by a program elsewhere: it answers the queryable `hrs/v1/{twin}/decide`."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import orjson
import zenoh

from api.telemetry.session import PRIORITY
from api.telemetry.topics import DECIDE, key
from api.twins.messages import VERSION
from station import ControllerError, Decision, Observation, Station, Status, Valve
from station.geometry import VALVES

ANSWER_MAX = 10_000
"""Largest answer that is read [bytes]."""


class RemoteController:
    """Asks whoever answers the twin's key `decide`.

    An answer is waited for at most `timeout_s` [s]. `controllers.DeadlineController` around it turns an error or
    silence into logic's command. `session` gives the session there is: it may be another one each time.
    """

    name = "remote"
    obeys_hold = True

    def __init__(self, session: Callable[[], zenoh.Session], twin: str, timeout_s: float) -> None:
        self._session = session
        self._twin = twin
        self._timeout_s = timeout_s
        self._key = key(twin, DECIDE)

    def start(self, station: Station) -> None:
        """Nothing to prepare: the program elsewhere keeps its own state."""

    def decide(self, observation: Observation) -> Decision:
        """The answer of whoever answers first.

        Raises
        ------
        ControllerError
            if nobody answers, nobody in time, or the answer is no decision.
        """
        began = time.monotonic()
        question = orjson.dumps({"version": VERSION, "twin": self._twin, **observation._asdict()})
        try:
            replies = self._session().get(
                self._key, payload=question, encoding=zenoh.Encoding.APPLICATION_JSON, timeout=self._timeout_s,
                congestion_control=zenoh.CongestionControl.DROP, priority=PRIORITY, express=True,
            )  # fmt: skip
        except zenoh.ZError as error:
            raise ControllerError(f"nobody can be asked at {self._key}: {error}") from None
        for reply in replies:
            if reply.ok is not None:
                return _decision(reply.ok.payload.to_bytes())
            if time.monotonic() - began >= self._timeout_s:  # zenoh's own error, then
                raise ControllerError(f"no answer at {self._key} within {self._timeout_s:g} s")
            raise ControllerError(f"the program at {self._key} answered with an error")
        raise ControllerError(f"nobody answers at {self._key}")


def _decision(answer: bytes) -> Decision:
    """The decision in an answer like {"command": ["inlet_low", "outlet_high"]}."""
    if len(answer) > ANSWER_MAX:
        raise ControllerError(f"an answer must not exceed {ANSWER_MAX} bytes; given {len(answer)}")
    try:
        document = orjson.loads(answer)
    except orjson.JSONDecodeError as error:
        raise ControllerError(f"an answer must be JSON: {error}") from None
    if not isinstance(document, dict):
        raise ControllerError("an answer must be an object with `command`")
    return Decision(
        _command(document.get("command")), int(Status.RULE), *(_figure(document, n) for n in ("cost", "bound"))
    )


def _command(given: Any) -> int:
    if isinstance(given, int) and not isinstance(given, bool):
        return given
    if isinstance(given, list) and all(isinstance(name, str) and name in VALVES for name in given):
        return sum(Valve[name.upper()] for name in set(given))
    raise ControllerError(f"command must list valves of {', '.join(VALVES)}, or be their bits; given {given!r:.100}")


def _figure(document: dict[str, Any], name: str) -> float:
    given = document.get(name)
    return float(given) if isinstance(given, int | float) and not isinstance(given, bool) else math.nan
