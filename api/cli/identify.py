"""The command `identify`: the control model of a station, fitted to its days or a record, and how well it predicts."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from collections.abc import Sequence

    from api.identification import Identified
    from station import Station


def identify(
    station: Annotated[str, typer.Argument(metavar="STATION", help="a preset, or a .toml or .json file of a station")],
    days: Annotated[
        int | None, typer.Option(min=1, max=14, help="days that the model is fitted to; two more judge it; default 2")
    ] = None,
    seed: Annotated[int | None, typer.Option("--seed", min=0, help="of the days that are drawn; default 0")] = None,
    record: Annotated[
        Path | None,
        typer.Option(
            "--record",
            metavar="RECORD",
            help="fit it to measured seconds, .csv or .parquet; their last quarter judges it",
        ),
    ] = None,
    tags: Annotated[
        Path | None, typer.Option("--tags", metavar="FILE.toml", help="which column of the record is which sensor")
    ] = None,
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="write figures and errors as JSON")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE.toml", help="write the station with this section control_model, for --station"),
    ] = None,
) -> None:
    """Fit the model that controllers plan with to days of a station, and print how far its predictions lie off.

    Days are simulated, or one that was measured is given with --record and --tags: exit status 3 where the station's
    own model does not fit that record (see `hrs calibrate`).
    """
    from api.cli.console import working
    from api.files import check_ending, check_writable, write_json, write_whole
    from api.identification import CONTROLLERS, HELD_OUT, document, identify_station, section
    from station import InputError
    from station.station_files import load_station_file

    if json_file:
        check_writable(json_file)
    if out:
        check_ending(out, (".toml",))
    chosen = load_station_file(station)
    if out and chosen.real_gas is None:
        raise InputError("identify", [("--out", f"station {chosen.name} keeps the thesis's form in its own sections")])
    if record is None and tags is None:
        days, seed = DAYS if days is None else days, seed or 0
        with working(f"identifying {chosen.name}"):
            found = identify_station(chosen, days, seed)
        told = {"days": days, "held_out_days": HELD_OUT, "seed": seed, "controllers": list(CONTROLLERS)}
    else:
        _check_given(record, tags, days, seed)
        found = _of_record(Path(str(record)), Path(str(tags)), station)
        told = {"record": Path(str(record)).name}
    _print(chosen.name, found)
    if json_file:
        write_json(json_file, document(station, told, found))
    if out:
        write_whole(out, _with_model(station, chosen, section(found[-1])))


DAYS = 2
"""Days of each controller that the model is fitted to, where nobody says."""


def _check_given(record: Path | None, tags: Path | None, days: int | None, seed: int | None) -> None:
    from station import InputError

    problems = [
        (name, "must be given: a record and its tags")
        for name, value in (("--record", record), ("--tags", tags))
        if value is None
    ]
    problems += [
        (name, "must be left out with --record")
        for name, value in (("--days", days), ("--seed", seed))
        if value is not None
    ]
    if problems:
        raise InputError("identify", problems)


def _of_record(record: Path, tags: Path, station: str) -> list[Identified]:
    """The models fitted to a measured record; exit status 3 where the station's own plant does not fit it."""
    from api.cli.console import working
    from api.cli.follow import REFUSED, read_record
    from api.identification import identify_followed
    from station.estimation.detection import detect
    from station.estimation.filter import follow
    from station.estimation.verdict import coarse_sensors, judged

    frames, known, _ = read_record(record, tags, station)
    with working(f"identifying {known.name}"):
        followed = follow(frames, known)
        events = detect(frames, followed, known)
        why = judged(followed, frames.start, events, coarse_sensors(frames.values, frames.usual_noise))[1]
        if not why:
            return identify_followed(known, frames, followed)
    for line in why:
        typer.echo(f"model refused: {line}", err=True)
    raise typer.Exit(REFUSED)


def _with_model(given: str, chosen: Station, section: str) -> str:
    """The station's file with a section `control_model`: over the preset, or whole where it was a file."""
    from api.cli.toml_text import toml_text
    from station import Station
    from station.preset_files import presets

    if given in presets():
        return f'preset = "{given}"\n\n{section}'
    whole = chosen.model_dump(mode="json", exclude_none=True) | tomllib.loads(section)
    return toml_text(Station.model_validate(whole).model_dump(mode="json", exclude_none=True))


def _print(name: str, found: Sequence[Identified]) -> None:
    """A table: RMS of what each form predicts on days held out, and the figures of the last."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    from api.identification import figures
    from station.estimation.prediction import BUFFER_HORIZONS, VEHICLE_HORIZONS

    table = Table(box=SIMPLE_HEAD, padding=(0, 1), title=f"{name}: RMS error of predictions, bar", title_justify="left")
    table.add_column("model")
    for horizon in BUFFER_HORIZONS:
        table.add_column(f"buffers\n{horizon} s", justify="right")
    for horizon in VEHICLE_HORIZONS:
        table.add_column(f"vehicle\n{horizon} s", justify="right")
    for each in found:
        table.add_row(each.name, *(f"{error:.1f}" for error in (*each.errors.buffers, *each.errors.vehicle)))
    console = Console()
    console.width = max(console.width, 100)
    console.print(table)
    for field, value in figures(found[-1].model).items():
        shown = value if isinstance(value, list) else [value]
        typer.echo(f"{field:<32} {'  '.join(f'{figure:.5g}' for figure in shown)}")


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(identify)
