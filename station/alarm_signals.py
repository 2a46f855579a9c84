"""Signals that rules of alarms watch, with their units; the same ones at a simulated station and at a measured one."""

from __future__ import annotations

from dataclasses import dataclass

from station.geometry import BUFFERS, TANKS
from station.sensor_names import DETECTABLE

WINDOW = 300
"""Over so many seconds a margin's rate of change is taken [s]."""

MARGINS = (
    *(f"margin_temperature_{tank}" for tank in TANKS),
    *(f"margin_pressure_{buffer}" for buffer in BUFFERS),
    "margin_finish",
)
"""Distances to limits, in the order in which the kernel computes them."""

DETECTED = "detected_"
"""Before the name of an event of the estimator."""

INPUTS = (
    *(f"pressure_{tank}" for tank in TANKS),
    *(f"temperature_{tank}" for tank in TANKS),
    "flow_dispenser",
    "vehicle",
    "queue_length",
    "wait",
    "incomplete",
    "deadline_missed",
    "lateness",
    "data_age",
    "clock_skew",
    *(f"{DETECTED}{name}" for name in DETECTABLE),
)
"""What is known of a second; NaN where it is not."""

COUNTED = ("fill_duration", "given_nothing")
"""What the kernel counts from second to second."""

SIGNALS = (*INPUTS, *MARGINS, *(f"time_to_{name.removeprefix('margin_')}" for name in MARGINS), *COUNTED)
"""Every signal, in the kernel's order."""


@dataclass(frozen=True)
class Signal:
    """A signal that a rule may watch."""

    unit: str
    about: str


def _about(name: str) -> Signal:
    kind, _, tank = name.partition("_")
    margin = name.removeprefix("margin_").removeprefix("time_to_")
    what, _, of = margin.partition("_")
    limit = f"the {what} limit of {of}" if of else "the pressure from which a fill can be brought to its end"
    if name.startswith("margin_"):
        return Signal("K" if what == "temperature" else "bar", f"Distance to {limit}; negative beyond it")
    if name.startswith("time_to_"):
        return Signal("s", f"Until {limit} is reached, as the last {WINDOW} s go on; infinite where it is not")
    if name.startswith(DETECTED):
        return Signal("1", f"1 while the estimator's event {name.removeprefix(DETECTED)} lasts")
    if kind in ("pressure", "temperature"):
        return Signal("bar" if kind == "pressure" else "degC", f"{kind.capitalize()} of {tank}")
    return _OTHERS[name]


_OTHERS = {
    "flow_dispenser": Signal("g/s", "Flow to the vehicle"),
    "vehicle": Signal("index", "Number of the vehicle at the dispenser; -1 for none"),
    "queue_length": Signal("vehicles", "Vehicles that wait behind it; of a simulated station"),
    "wait": Signal("s", "How long the first of the queue has waited; of a simulated station"),
    "incomplete": Signal("1", "1 in a second in which a vehicle leaves incomplete; of a simulated station"),
    "deadline_missed": Signal("1", "1 in a second that logic decided since the controller was late"),
    "lateness": Signal("s", "How late the twin's last second was, by the wall clock"),
    "data_age": Signal("s", "How long nothing was sent to a measured twin, by the wall clock"),
    "clock_skew": Signal("s", "By how much a source's clock is off, before it was put right; of a measured station"),
    "fill_duration": Signal("s", "How long the vehicle at the dispenser has been connected"),
    "given_nothing": Signal("s", "How long it has been given nothing"),
}

SIGNAL_TABLE = {name: _about(name) for name in SIGNALS}
"""Unit and meaning of every signal."""
