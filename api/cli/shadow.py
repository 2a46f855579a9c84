"""The command `shadow`: what other controllers would have made of a live twin's time."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from api.cli.options import AnswerFileOption, UrlOption

_MINUTE = 60


def shadow(
    twin: Annotated[str, typer.Argument(metavar="TWIN", help="a live twin")],
    controllers: Annotated[
        str | None,
        typer.Option(help="comma-separated, options behind colons: hold these against the one that acts from now on"),
    ] = None,
    every: Annotated[int, typer.Option(min=5, max=1440, help="a stretch begins so often [min]")] = 15,
    length: Annotated[int, typer.Option(min=5, max=360, help="length of a stretch [min]")] = 60,
    waiting_price: Annotated[
        float, typer.Option(min=0, max=10_000, help="of an hour that a vehicle waits [EUR/h]")
    ] = 20.0,
    energy_price: Annotated[
        float, typer.Option(min=0, max=10_000, help="where the station has no tariff [EUR/kWh]")
    ] = 0.3,
    stop: Annotated[  # noqa: FBT002  # typer gives it by name
        bool, typer.Option("--stop", help="hold nobody against it any more; what was found stays")
    ] = False,
    json_file: AnswerFileOption = None,
    url: UrlOption = None,
) -> None:
    """Show what other controllers would have made of a live twin's time, from the same states and vehicles.

    A key is read from HRS_API_KEY.
    """
    from api.client import Service
    from api.files import check_writable, write_json
    from api.settings import load_settings
    from station import InputError

    if json_file:
        check_writable(json_file)
    if controllers is not None and stop:
        raise InputError("shadow", [("--stop", "must be left out where --controllers are given")])
    with Service(load_settings(url=url)) as service:
        live = service.twin(twin)
        if controllers is not None:
            prices = {"waiting_eur_per_h": waiting_price, "energy_eur_per_kwh": energy_price}
            names = [name.strip() for name in controllers.split(",")]
            live.set_shadow(names, every_s=_MINUTE * every, horizon_s=_MINUTE * length, prices=prices)
        if stop:
            live.end_shadow()
        found = live.shadow()
    if json_file:
        write_json(json_file, found)
    _print(found)


def _print(found: dict[str, Any]) -> None:
    """A row a controller of each day, the newest first, and the newest day in words."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    console, settings = Console(), found["settings"]
    if settings is None:
        said = "nobody is held against the controller that acts"
    else:
        every, length = settings["every_s"] // _MINUTE, settings["horizon_s"] // _MINUTE
        said = f"{', '.join(settings['controllers'])}: a stretch of {length} min every {every} min"
        said += f"; {found['lasting']} last"
    if not found["days"]:
        console.print(f"{said}; none has been compared yet", highlight=False)
        return
    table = Table(box=SIMPLE_HEAD, padding=(0, 1))
    for heading in ("day", "controller", "against", "better in", "cost [EUR]", "wait [s]", "score [EUR]"):
        left = heading in ("controller", "against")
        table.add_column(escape(heading), justify="left" if left else "right", no_wrap=True)
    for day in found["days"]:
        for each in day["sums"]:
            cost = "-" if each["saves_eur"] is None else f"{-each['saves_eur']:+.2f}"
            better = f"{each['better']} of {each['stretches']}"
            figures = (cost, f"{each['waits_s']:+.0f}", f"{-each['saves_score_eur']:+.2f}")
            table.add_row(str(day["day"]), each["controller"], ", ".join(each["against"]), better, *figures)
    console.width = max(console.width, console.measure(table, options=console.options.update(width=1000)).maximum)
    console.print(table)
    for each in found["days"][0]["sums"]:
        console.print(each["words"], highlight=False)
    console.print(said, highlight=False)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(shadow)
