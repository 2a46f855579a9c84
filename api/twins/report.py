"""A stretch of a twin's record as one self-contained page that prints on A4: figures, what happened, curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from api.comparisons.gantt import clock
from api.http.problems import conflict
from api.http.timeseries import Fold, Selection
from api.pictures import svgs, template
from api.runs.plot import draw
from api.store.notes import NoteRepository
from api.store.records import StoredNote
from api.twins.figures import events_within, figures
from api.twins.messages import EventKind, is_measured
from api.twins.queries import TwinQueries
from api.twins.record_parts import PART_S
from api.twins.windows import HOUR_S, By, Shifts
from station.alarms.states import AlarmState
from station.geometry import TANKS, VALVES

ALARMS_MAX = 60
"""Alarms that a report lists."""

STEPS = 600
"""Steps of a curve: each is drawn by its least and its greatest figure."""

_GROUPS: Sequence[tuple[str, Sequence[tuple[str, str, str, int, float]]]] = (
    ("Vehicles", (
        ("served", "vehicles_served", "", 0, 1), ("left incomplete", "vehicles_incomplete", "", 0, 1),
        ("arrived", "vehicles_arrived", "", 0, 1), ("connected", "vehicles_connected", "", 0, 1),
        ("waiting at the end", "vehicles_waiting", "", 0, 1), ("mean wait", "wait_mean_s", "s", 0, 1),
        ("wait p95", "wait_p95_s", "s", 0, 1), ("longest wait", "wait_max_s", "s", 0, 1),
        ("state of charge, mean", "state_of_charge_mean", "%", 1, 100),
        ("state of charge, least", "state_of_charge_min", "%", 1, 100),
    )),
    ("Hydrogen and energy", (
        ("dispensed", "delivered_kg", "kg", 1, 1), ("energy", "energy_kwh", "kWh", 1, 1),
        ("compressor", "compressor_kwh", "kWh", 1, 1), ("precooler", "precooler_kwh", "kWh", 1, 1),
        ("energy of a kilogram", "kwh_per_kg", "kWh/kg", 2, 1), ("peak of a quarter", "peak_kw", "kW", 1, 1),
    )),
    ("Money", (
        ("energy", "energy_eur", "EUR", 2, 1), ("demand charge", "demand_eur", "EUR", 2, 1),
        ("stock to restore", "stock_eur", "EUR", 2, 1), ("cost", "total_eur", "EUR", 2, 1),
        ("cost of a kilogram", "eur_per_kg", "EUR/kg", 3, 1), ("revenue", "revenue_eur", "EUR", 2, 1),
        ("margin", "margin_eur", "EUR", 2, 1),
    )),
    ("Machines", (
        ("compressor starts", "compressor_starts", "", 0, 1), ("compressor hours", "compressor_s", "h", 2, 1 / 3600),
        ("use of the dispenser", "utilisation", "%", 1, 100), ("availability", "availability", "%", 2, 100),
        ("refusals", "refused_valves", "", 0, 1), ("deadlines missed", "deadlines_missed", "", 0, 1),
    )),
)  # fmt: skip
"""Groups of figures: words, name, unit, decimals, and by what the figure is multiplied."""

_SHOWN = (
    "vehicles_served", "wait_mean_s", "delivered_kg", "energy_kwh", "total_eur", "eur_per_kg", "compressor_starts",
    "compressor_s", "utilisation",
)  # fmt: skip
"""Figures of the table of windows."""

_WORDS = {name: (words, unit, decimals, by) for _, group in _GROUPS for words, name, unit, decimals, by in group}
_MONEY = "Money"
_DASHES = "a dash stands for what these do not tell."

_CURVES = (
    *(f"pressure_{tank}" for tank in TANKS), *(f"temperature_{tank}" for tank in TANKS), "flow_compressor",
    "flow_dispenser", *VALVES,
)  # fmt: skip


def html(
    twins: TwinQueries, notes: NoteRepository, twin_id: str, from_s: int | None, to_s: int | None, by: By,
    shifts: Shifts,
) -> str:  # fmt: skip
    """The page; its picture is inline SVG, nothing is loaded from elsewhere.

    Raises
    ------
    InputError
        as `figures`.
    """
    (whole,) = figures(twins, twin_id, from_s, to_s, By.WINDOW, shifts)
    first, end = whole["from_s"], whole["to_s"]
    windows = [] if by is By.WINDOW else figures(twins, twin_id, first, end, by, shifts)
    windows = windows if len(windows) > 1 else []
    billed = whole["energy_eur"] is not None
    groups = [
        (name, [_said(whole, each) for _, each, *_ in group]) for name, group in _GROUPS if billed or name != _MONEY
    ]
    shown = [name for name in _SHOWN if billed or not name.startswith(("total_eur", "eur_"))]
    state = twins.state(twin_id)
    raised = events_within(twins, twin_id, first, end, (EventKind.ALARM,))
    alarms = [_alarm(event) for event in raised if event["details"]["state"] == AlarmState.UNACKNOWLEDGED]
    missing = end - first - whole["whole_s"]
    return template("api.twins", "report.html").render(
        twin=twin_id,
        title=f"{clock(first)} to {clock(end)} of the station's clock",
        about=f"{state.source}; scenario {state.scenario}; station {state.station}; controller {state.controller}",
        gaps=f"{missing} s of it are kept as minutes, or no more: {_DASHES}" if missing else "",
        groups=groups,
        by=by if by is not By.SHIFT else f"shift of {shifts.length // HOUR_S} h",
        headings=[_heading(name) for name in shown],
        rows=[(clock(each["from_s"]), [_said(each, name)[1] for name in shown]) for each in windows],
        notes=[_note(note) for note in notes.within(twin_id, first, end)],
        alarms=alarms[:ALARMS_MAX],
        more_alarms=max(0, len(alarms) - ALARMS_MAX),
        **_drawn(twins, twin_id, first, end),
    )


def _said(figures_: Mapping[str, Any], name: str) -> tuple[str, str]:
    """A figure's words, and the figure with its unit."""
    words, unit, decimals, by = _WORDS[name]
    value = figures_[name]
    text = "\N{EN DASH}" if value is None else f"{value * by:,.{decimals}f}".replace(",", "\N{NARROW NO-BREAK SPACE}")
    return words, f"{text}\N{NARROW NO-BREAK SPACE}{unit}" if unit and value is not None else text


