"""`hrs watch`: a live twin in the terminal, over zenoh alone."""

from __future__ import annotations

import json
import time
from typing import Any

import zenoh
from rich.console import Console, Group
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from api.settings import Settings
from api.telemetry.session import connect
from api.telemetry.topics import ALIVE, EVENT, SAMPLE, key
from station import InputError
from station.geometry import BUFFERS

REFRESH_S = 0.2
"""How often the screen is drawn [s]."""

EVENTS_SHOWN = 8
"""Newest events on the screen."""

_TANKS = (*BUFFERS, "vehicle")


def watch(twin: str, endpoint: str, settings: Settings, seconds: float | None = None) -> None:
    """Show a twin until interrupted, or for so many seconds.

    Raises
    ------
    InputError
        if no router answers, or no twin of that id is alive.
    """
    with connect(endpoint, settings) as session:
        _check_alive(session, twin)
        newest = session.declare_subscriber(key(twin, SAMPLE), zenoh.handlers.RingChannel(1))
        told = session.declare_subscriber(key(twin, EVENT), zenoh.handlers.RingChannel(100))
        view = View(twin)
        for reply in session.get(key(twin, SAMPLE), timeout=5):
            if reply.ok is not None:
                view.sample(json.loads(reply.ok.payload.to_bytes()))
        for reply in session.get(f"{key(twin, EVENT)}?limit={EVENTS_SHOWN}", timeout=5):
            if reply.ok is not None:
                for event in json.loads(reply.ok.payload.to_bytes())["events"]:
                    view.event(event)
        until = None if seconds is None else time.monotonic() + seconds
        with Live(view.draw(), console=Console(), refresh_per_second=1 / REFRESH_S, transient=False) as live:
            while until is None or time.monotonic() < until:
                while (sample := newest.try_recv()) is not None:
                    view.sample(json.loads(sample.payload.to_bytes()))
                while (event := told.try_recv()) is not None:
                    view.event(json.loads(event.payload.to_bytes()))
                live.update(view.draw())
                time.sleep(REFRESH_S)


def _check_alive(session: zenoh.Session, twin: str) -> None:
    alive = {
        str(reply.ok.key_expr).split("/")[2]
        for reply in session.liveliness().get(key("*", ALIVE), timeout=5)
        if reply.ok
    }
    if twin not in alive:
        known = f"; there are {', '.join(sorted(alive))}" if alive else "; none is"
        raise InputError("watch", [("TWIN", f"no twin called {twin!r} is live{known}")])


class View:
    """The view in the terminal."""

    def __init__(self, twin: str) -> None:
        self._twin = twin
        self._sample: dict[str, Any] | None = None
        self._heard = time.monotonic()
        self._events: dict[int, dict[str, Any]] = {}

    def sample(self, document: dict[str, Any]) -> None:
        """A new sample."""
        self._sample = document
        self._heard = time.monotonic()

    def event(self, document: dict[str, Any]) -> None:
        """An event; one may come twice, as it is published and in the answer to what came before."""
        self._events[document["seq"]] = document
        for old in sorted(self._events)[:-EVENTS_SHOWN]:
            del self._events[old]

    def draw(self) -> Panel:
        """The screen."""
        if self._sample is None:
            return Panel(f"no sample for {time.monotonic() - self._heard:.0f} s", title=self._twin)
        values = self._sample["values"]
        silent = time.monotonic() - self._heard
        clock = f"{self._twin}: {values['time']:,.0f} s".replace(",", " ")
        title = clock if silent < 3 else f"{clock} - no sample for {silent:.0f} s"
        return Panel(Group(self._tanks(values), self._line(values), self._log()), title=title)

    def _tanks(self, values: dict[str, Any]) -> Table:
        table = Table(box=None, padding=(0, 1))  # 72 columns: it fits a narrow terminal
        for heading in ("", "pressure [bar]", "temperature [degC]", "mass [kg]", "inlet", "outlet"):
            table.add_column(Text(heading), justify="left" if heading == "" else "right")  # a str's [bar] is markup
        for tank in _TANKS:
            figures = [values[f"{what}_{tank}"] for what in ("pressure", "temperature", "mass")]
            shown = ["-" if figure is None else f"{figure:.1f}" for figure in figures[:2]]
            shown.append("-" if figures[2] is None else f"{figures[2] / 1000:.2f}")
            valves = [_valve(values.get(f"{side}_{tank}")) for side in ("inlet", "outlet")]
            table.add_row(tank, *shown, *valves)
        return table

    def _line(self, values: dict[str, Any]) -> Text:
        vehicle = "none" if values["vehicle"] < 0 else f"number {values['vehicle']:.0f}"
        flows = f"compressor {values['flow_compressor']:.1f} g/s, dispenser {values['flow_dispenser']:.1f} g/s"
        return Text(f"\nvehicle {vehicle}, {values['queue_length']:.0f} waiting; {flows}\n")

    def _log(self) -> Table:
        table = Table(box=None, padding=(0, 2), show_header=False)
        for _, event in sorted(self._events.items()):
            details = ", ".join(
                f"{name} {_plain(value)}" for name, value in event["details"].items() if value not in ([], None)
            )
            when = f"{event['time']:,.0f} s".replace(",", " ")
            table.add_row(when, Text(event["kind"].replace("_", " ")), Text(details))
        return table


def _valve(state: float | None) -> Text:
    return Text("") if state is None else Text("open", "green") if state else Text("closed", "dim")


def _plain(value: Any) -> str:
    if isinstance(value, list):
        return " ".join(map(str, value))
    return f"{value:.1f}" if isinstance(value, float) else str(value)
