"""The slot a controller sits in: made from what a request says of it, and asked with a deadline in live use."""

from __future__ import annotations

import json
import logging
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures import TimeoutError as LateError
from typing import Any

from controllers.registry import FALLBACK, controllers, load
from station.controller import Controller, Decision, Observation, Status
from station.errors import InputError
from station.parameters import Station
from station.simulation import checked

log = logging.getLogger(__name__)

DEADLINE_MAX = 1.0
"""Live use waits at most this long for a decision [s]: one is due every simulated second."""


def create(name: str, **options: Any) -> Any:
    """The controller of that name with options of its own.

    Raises
    ------
    InputError
        if there is none of that name, or an option is unknown or out of its limits.
    """
    known = controllers()
    if name not in known:
        raise InputError("controller", [("", f"none is called {name!r}; there are {', '.join(known)}")])
    controller = load(name)(**options)
    if not isinstance(controller, Controller):
        raise InputError(
            "controller", [(name, f"{known[name].value} lacks name, obeys_hold, start or decide (station.Controller)")]
        )
    return controller


def parse(text: str) -> tuple[str, dict[str, Any]]:
    """Name and options of a text like `minlp1:horizon=3:engine=pyomo`; a value that is JSON is read as such.

    Raises
    ------
    InputError
        if the text has another form.
    """
    name, *given = text.split(":")
    options = {}
    for item in given:
        option, separator, value = item.partition("=")
        if not separator or not option.isidentifier():
            raise InputError(f"controller {name}", [("", f"an option must be NAME=VALUE; given {item!r}")])
        try:
            options[option] = json.loads(value)
        except json.JSONDecodeError:
            options[option] = value
    return name, options


def create_from(text: str) -> Any:
    """The controller a text like `minlp1:horizon=3` describes.

    Raises
    ------
    InputError
        if the text has another form, or `create` refuses what it says.
    """
    name, options = parse(text)
    return create(name, **options)


class DeadlineController:
    """A controller that answers in time: after `seconds` without an answer, logic's command is used.

    An error of the controller counts as no answer. While a late answer is still being worked on, logic decides.
    """

    def __init__(self, controller: Controller, seconds: float) -> None:
        if not 0 < seconds <= DEADLINE_MAX:
            raise InputError("deadline", [("seconds", f"must be in (0, {DEADLINE_MAX:g}]; given {seconds!r}")])
        self.name = controller.name
        self.obeys_hold = controller.obeys_hold
        self.fallback = create(FALLBACK)
        self._controller = controller
        self._seconds = seconds
        self._worker = ThreadPoolExecutor(1, thread_name_prefix=f"decide-{controller.name}")
        self._pending: Future[Decision] | None = None

    @classmethod
    def at_speed(cls, controller: Controller, speed: float) -> DeadlineController:
        """The deadline of a twin that runs at `speed` times real time: min(1 s, 1 / speed)."""
        return cls(controller, min(DEADLINE_MAX, 1.0 / speed))

    def start(self, station: Station) -> None:
        """Prepare both the controller and its fallback."""
        self._controller.start(station)
        self.fallback.start(station)

    def decide(self, observation: Observation) -> Decision:
        """The controller's decision, or logic's with status FALLBACK."""
        if self._pending is None or self._pending.done():
            self._pending = self._worker.submit(self._controller.decide, observation)
            try:
                answer = self._pending.result(self._seconds)
                return checked(answer, self.name, observation)
            except LateError:
                log.warning("controller %s gave no answer within %g s", self.name, self._seconds)
            except Exception as error:  # noqa: BLE001  # whatever a plug-in raises, the station goes on
                log.warning("controller %s failed: %r", self.name, error)
        return self.fallback.decide(observation)._replace(status=int(Status.FALLBACK))

    def close(self) -> None:
        """Stop waiting for the controller."""
        self._worker.shutdown(wait=False, cancel_futures=True)
