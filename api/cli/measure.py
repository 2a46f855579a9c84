"""The command `measure`: a run as its sensors would tell it, to follow it with `hrs follow`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from api.cli.options import StationOption, scenario_of

if TYPE_CHECKING:
    import pyarrow as pa

    from station.record import Record


def measure(
    source: Annotated[
        str,
        typer.Argument(metavar="RECORD|SCENARIO", help="a record (.parquet) of `hrs simulate`, or a scenario to run"),
    ],
    out: Annotated[Path, typer.Option(metavar="FILE", help="write the measured seconds (.csv or .parquet)")],
    tags_out: Annotated[
        Path | None, typer.Option(metavar="FILE.toml", help="write the tag map of its columns, for `hrs follow --tags`")
    ] = None,
    controller: Annotated[str, typer.Option(help="that runs the scenario; see `hrs controllers`")] = "logic",
    station: StationOption = None,
    noise_seed: Annotated[int, typer.Option(min=0, help="seed of noise and of missing samples")] = 0,
    missing: Annotated[float, typer.Option(min=0.0, max=1.0, help="part of the samples that get lost")] = 0.02,
) -> None:
    """Measure a run: 1 bar, 0.5 K and 2 % of flow of noise, and the faults of sensors and clocks of its scenario.

    The faults of the scenario stand in it; `hrs follow --truth` scores what is found against them.
    """
    from api.cli.toml_text import toml_text
    from api.files import check_ending, check_writable, write_whole
    from station.measured_day import measured_day, tags_of_day

    check_ending(out, (".csv", ".parquet"))
    check_writable(out)
    if tags_out:
        check_ending(tags_out, (".toml",))
        check_writable(tags_out)
    table = measured_day(_record(source, controller, station), noise_seed, missing)
    write_whole(out, _content(table, out.suffix))
    if tags_out:
        tags = [each.model_dump(exclude_defaults=True) for each in tags_of_day().tags]
        write_whole(tags_out, "\n".join(f"[[tags]]\n{toml_text(each)}" for each in tags))
    typer.echo(f"{out} is written: {table.num_rows} rows")


def _record(source: str, controller: str, station: str | None) -> Record:
    """The record of a file, or of a scenario that is run now."""
    from controllers import create_from
    from station import InputError, simulate
    from station.record import Record

    if not source.endswith(".parquet"):
        return simulate(scenario_of(source, station), create_from(controller))
    if station:
        raise InputError("--station", [("", "must be left out with a record: it has its station")])
    try:
        return Record.from_parquet(source)
    except (OSError, ValueError, KeyError) as error:
        raise InputError(source, [("", f"must be a record of a run: {error!s:.200}")]) from None


def _content(table: pa.Table, ending: str) -> bytes:
    import pyarrow as pa
    from pyarrow import csv, parquet

    stream = pa.BufferOutputStream()
    if ending == ".csv":
        csv.write_csv(table, stream, csv.WriteOptions(quoting_style="none"))
    else:
        parquet.write_table(table, stream)
    content: bytes = stream.getvalue().to_pybytes()
    return content


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(measure)
