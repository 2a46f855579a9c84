"""Faults of the plant that a followed station seems to have, by the events that last and the newest estimates."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from pydantic import TypeAdapter, ValidationError

from station.estimation.detection import Event
from station.faults.kinds import PlantFault
from station.faults.plant import MOST_LOST, MOST_WARMER
from station.geometry import BUFFERS, VALVES

TRIPPED = 99.0
"""A compressor that lacks so much of its flow gives nothing [%]."""

_FAULT: TypeAdapter[PlantFault] = TypeAdapter(PlantFault)


def _lost(estimate: float) -> float:
    """What a machine lacks [%] by the part that it gives [1]."""
    return 100.0 * (1.0 - estimate)


def _as_it_is(estimate: float) -> float:
    return estimate


_ESTIMATES: dict[str, tuple[str, Callable[[float], float]]] = {
    **{f"leak_{name}": (f"leak_{name}", _as_it_is) for name in BUFFERS},
    "compressor_weak": ("compressor_factor", _lost),
    "dispenser_clogged": ("dispenser_factor", _lost),
    "precooler_weak": ("precooler_deviation", _as_it_is),
}
"""The estimate that follows the size of an event, and the size by it."""


def _fields(name: str, size: float) -> dict[str, Any] | None:
    """The fields of the fault that an event of a size tells, the largest at most; None where there is none."""
    leak, stuck = name.removeprefix("leak_"), name.removeprefix("stuck_")
    if leak in BUFFERS:
        return {"kind": "leak", "buffer": leak, "rate_g_per_s": min(size, MOST_LOST)}
    if leak in VALVES:
        return {"kind": "outlet_leak", "valve": leak, "rate_g_per_s": min(size, MOST_LOST)}
    if stuck in VALVES:
        return {"kind": "valve_stuck", "valve": stuck, "position": "open" if size > 0.0 else "closed"}
    if name == "leak_line":
        return {"kind": "line_leak", "rate_g_per_s": min(size, MOST_LOST)}
    if name == "compressor_weak":
        weak = {"kind": "compressor_weak", "loss_percent": size}
        return {"kind": "compressor_tripped"} if size > TRIPPED else weak
    if name == "dispenser_clogged":
        return {"kind": "dispenser_clogged", "loss_percent": min(size, TRIPPED)}
    if name == "precooler_weak":
        return {"kind": "precooler_weak", "warmer_k": min(size, MOST_WARMER)}
    return None


def ailments(
    events: Iterable[Event], lasting: Iterable[str], estimates: Mapping[str, float], zero: float
) -> list[PlantFault]:
    """Faults of the plant that last, each from its begin on, in the order of their names.

    A size that is estimated each second is the newest estimate; others, those of the line, of outlets and of valves,
    are as they were told last. One that has no size left, as a leak that is estimated at nothing, is left out.

    Parameters
    ----------
    events
        In the order in which they were told, each as it was told last.
    lasting
        Names of those that last.
    estimates
        The newest estimates, by names of a filter's states; those that are not there are as they were told.
    zero
        Time of the events at which a run's clock reads 0 [s].
    """
    told = {event.name: event for event in events}
    found = []
    for name in sorted(set(lasting) & set(told)):
        event, size = told[name], told[name].size
        estimated, size_by = _ESTIMATES.get(name, ("", _as_it_is))
        if estimated in estimates:
            size = size_by(estimates[estimated])
        fields = _fields(name, size)
        if fields is None:
            continue
        try:
            fault = _FAULT.validate_python({**fields, "begin_s": max(event.begin_s - zero, 0.0)})
        except ValidationError:  # it has no such size
            continue
        found.append(fault)
    return found
