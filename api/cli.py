"""The command line `hrs`: a face like the others, it calls the same services."""

from __future__ import annotations

import json
import logging
import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

import typer

from api import backup_commands, bound_commands, certificate_commands, example_commands, service_commands

app = typer.Typer(
    name="hrs",
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
StationOption = Annotated[
    str | None, typer.Option("--station", metavar="PRESET", help="run at this station instead of the scenario's")
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
    json_file: Annotated[Path | None, typer.Option("--json", metavar="FILE", help="write every result as JSON")] = None,
    html_file: Annotated[
        Path | None, typer.Option("--html", metavar="FILE", help="write a self-contained report")
    ] = None,
) -> None:
    """Compare controllers on scenarios: tables of waiting, compressor and dispenser time."""
    from api.comparisons import service, tables
    from api.console import print_tables, progress_bar
    from api.files import check_writable, write_whole

    for path in (json_file, html_file):
        if path:
            check_writable(path)
    chosen = [_scenario(name, station) for name in scenarios or ["S1", "S2", "S3", "S4"]]
    names = [name.strip() for name in controllers.split(",")]
    with progress_bar("runs") as progress:
        results = service.compare(
            chosen, names, replications=replications, seed=seed, workers=workers, progress=progress
        )
    found = tables.tables(chosen, results)
    print_tables(found, tables.verdict(chosen, results))
    if json_file:
        write_whole(json_file, json.dumps(service.as_document(results), indent=1, allow_nan=False) + "\n")
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
    out: Annotated[Path | None, typer.Option(metavar="FILE.parquet", help="write every column of the record")] = None,
    plot: Annotated[Path | None, typer.Option(metavar="FILE.png", help="draw the run (.png, .svg or .pdf)")] = None,
) -> None:
    """Run one controller on one scenario and print its figures of merit."""
    from api.console import print_metrics, working
    from api.files import check_writable
    from api.runs.plot import check_format, plot_run
    from controllers import create_from
    from station import simulate as run

    for path in (out, plot):
        if path:
            check_writable(path)
    if plot:
        check_format(plot)
    chosen = _scenario(scenario, station)
    actor = create_from(":".join([controller, *(option or [])]))
    with working(f"simulating {chosen.name} with {controller}"):
        record = run(chosen, actor, replication=replication, seed=seed)
    print_metrics(record)
    if out:
        record.to_parquet(out)
    if plot:
        plot_run(record, plot)


@app.command()
def scenarios(
    name: Annotated[str | None, typer.Argument(help="a name or file to show")] = None,
    *,
    as_json: Annotated[
        bool, typer.Option("--json", help="with every parameter resolved; a valid scenario file")
    ] = False,
    station: StationOption = None,
) -> None:
    """List the scenarios that ship with hrs, or show one."""
    from station import load_scenario, presets
    from station import scenarios as known

    if name is None:
        found = [load_scenario(item) for item in known()]
        if as_json:
            typer.echo(json.dumps([scenario.model_dump() for scenario in found], indent=1))
            return
        for scenario in found:
            typer.echo(f"{scenario.name:<12} {scenario.about}")
        typer.echo(f"\nstations: {', '.join(presets())}")
        return
    chosen = _scenario(name, station)
    if as_json:
        typer.echo(chosen.model_dump_json(indent=1))
        return
    typer.echo(f"{chosen.name}: {chosen.about}")
    typer.echo(f"station {chosen.station.name}: {chosen.station.about}")
    count = len(chosen.vehicles().arrival)
    typer.echo(f"{count} vehicles, {chosen.arrivals.kind}, ends at {chosen.time_limit_s:g} s at the latest")


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
    """Compile the controllers now, some minutes once for a version; kernels unused for 30 days are removed."""
    from api.console import telling
    from api.jobs.kernels import remove_unused
    from controllers.registry import compile_all

    with suppress(AttributeError):  # an operating system without niceness
        os.nice(_NICENESS)
    with telling("compiling"):
        for name in compile_all(first or ()):
            typer.echo(f"{name} is compiled")
    for folder in remove_unused():
        typer.echo(f"removed {folder}, kernels of an earlier version")


@app.command(
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True, "help_option_names": []},
    add_help_option=False,
)
def bench(arguments: typer.Context) -> None:
    """Measure what decisions, days and comparisons cost here (`hrs bench --help`)."""
    # A process of its own: nothing of the command line counts, and the benchmarks stand above this room.
    raise typer.Exit(subprocess.run([sys.executable, "-m", "benchmarks", *arguments.args], check=False).returncode)


service_commands.register(app)
backup_commands.register(app)
certificate_commands.register(app)
example_commands.register(app)
bound_commands.register(app)


def _scenario(name: str, station: str | None) -> Any:
    from station import load_scenario, load_station

    scenario = load_scenario(name)
    return scenario.on(load_station(station)) if station else scenario


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
    except Exception as error:
        from station import StationError
        from theory import TheoryError

        if not isinstance(error, StationError | TheoryError):
            raise
        typer.echo(f"error: {error}", err=True)
        sys.exit(2)
