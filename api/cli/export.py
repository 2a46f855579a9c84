"""The command `export fmu`: a station's plant for simulators of others."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

commands = typer.Typer(help="A station for programs of others.", no_args_is_help=True)


@commands.callback()
def _group() -> None:
    """Keep the name of the one command there is."""


@commands.command()
def fmu(
    station: Annotated[str, typer.Argument(metavar="STATION", help="a preset, or a .toml or .json file of one")],
    version: Annotated[int, typer.Option("--version", min=2, max=3, help="of FMI: 2 or 3")] = 3,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE.fmu", help="default STATION-fmiVERSION.fmu")
    ] = None,
) -> None:
    """Write the plant as an FMU for co-simulation; needs a C compiler, and gives Linux on x86-64."""
    from api.bridges.fmi.export import fmu as made
    from api.files import check_ending, write_whole
    from station.station_files import load_station_file

    chosen = load_station_file(station)
    path = out or Path(f"{chosen.name}-fmi{version}.fmu")
    check_ending(path, (".fmu",))
    write_whole(path, made(chosen, version))
    typer.echo(str(path))


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.add_typer(commands, name="export")