def _heading(name: str) -> str:
    words, unit, _, _ = _WORDS[name]
    return f"{words} [{unit}]" if unit else words


def _note(note: StoredNote) -> dict[str, str]:
    when = clock(note.time_s) + (f" to {clock(note.to_s)}" if note.to_s is not None else "")
    return {"when": when, "text": note.text, "by": note.author}


def _alarm(event: Mapping[str, Any]) -> dict[str, Any]:
    details = event["details"]
    return {"when": clock(event["time"]), "title": details["title"], "priority": details["priority"]}


def _drawn(twins: TwinQueries, twin_id: str, first: int, end: int) -> dict[str, Any]:
    """The picture of the record, and in words what it shows."""
    measured = is_measured(twins.layout(twin_id))
    step = max(1, -(-(end - first) // STEPS))
    found = _curves(twins, twin_id, first, end, step, measured=measured)
    if len(found["time"]) < 2:
        raise conflict(f"nothing is kept of seconds {first} to {end} of twin {twin_id!r} that could be drawn")
    (picture,) = svgs(lambda: draw(found, (8, 9.5), with_queue=not measured))
    what = "Measured. " if measured else ""
    told = "every second" if step == 1 else f"the least and the greatest of every {step} s"
    return {"picture": picture, "drawn": f"{what}Shown: {told}."}


def _curves(
    twins: TwinQueries, twin_id: str, first: int, end: int, step: int, *, measured: bool
) -> dict[str, np.ndarray]:  # fmt: skip
    """The columns of the curves, read in parts of bounded size."""
    prefix, more = ("measured_", ()) if measured else ("", ("queue_length",))
    names = tuple(f"{prefix}{name}" for name in (*_CURVES, *more))
    part = max(step, PART_S // step * step)
    folded: tuple[float | None, Fold] = (float(step), Fold.MIN_MAX) if step > 1 else (None, Fold.HOLD)
    found = [
        twins.columns(twin_id, Selection(names, float(begin), float(min(begin + part, end) - 1), *folded))
        for begin in range(first, end, part)
    ]
    return {name.removeprefix(prefix): np.concatenate([each[name] for each in found]) for name in ("time", *names)}
