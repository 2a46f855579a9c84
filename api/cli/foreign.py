"""The command `import fmu`: a unit of others in the plant's place."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from api.cli.options import StationOption, UrlOption, scenario_of

if TYPE_CHECKING:
    from api.bridges.fmi.foreign_run import Told
    from station import Scenario
    from station.measurement import TagMap

commands = typer.Typer(help="Models of others in the plant's place.", no_args_is_help=True)


@commands.callback()
def _group() -> None:
    """Keep the name of the one command there is."""


@commands.command()
def fmu(
    unit: Annotated[Path, typer.Argument(metavar="UNIT.fmu", help="for co-simulation, FMI 2.0 or 3.0; native code")],
    unit_map: Annotated[
        Path, typer.Option("--map", metavar="FILE.toml", help="which of its variables is which quantity")
    ],
    scenario: Annotated[str, typer.Option("--scenario", metavar="NAME|FILE", help="vehicles and limits")],
    controller: Annotated[str, typer.Option(help="see `hrs controllers`")] = "logic",
    station: StationOption = None,
    replication: Annotated[int, typer.Option(min=0, help="0 is the pattern, others are drawn")] = 0,
    seed: Annotated[int, typer.Option(min=0, help="seed of replications >= 1")] = 0,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE.parquet", help="write the record, for `hrs measure` and `hrs follow`")
    ] = None,
    twin: Annotated[
        str | None, typer.Option(metavar="ID", help="start a measured twin of this id, which follows the unit")
    ] = None,
    speed: Annotated[
        float | None,
        typer.Option(metavar="X", min=0.01, max=10_000, help="with --twin: seconds of the unit a second [1]"),
    ] = None,
    timeout: Annotated[
        float, typer.Option(metavar="SECONDS", min=0.1, max=3600, help="a unit that takes longer hangs")
    ] = 30.0,
    url: UrlOption = None,
) -> None:
    """Run a scenario with an FMU as the plant, and print its figures of merit; a measured twin may follow it."""
    from api.cli.console import print_metrics, print_unserved
    from api.files import check_ending, check_writable, write_whole
    from controllers import create_from

    if speed is not None and twin is None:
        raise typer.BadParameter("--speed needs --twin: alone a unit runs as fast as it can")
    if out:
        check_ending(out, (".parquet",))
        check_writable(out)
    _check_installed()
    from api.bridges.fmi.foreign_run import ForeignRun
    from api.bridges.fmi.foreign_unit import ForeignUnit, describe
    from api.bridges.fmi.streaming import tags_of
    from api.bridges.fmi.unit_map import load_map

    described = describe(unit, load_map(unit_map), str(unit_map))
    chosen = scenario_of(scenario, station)
    actor = create_from(controller)
    with ForeignUnit(described, timeout) as plant:
        run = ForeignRun(chosen, actor, plant, replication, seed)
        with _telling(twin, chosen, tags_of(described.wiring), speed or 1.0, url) as tell:
            record = run.run(tell)
    print_metrics(record)
    if out:
        write_whole(out, record.parquet())
    print_unserved(record)


def _check_installed() -> None:
    """Raise StationError unless FMPy is installed."""
    from importlib.util import find_spec

    from station import StationError

    if find_spec("fmpy") is None:
        raise StationError("FMPy is not installed: pip install hrs-twin[fmi]")


@contextmanager
def _telling(twin: str | None, scenario: Scenario, tags: TagMap, speed: float, url: str | None) -> Iterator[Told]:
    """Who is told of each second: a twin, or nobody."""
    if twin is None:
        yield lambda _row: None
        return
    from api.bridges.fmi.streaming import TwinStream
    from api.client import Service
    from api.settings import load_settings

    with Service(load_settings(url=url)) as service:
        stream = TwinStream(service, twin, scenario, tags, speed)
        try:
            yield stream.tell
        finally:
            stream.flush()
            typer.echo(f"twin {twin} has {stream.count} readings")


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.add_typer(commands, name="import")
