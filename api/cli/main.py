"""The command line `hrs`: a face like the others, it calls the same services."""

from __future__ import annotations

import difflib
import logging
import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from api.cli import (
    alarms,
    backup,
    bench,
    bound,
    calibrate,
    certify,
    example,
    export,
    figures,
    fill,
    follow,
    forecast,
    foreign,
    identify,
    keys,
    measure,
    mqtt,
    opcua,
    scenario,
    send,
    service,
    shadow,
    validate,
)
from api.cli.options import StationOption, scenario_of

if TYPE_CHECKING:
    from station import Record


class _NearestOption(TyperGroup):
    """Of an option that a command has not, the nearest one that it has is named, and no other."""

    def invoke(self, ctx: Any) -> Any:
        """Run a command."""
        try:
            return super().invoke(ctx)
        except Exception as error:
            known = getattr(error, "possibilities", None)  # of an unknown option alone
            if known:
                error.possibilities = difflib.get_close_matches(error.option_name, known, 1, 0.0)  # type: ignore[attr-defined]
            raise


app = typer.Typer(
    name="hrs",
    cls=_NearestOption,
    help="A digital twin of hydrogen refueling stations: simulate, control, compare, certify.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

_NICENESS = 10
"""Of compiling: whatever else runs here goes first."""

ScenarioArgument = Annotated[
    str, typer.Argument(metavar="SCENARIO", help="a name (see `hrs scenarios`), or a .toml, .json or .csv file")
]
SeedOption = Annotated[int, typer.Option("--seed", min=0, help="seed of replications >= 1")]


@app.command()
def compare(
    scenarios: Annotated[
        list[str] | None, typer.Argument(metavar="[SCENARIO]...", help="names or files; default S1 S2 S3 S4")
    ] = None,
    controllers: Annotated[
        str, typer.Option(help="comma-separated, options behind colons: logic,minlp1:horizon=3")
    ] = "logic,minlp1,minlp2,minlp3",
    replications: Annotated[int, typer.Option(min=1, help="replication 0 is the pattern, later ones are drawn")] = 1,
    seed: SeedOption = 0,
    station: StationOption = None,
    workers: Annotated[int | None, typer.Option(min=1, max=256, help="threads; default one a core")] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="write every run's figures, one row a run (.csv, .parquet or .json)"),
    ] = None,
    json_file: Annotated[
        Path | None,
        typer.Option("--json", metavar="FILE", help="write every run's figures as JSON, whatever its ending"),
    ] = None,
    html_file: Annotated[
        Path | None, typer.Option("--html", metavar="FILE", help="write a self-contained report")
    ] = None,
) -> None:
    """Compare controllers on scenarios: tables of waiting, compressor and dispenser time."""
    from api.cli.console import print_tables, progress_bar
    from api.comparisons import service, tables
    from api.comparisons.export import ENDINGS, file_of
    from api.files import check_ending, check_writable, write_whole

    if out:
        check_ending(out, ENDINGS)
    for path in (json_file, html_file):
        if path:
            check_writable(path)
    chosen = [scenario_of(name, station) for name in scenarios or ["S1", "S2", "S3", "S4"]]
    names = [name.strip() for name in controllers.split(",")]
    for note in service.notes(chosen, replications):
        typer.echo(note, err=True)
    with progress_bar("runs") as progress:
        results = service.compare(
            chosen, names, replications=replications, seed=seed, workers=workers, progress=progress
        )
    found = tables.tables(chosen, results)
    print_tables(found, tables.verdict(chosen, results))
    document = service.as_document(results)
    if out:
        write_whole(out, file_of(document, out.suffix))
    if json_file:
        write_whole(json_file, file_of(document, ".json"))
    if html_file:
        from api.comparisons import report

        write_whole(html_file, report.html(chosen, results, found))


