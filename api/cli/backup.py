"""`hrs backup` and `hrs restore`: the whole database in one file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from api.cli.options import DatabaseOption, DataOption

FileArgument = Annotated[Path, typer.Argument(metavar="FILE", help="the backup")]


def backup(file: FileArgument, data: DataOption = None, database: DatabaseOption = None) -> None:
    """Write all that the service's database holds into one file, while the service runs."""
    from api.cli.console import progress_bar
    from api.settings import load_settings
    from api.store import backup as store
    from api.store.database import open_database

    url = load_settings(data=data, database=database).database_url
    with open_database(url) as source, progress_bar("rows") as progress:
        rows = store.backup(source, file, progress)
    typer.echo(f"{sum(rows.values())} rows of {len(rows)} tables written to {file}", err=True)


def restore(
    file: FileArgument,
    data: DataOption = None,
    database: DatabaseOption = None,
    *,
    replace: Annotated[bool, typer.Option("--replace", help="forget what the database holds")] = False,
) -> None:
    """Fill an empty database from a backup of either kind of database; the service should not run."""
    from api.cli.console import progress_bar
    from api.settings import load_settings
    from api.store import backup as store
    from api.store.database import open_database

    url = load_settings(data=data, database=database).database_url
    with open_database(url) as target, progress_bar("rows") as progress:
        rows = store.restore(target, file, progress, replace=replace)
    typer.echo(f"{sum(rows.values())} rows of {len(rows)} tables restored from {file}", err=True)


def register(app: typer.Typer) -> None:
    """Add these commands to the command line."""
    for command in (backup, restore):
        app.command()(command)
