"""Commands `keys`: who may do what at a service that other machines reach."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from api.cli.options import DatabaseOption, DataOption
from api.moments import written
from api.scopes import USUAL, Scope

KeyName = Annotated[str, typer.Argument(help="whose key it is")]

keys_app = typer.Typer(help="Keys of a service that other machines reach.", no_args_is_help=True)


@keys_app.command()
def create(
    name: KeyName,
    scope: Annotated[
        list[Scope] | None, typer.Option(help="what it may do, once for each; default read, run and operate")
    ] = None,
    data: DataOption = None,
    database: DatabaseOption = None,
) -> None:
    """Make a key and print it; it is shown this once and stored as a digest."""
    from api.store.records import Conflict
    from station import InputError

    if not 1 <= len(name) <= 64 or not name.isprintable():
        raise InputError("key", [("NAME", f"must have 1 to 64 printable characters; given {name!r:.100}")])
    with _keys(data, database) as keys:
        try:
            typer.echo(keys.create(name, scope or USUAL))
        except Conflict as error:
            raise InputError("key", [("NAME", str(error))]) from None


@keys_app.command("list")
def list_keys(data: DataOption = None, database: DatabaseOption = None) -> None:
    """List the names of keys, what each may do, when they were made, and which are revoked."""
    with _keys(data, database) as keys:
        for key in keys.all():
            state = "valid" if key.revoked is None else f"revoked {written(key.revoked, 'minutes')}"
            typer.echo(f"{key.name:<24} {' '.join(key.scopes):<18} made {written(key.created, 'minutes')}  {state}")


@keys_app.command()
def revoke(name: KeyName, data: DataOption = None, database: DatabaseOption = None) -> None:
    """Refuse a key from now on."""
    from station import InputError

    with _keys(data, database) as keys:
        if not keys.revoke(name):
            raise InputError("key", [("NAME", f"no valid key is called {name!r}")])


@keys_app.command()
def zenoh(
    name: KeyName,
    data: Annotated[Path | None, typer.Option(metavar="FOLDER", help="of the service: its secret is there")] = None,
    database: DatabaseOption = None,
) -> None:
    """Print the user and the password that a key has at the service's zenoh router, one a line."""
    from api.settings import load_settings
    from api.telemetry.access import logins, read_secret
    from station import InputError

    with _keys(data, database) as keys:
        held = [key for key in keys.all() if key.name == name]
    for login in logins(held, read_secret(load_settings(data=data, database=database))):
        typer.echo(f"{login.user}\n{login.password}")
        return
    raise InputError("key", [("NAME", f"no valid key is called {name!r}")])


def _keys(data: Path | None, database: str | None) -> Any:
    from contextlib import contextmanager

    from api.settings import load_settings
    from api.store.database import Database
    from api.store.keys import KeyRepository

    @contextmanager
    def opened() -> Any:
        store = Database(load_settings(data=data, database=database).database_url)
        try:
            store.migrate()
            yield KeyRepository(store)
        finally:
            store.close()

    return opened()


def register(app: typer.Typer) -> None:
    """Add these commands to the command line."""
    app.add_typer(keys_app, name="keys")
