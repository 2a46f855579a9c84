"""`hrs bench`: machine and rows, each printed as soon as it is measured."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from api.files import check_writable, write_whole
from benchmarks.bench import rows
from benchmarks.load import rows as loads
from benchmarks.machine import Neighbours, machine
from benchmarks.measure import cells
from benchmarks.predictive import rows as plans
from benchmarks.service import rows as promises
from benchmarks.theory import rows as proofs
from station import InputError

_WHAT = 88
"""Width of the first column."""

_QUIET = 0.1
"""Cores that other processes may keep busy before the result says so."""

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)


@app.command()
def main(
    *,
    quick: Annotated[bool, typer.Option("--quick", help="leave out the rows that take more than some seconds")] = False,
    repeats: Annotated[
        int, typer.Option(min=1, max=1000, help="how often each row is measured; slow rows a third")
    ] = 9,
    service: Annotated[bool, typer.Option("--service", help="measure the service instead")] = False,
    load: Annotated[bool, typer.Option("--load", help="measure the service under load instead")] = False,
    theory: Annotated[bool, typer.Option("--theory", help="measure certificates instead")] = False,
    predictive: Annotated[bool, typer.Option("--predictive", help="measure predictive controllers instead")] = False,
    long: Annotated[bool, typer.Option("--long", help="the service for as long as its bars say: 20 minutes")] = False,
    database: Annotated[
        str | None, typer.Option(metavar="URL", help="an empty PostgreSQL database to fill with the service")
    ] = None,
    json_file: Annotated[Path | None, typer.Option("--json", metavar="FILE", help="write machine and rows")] = None,
) -> None:
    """Measure what decisions, days and comparisons cost here; status 1 where a bar is missed."""
    if json_file:
        try:
            check_writable(json_file)
        except InputError as error:
            typer.echo(f"error: {error}", err=True)
            raise typer.Exit(2) from None
    about = machine()
    typer.echo("\n".join(f"{name:<7} {value}" for name, value in about.items()))
    typer.echo(f"\n{'what':<{_WHAT}} {'median (range)':<34} {'bar':<14} ok")
    measured = []
    neighbours = Neighbours()
    # No live display: its thread would count as time of the process that is being measured.
    if theory:
        wanted = proofs(repeats)
    elif predictive:
        wanted = plans(repeats)
    elif load:
        wanted = loads(long=long, database=database)
    else:
        wanted = promises(long=long, database=database) if service else rows(repeats, quick=quick)
    for row in wanted:
        what, value, bar, ok = cells(row)
        typer.echo(f"{what:<{_WHAT}} {value:<34} {bar:<14} {ok}".rstrip())
        measured.append(row)
    others = neighbours.share()
    if others > _QUIET and not service and not load:
        typer.echo(
            f"\nOther processes kept {others:.2f} cores busy meanwhile: wall clocks and ratios are not to be trusted."
        )
    if json_file:
        document = {"machine": about, "other_processes_cores": others, "rows": [row.as_dict() for row in measured]}
        write_whole(json_file, json.dumps(document, indent=1, allow_nan=False) + "\n")
    if any(row.ok is False for row in measured):
        raise typer.Exit(1)


if __name__ == "__main__":
    app(prog_name="hrs bench")
