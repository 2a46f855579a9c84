"""Commands about scenarios: show those that ship and files, and store, read and forget those of a running service."""

from __future__ import annotations

import difflib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from api.cli.options import StationOption, UrlOption, scenario_of

SHOW = "show"
"""The command that is meant where none is named."""

FILES = (".toml", ".json", ".csv")
"""Endings of scenario files; whatever has none of them is a name."""


class _ShowByDefault(TyperGroup):
    """`hrs scenarios S1` is `hrs scenarios show S1`."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Put `show` in front where no command is named; two words in a row are a command, mistyped or not."""
        named = args and (args[0] in self.commands or args[0] == "--help")
        two_words = len(args) > 1 and not any(word.startswith("-") for word in args[:2])
        if not named and not two_words:
            args = [SHOW, *args]
        return super().parse_args(ctx, args)


app = typer.Typer(
    cls=_ShowByDefault, rich_markup_mode=None,
    help="Scenarios: `hrs scenarios` lists those that ship, `hrs scenarios NAME|FILE [--json]` shows one; the other "
    "commands are about those stored in a running service.",
)  # fmt: skip

NameArgument = Annotated[str, typer.Argument(metavar="NAME", help="what the service calls it")]


@app.command(SHOW)
def show(
    name: Annotated[str | None, typer.Argument(metavar="[NAME|FILE]", help="a name or file to show")] = None,
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
    _check_meant(name, known())
    chosen = scenario_of(name, station)
    if as_json:
        typer.echo(chosen.model_dump_json(indent=1))
        return
    typer.echo(f"{chosen.name}: {chosen.about}")
    typer.echo(f"station {chosen.station.name}: {chosen.station.about}")
    count = len(chosen.vehicles().arrival)
    typer.echo(f"{count} vehicles, {chosen.arrivals.kind}, ends at {chosen.time_limit_s:g} s at the latest")


def _check_meant(name: str, known: list[str]) -> None:
    """Raise InputError for what is no name and no file; a mistyped command is named."""
    from station import InputError

    if name in known or Path(name).suffix in FILES:
        return
    commands = [command.name or "" for command in app.registered_commands]
    near = [f"`hrs scenarios {match}`" for match in difflib.get_close_matches(name, commands)]
    near += difflib.get_close_matches(name, known)
    hint = f"; did you mean {' or '.join(near)}?" if near else "; `hrs scenarios get NAME` asks a service"
    raise InputError(
        "scenario", [("", f"{name!r} is neither a scenario ({', '.join(known)}) nor a {', '.join(FILES)} file{hint}")]
    )


@app.command("list")
def list_stored(
    *, as_json: Annotated[bool, typer.Option("--json", help="what the service answers")] = False, url: UrlOption = None
) -> None:
    """List the scenarios of a running service: those that ship, and those stored in it."""
    found = _asked(url, lambda client: client.get("/v1/scenarios"))
    if as_json:
        typer.echo(json.dumps(found, indent=1))
        return
    for each in found:
        when = f"changed {each['changed'][:19]}Z" if each["changed"] else ""
        about = f"{each['origin']:<8} {each['vehicles']:>6} vehicles  {each['station']:<16} {when:<29}"
        typer.echo(f"{each['name']:<24} {about} {each['about']}".rstrip())


@app.command("get")
def get(
    name: NameArgument,
    out: Annotated[Path | None, typer.Option(metavar="FILE.json", help="write it to a file")] = None,
    url: UrlOption = None,
) -> None:
    """Read a scenario of a running service: a valid scenario file, every parameter filled in."""
    from api.files import check_ending, write_whole

    if out:
        check_ending(out, (".json",))
    text = json.dumps(_asked(url, lambda client: client.get(_place(name))), indent=1) + "\n"
    if out:
        write_whole(out, text)
    else:
        typer.echo(text, nl=False)


@app.command("put")
def put(
    name: NameArgument,
    file: Annotated[str, typer.Argument(metavar="FILE", help="a .toml, .json or .csv file, or a name that ships")],
    *,
    new: Annotated[bool, typer.Option("--new", help="only if there is none of that name")] = False,
    url: UrlOption = None,
) -> None:
    """Store a scenario in a running service under a name, or replace the one that has it."""
    scenario = scenario_of(file, None).model_copy(update={"name": name})
    document = scenario.model_dump(mode="json", exclude_none=True)
    headers = {"If-None-Match": "*"} if new else {}
    _asked(url, lambda client: client.put(_place(name), document, headers))
    typer.echo(f"{name} is stored: `hrs submit {name}`")


@app.command("delete")
def delete(name: NameArgument, url: UrlOption = None) -> None:
    """Forget a scenario of a running service; what was submitted with it keeps it."""
    _asked(url, lambda client: client.delete(_place(name)))
    typer.echo(f"{name} is forgotten")


def _place(name: str) -> str:
    from urllib.parse import quote

    return f"/v1/scenarios/{quote(name, safe='')}"


def _asked(url: str | None, ask: Callable[[Any], Any]) -> Any:
    from api.client import Client
    from api.settings import load_settings

    with Client(load_settings(url=url)) as client:
        return ask(client)


def register(main: typer.Typer) -> None:
    """Add the commands."""
    main.add_typer(app, name="scenarios")
