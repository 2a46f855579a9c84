"""Output of the command line: tables, figures of merit, progress of anything long."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table as RichTable

if TYPE_CHECKING:
    from api.comparisons.tables import Table
    from station import Record

_WIDEST = 1000
"""A table is printed as wide as it is, up to so many columns: a narrower terminal scrolls, and no figure is cut."""


@contextmanager
def progress_bar(what: str) -> Iterator[Callable[[int, int], None]]:
    """A bar on stderr while the block runs; gives `progress(done, total)`."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(what, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


@contextmanager
def working(what: str) -> Iterator[None]:
    """A spinner on stderr while the block runs."""
    with Console(stderr=True).status(what):
        yield


@contextmanager
def status_line(what: str) -> Iterator[Callable[[str], None]]:
    """A spinner on stderr while the block runs; gives `progress(where it stands)`."""
    with Console(stderr=True).status(what) as status:
        yield lambda where: status.update(f"{what}: {where}")


def print_tables(tables: list[Table], verdict: str) -> None:
    """Print comparison tables, and a sentence on how close they come to the thesis."""
    console = Console()
    terminal = console.width
    for table in tables:
        shown = RichTable(title=table.title, title_justify="left", title_style="bold", box=SIMPLE_HEAD, padding=(0, 1))
        shown.add_column("controller", no_wrap=True)
        shown.add_column("", no_wrap=True)
        for heading in table.headings:
            shown.add_column(heading, justify="right", no_wrap=True)
        for row in table.rows:
            shown.add_row(row.controller, row.origin, *row.cells, style="dim" if row.origin == "thesis" else None)
        console.width = max(terminal, console.measure(shown, options=console.options.update(width=_WIDEST)).maximum)
        console.print(shown)
    if verdict:
        console.print(verdict, highlight=False)


def print_figures(figures: Mapping[str, float | None]) -> None:
    """Print figures of merit with their units."""
    from station.metrics import units_of

    units = units_of([figures])
    for name, value in figures.items():
        shown = "-" if value is None else f"{value:,.6g}" if value % 1 else f"{value:,.0f}"
        print(f"  {name:<22} {shown.replace(',', ' '):>12} {'' if units[name] == '1' else units[name]}".rstrip())


_NAMED = 5
"""Vehicles that are named one by one."""


def print_unserved(record: Record) -> int:
    """Say on stderr which vehicles were not served to the end; how many they are."""
    from station.metrics import incomplete, state_of_charge

    vehicles, left, charge = (
        record.vehicles,
        incomplete(record),
        state_of_charge(record.vehicles, record.scenario.station.plant),
    )
    unserved = [place for place, end in enumerate(vehicles["finished"].tolist()) if math.isnan(end)]
    if not unserved:
        return 0
    lines = [
        f"warning: {len(unserved)} of {len(left)} vehicles not finished, {int(left.sum())} of them left incomplete"
    ]
    for place in unserved[:_NAMED]:
        connected = vehicles["connected"][place]
        if math.isnan(connected):
            lines.append(f"  vehicle {place}, which arrived at {vehicles['arrival'][place]:.0f} s, was never connected")
            continue
        what = "left incomplete" if left[place] else "was still connected at the end"
        lines.append(
            f"  vehicle {place}, connected at {connected:.0f} s, {what}: {vehicles['final_pressure'][place]:.0f} of "
            f"{vehicles['finish_pressure'][place]:.0f} bar, state of charge {100 * charge[place]:.0f} %"
        )
    if len(unserved) > _NAMED:
        lines.append(f"  and {len(unserved) - _NAMED} more")
    Console(stderr=True, soft_wrap=True).print("\n".join(lines), style="bold", highlight=False)
    return len(unserved)


def print_metrics(record: Record) -> None:
    """Print a run's figures of merit with their units."""
    about = f"{record.scenario.name} at {record.scenario.station.name}, controller {record.controller}"
    print(f"{about}, replication {record.replication}")
    print_figures(record.metrics())
    samples, seconds = len(record) - 1, record.timing.total
    print(f"  {samples} samples simulated in {seconds:.3f} s ({1e6 * seconds / max(1, samples):.2f} us each)")
