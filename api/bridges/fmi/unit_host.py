"""The process in which a foreign unit runs: it loads the unit and steps it as it is told."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterable
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

MESSAGES_MAX = 20
"""So many of the unit's last messages are told where it refuses."""

_OK = 0
"""The status of a message that is no complaint, in FMI 2.0 and 3.0."""

_INTEGERS = ("Integer", "Enumeration", *(f"{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64)))


class Opening(NamedTuple):
    """What is needed to load a unit and to initialise it."""

    path: str
    folder: str  # into which it is unpacked
    version: int  # of FMI
    token: str
    identifier: str
    starts: list[tuple[str, int, float]]  # type, value reference and value, of parameters and inputs
    outputs: list[tuple[str, int, bool]]  # type and value reference; whether the mean over a second's steps is wanted
    steps: int  # a second


class _Hosted:
    """A unit of either version."""

    def __init__(self, opening: Opening, messages: list[str]) -> None:
        import fmpy
        from fmpy.fmi2 import FMU2Slave
        from fmpy.fmi3 import FMU3Slave

        self._opening = opening
        where = str(fmpy.extract(opening.path, opening.folder))
        kind = FMU2Slave if opening.version == 2 else FMU3Slave
        self._unit: Any = kind(
            guid=opening.token, unzipDirectory=where, modelIdentifier=opening.identifier, instanceName="plant"
        )  # fmt: skip

        def keep(*given: Any) -> None:  # of FMI 2.0 and 3.0: status, category and text come last
            status, _, text = given[-3:]
            if status == _OK:
                return
            messages.append(text.decode(errors="replace") if isinstance(text, bytes) else str(text))
            del messages[:-MESSAGES_MAX]

        if opening.version == 2:
            self._unit.instantiate(callbacks=_callbacks(keep), loggingOn=True)
            self._unit.setupExperiment(startTime=0.0)
        else:
            self._unit.instantiate(logMessage=keep, loggingOn=True)
        self._set(opening.starts)
        self._unit.enterInitializationMode()
        self._unit.exitInitializationMode()

    def _set(self, given: Iterable[tuple[str, int, float]]) -> None:
        for kind, reference, value in given:
            name = "Integer" if kind == "Enumeration" else kind
            exact: Any = bool(value) if kind == "Boolean" else round(value) if kind in _INTEGERS else value
            getattr(self._unit, f"set{name}")([reference], [exact])

    def outputs(self) -> list[float]:
        """The values of all outputs now, in order."""
        return [self._value(kind, reference) for kind, reference, _ in self._opening.outputs]

    def _value(self, kind: str, reference: int) -> float:
        name = "Integer" if kind == "Enumeration" else kind
        return float(getattr(self._unit, f"get{name}")([reference])[0])

    def second(
        self, time: float, before: list[tuple[str, int, float]], inputs: list[tuple[str, int, float]]
    ) -> list[float]:
        """Step a second; the values of all outputs, at its end or their mean over its steps."""
        self._set(before)
        self._set(inputs)
        steps, outputs = self._opening.steps, self._opening.outputs
        values = [0.0] * len(outputs)
        for step in range(steps):
            ended = self._unit.doStep(currentCommunicationPoint=time + step / steps, communicationStepSize=1.0 / steps)
            if ended is not None and (ended[1] or ended[2]):  # FMI 3.0 says so, and is no error
                what = "ends the simulation" if ended[1] else "returned early"
                raise RuntimeError(f"the unit {what} within the second")
            for place, (kind, reference, mean) in enumerate(outputs):
                if mean or step == steps - 1:
                    values[place] += self._value(kind, reference)
        return [value / steps if each[2] else value for value, each in zip(values, outputs, strict=True)]

    def close(self) -> None:
        """End it."""
        self._unit.terminate()
        self._unit.freeInstance()


def _callbacks(keep: Any) -> Any:
    """Those of FMI 2.0, with `keep` for the logger."""
    from ctypes import byref

    from fmpy.fmi2 import defaultCallbacks, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
    from fmpy.logging import addLoggerProxy

    found = fmi2CallbackFunctions()
    found.logger = fmi2CallbackLoggerTYPE(keep)
    found.allocateMemory, found.freeMemory = defaultCallbacks.allocateMemory, defaultCallbacks.freeMemory
    addLoggerProxy(byref(found))  # which fills in what messages are formatted with
    return found


def _end_with_parent() -> None:
    """End this process, also while its unit hangs, when the one that has started it was killed."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def host(pipe: Connection) -> None:
    """Load the unit that the first message names, and step it a second a message, until None comes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # it is the other process's, which ends this one
    threading.Thread(target=_end_with_parent, daemon=True).start()
    os.dup2(2, 1)  # what the unit prints is no output of the command
    messages: list[str] = []
    unit: _Hosted | None = None
    answer: tuple[str, Any]
    try:
        while (message := pipe.recv()) is not None:
            try:
                if unit is None:
                    unit = _Hosted(message, messages)
                    answer = ("values", unit.outputs())
                else:
                    answer = ("values", unit.second(*message))
            except Exception as error:  # noqa: BLE001 - whatever FMPy raises, who asked is told
                said = "".join(f"\n  {line:.500}" for line in messages)
                answer = ("error", f"the unit refuses: {error!s:.500}{said}")
            pipe.send(answer)
        if unit is not None:
            unit.close()
    except EOFError:  # nobody asks any more
        return