@app.command()
def simulate(
    scenario: ScenarioArgument,
    controller: Annotated[str, typer.Option(help="see `hrs controllers`")] = "logic",
    option: Annotated[
        list[str] | None, typer.Option(metavar="NAME=VALUE", help="an option of the controller, e.g. horizon=3")
    ] = None,
    station: StationOption = None,
    replication: Annotated[int, typer.Option(min=0, help="0 is the pattern, others are drawn")] = 0,
    seed: SeedOption = 0,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="write every column of the record (.parquet or .csv)")
    ] = None,
    plot: Annotated[Path | None, typer.Option(metavar="FILE.png", help="draw the run (.png, .svg or .pdf)")] = None,
    *,
    strict: Annotated[
        bool, typer.Option("--strict", help="exit with status 3 where a vehicle is not finished or leaves incomplete")
    ] = False,
) -> None:
    """Run one controller on one scenario and print its figures of merit."""
    from api.cli.console import print_metrics, print_unserved, working
    from api.files import check_ending, check_writable, write_whole
    from api.runs.plot import check_format, plot_run
    from controllers import create_from
    from station import simulate as run

    for path in (out, plot):
        if path:
            check_writable(path)
    if out:
        check_ending(out, (".parquet", ".csv"))
    if plot:
        check_format(plot)
    chosen = scenario_of(scenario, station)
    actor = create_from(":".join([controller, *(option or [])]))
    with working(f"simulating {chosen.name} with {controller}"):
        record = run(chosen, actor, replication=replication, seed=seed)
    print_metrics(record)
    if out:
        write_whole(out, record.parquet() if out.suffix == ".parquet" else _csv(record))
    if plot:
        plot_run(record, plot)
    if print_unserved(record) and strict:
        raise typer.Exit(3)


@app.command()
def controllers() -> None:
    """List the controllers that are installed."""
    from api.controllers.service import about
    from controllers import controllers as known

    for name in known():
        typer.echo(f"{name:<10} {about(name)}")


@app.command("compile")
def compile_controllers(
    first: Annotated[
        list[str] | None, typer.Argument(metavar="[CONTROLLER]...", help="these before the others")
    ] = None,
) -> None:
    """Compile controllers and filters now, some minutes once for a version; kernels unused for 30 days are removed."""
    from api.cli.console import status_line
    from api.jobs.kernels import remove_unused
    from controllers.registry import compile_all
    from station.estimation.compiling import compile_followers

    with suppress(AttributeError):  # an operating system without niceness
        os.nice(_NICENESS)
    with status_line("compiling"):
        for name in compile_all(first or ()):
            typer.echo(f"{name} is compiled")
        for plant in compile_followers():
            typer.echo(f"stations with the plant {plant} can be followed")
    for folder in remove_unused():
        typer.echo(f"removed {folder}, kernels of an earlier version")


bench.register(app)
scenario.register(app)
service.register(app)
keys.register(app)
backup.register(app)
certify.register(app)
example.register(app)
bound.register(app)
fill.register(app)
validate.register(app)
identify.register(app)
follow.register(app)
forecast.register(app)
shadow.register(app)
alarms.register(app)
figures.register(app)
calibrate.register(app)
measure.register(app)
send.register(app)
mqtt.register(app)
opcua.register(app)
export.register(app)
foreign.register(app)


def _csv(record: Record) -> bytes:
    """Every column of a record, one row a second."""
    from api.http.timeseries import Format, encoded  # the web framework, for half a second

    return encoded({name: record[name] for name in record.columns}, record.columns, Format.CSV)


def main() -> None:
    """Run the command line; errors of input end it with status 2 and one message."""
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("%(message)s"))
    logging.basicConfig(level=logging.INFO, handlers=[handler])
    for chatty in ("alembic", "httpx"):
        logging.getLogger(chatty).setLevel(logging.WARNING)
    try:
        app()
    except KeyboardInterrupt:
        sys.exit(130)
    except UnicodeEncodeError as error:
        typer.echo(f"error: {error.object!a:.100} is not UTF-8 text", err=True)
        sys.exit(2)
    except Exception as error:
        from station import StationError
        from theory import TheoryError

        if not isinstance(error, StationError | TheoryError):
            raise
        typer.echo(f"error: {error}", err=True)
        sys.exit(2)
