"""The command `alarms`: what is wrong at a live twin, and who has seen it."""

from __future__ import annotations

from typing import Annotated, Any
from urllib.parse import quote

import typer

from api.cli.options import AnswerFileOption, UrlOption

_HOUR = 3600.0


def alarms(
    twin: Annotated[str, typer.Argument(metavar="TWIN", help="a live twin")],
    acknowledge: Annotated[
        str | None, typer.Option(metavar="ALARM", help="say that it has been seen; `all`: every one that is shown")
    ] = None,
    shelve: Annotated[str | None, typer.Option(metavar="ALARM", help="put it aside for a time; needs --reason")] = None,
    hours: Annotated[float, typer.Option(min=0.01, max=168, help="for how long it is put aside [h]")] = 1.0,
    out_of_service: Annotated[
        str | None, typer.Option(metavar="ALARM", help="put it aside until it is put back; needs --reason")
    ] = None,
    back: Annotated[
        str | None, typer.Option(metavar="ALARM", help="take it back from the shelf, or into service")
    ] = None,
    reason: Annotated[str | None, typer.Option(help="why it is put aside")] = None,
    every: Annotated[  # noqa: FBT002  # typer gives it by name
        bool, typer.Option("--all", help="show alarms whose condition does not hold, too")
    ] = False,
    json_file: AnswerFileOption = None,
    url: UrlOption = None,
) -> None:
    """Show the alarms of a live twin, the most urgent first; acknowledge them or put them aside.

    A key is read from HRS_API_KEY.
    """
    from api.client import Client
    from api.files import check_writable, write_json
    from api.settings import load_settings
    from station import InputError

    if json_file:
        check_writable(json_file)
    if (shelve or out_of_service) and not reason:
        raise InputError("alarms", [("--reason", "must be given where an alarm is put aside")])
    path = f"/v1/twins/{quote(twin, safe='')}/alarms"
    with Client(load_settings(url=url)) as client:

        def act(name: str, action: dict[str, Any]) -> None:
            client.post(f"{path}/{quote(name, safe='')}", action)

        found = client.get(path, all="true")
        states = {each["name"]: each["state"] for each in found["items"]}
        if acknowledge is not None:
            for name in _waiting(found) if acknowledge == "all" else [acknowledge]:
                act(name, {"action": "acknowledge"})
        if shelve is not None:
            act(shelve, {"action": "shelve", "for_s": hours * _HOUR, "reason": reason})
        if out_of_service is not None:
            act(out_of_service, {"action": "out_of_service", "reason": reason})
        if back is not None:
            act(back, {"action": "in_service" if states.get(back) == "out_of_service" else "unshelve"})
        found = client.get(path, all="true" if every else "false")
    if json_file:
        write_json(json_file, found)
    _print(found)


def _waiting(found: dict[str, Any]) -> list[str]:
    """Names of the alarms that nobody has acknowledged."""
    return [each["name"] for each in found["items"] if each["state"].endswith("unacknowledged")]


def _print(found: dict[str, Any]) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    console, figures = Console(), found["figures"]
    table = Table(box=SIMPLE_HEAD, padding=(0, 1))
    for heading in ("priority", "alarm", "state", "since [s]", "value", "limit", "by"):
        table.add_column(escape(heading), no_wrap=heading != "by", justify="right" if heading[:3] == "sin" else "left")
    for each in found["items"]:
        unit = "" if each["unit"] == "1" else f" {each['unit']}"
        value = "-" if each["value"] is None else f"{each['value']:.4g}{unit}"
        since = "-" if each["raised_s"] is None else f"{each['raised_s']:.0f}"
        who = ", ".join(filter(None, (each["by"], each["reason"])))
        limit = f"{each['side']} {each['limit']:g}{unit}"
        table.add_row(each["priority"], each["name"], each["state"], since, value, limit, escape(who))
    if found["items"]:
        console.width = max(console.width, console.measure(table, options=console.options.update(width=1000)).maximum)
        console.print(table)
        for each in found["items"]:
            if each["active"]:
                console.print(escape(f"{each['name']}: {each['title']}. {each['action']}"), highlight=False)
    else:
        console.print("nothing to act on" if figures else "a twin that has ended, and a replay, have no alarms")
    if figures is None:
        return
    hours = figures["duration_s"] / _HOUR
    said = f"{figures['begun']} announced in {hours:.1f} h; {figures['unacknowledged']} not acknowledged"
    console.print(said, highlight=False)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(alarms)
