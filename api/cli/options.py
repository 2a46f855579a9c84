"""Options that several commands take: which database, service or station they use."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from station import Scenario

DataOption = Annotated[Path | None, typer.Option("--data", metavar="FOLDER", help="where the embedded database is")]

DatabaseOption = Annotated[
    str | None, typer.Option("--database", metavar="URL", help="postgresql://user:password@host/name instead")
]

UrlOption = Annotated[
    str | None, typer.Option("--url", metavar="URL", help="the service; default HRS_URL or http://127.0.0.1:8000")
]

AnswerFileOption = Annotated[Path | None, typer.Option("--json", metavar="FILE", help="write the whole answer as JSON")]

UserOption = Annotated[
    str | None,
    typer.Option("--user", metavar="NAME", help="user, where the router asks for one; default HRS_ZENOH_USER"),
]

CaOption = Annotated[
    Path | None,
    typer.Option("--ca", metavar="FILE", help="PEM authority of the router's certificate; default HRS_ZENOH_CA"),
]

StationOption = Annotated[
    str | None,
    typer.Option(
        "--station", metavar="PRESET|FILE", help="at this station instead: a preset, or a .toml or .json file of one"
    ),
]


def check_source(command: str, source: str) -> None:
    """Raise InputError unless `--source` of a command can name who sends measurements."""
    import re

    from api.twins.measurement_schemas import SOURCE_PATTERN
    from station import InputError

    if not re.fullmatch(SOURCE_PATTERN, source):
        message = f"must be 1 to 64 letters, digits, '.', '_', ':' or '-'; given {source!r:.100}"
        raise InputError(command, [("--source", message)])


def scenario_of(name: str, station: str | None) -> Scenario:
    """A scenario that ships or is in a file, at another station where one is named."""
    from station import load_scenario
    from station.station_files import load_station_file

    return load_scenario(name, load_station_file(station) if station else None)
