"""The command `forecast`: what controllers will make of the time to come, at a live twin."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from api.cli.options import AnswerFileOption, UrlOption


def forecast(
    twin: Annotated[str, typer.Argument(metavar="TWIN", help="a live twin")],
    controllers: Annotated[
        str, typer.Option(help="comma-separated, options behind colons; the one that acts is compared in any case")
    ] = "logic,minlp1,reserve",
    hours: Annotated[float, typer.Option(min=1 / 60, max=24, help="how far to look ahead [h], in whole minutes")] = 1.0,
    futures: Annotated[int, typer.Option(min=1, max=2000, help="futures of each controller")] = 200,
    arrivals: Annotated[str, typer.Option(metavar="HOW", help="vehicles to come: law, learned or announced")] = "law",
    law: Annotated[
        str | None, typer.Option(metavar="SCENARIO", help="name of the scenario whose law draws vehicles")
    ] = None,
    waiting_price: Annotated[
        float, typer.Option(min=0, max=10_000, help="of an hour that a vehicle waits [EUR/h]")
    ] = 20.0,
    energy_price: Annotated[
        float, typer.Option(min=0, max=10_000, help="where the station has no tariff [EUR/kWh]")
    ] = 0.3,
    faults: Annotated[
        str, typer.Option(metavar="HOW", help="those that the station has: they last, or are mended now")
    ] = "last",
    seed: Annotated[int, typer.Option(min=0, help="seed of the futures")] = 0,
    json_file: AnswerFileOption = None,
    url: UrlOption = None,
) -> None:
    """Fork a live twin into futures, and rank controllers by what they cost and how long vehicles wait.

    A key is read from HRS_API_KEY.
    """
    from api.cli.console import progress_bar
    from api.client import Service
    from api.files import check_writable, write_json
    from api.settings import load_settings

    if json_file:
        check_writable(json_file)
    asked: dict[str, Any] = {
        "controllers": [name.strip() for name in controllers.split(",")], "horizon_s": 60 * round(60 * hours),
        "futures": futures, "arrivals": arrivals, "seed": seed, "faults": faults,
        "prices": {"waiting_eur_per_h": waiting_price, "energy_eur_per_kwh": energy_price},
    }  # fmt: skip
    if law is not None:
        asked["law"] = law
    with Service(load_settings(url=url)) as service, progress_bar("controllers") as progress:
        job = service.twin(twin).forecast(**asked)
        found = service.wait(job.path, lambda now: progress(now["done"], len(now["names"])))
    if found["answer"] is None:
        problem = found["problem"] or {"title": found["state"], "detail": ""}
        typer.echo(f"hrs: forecast {job.id} {found['state']}: {problem['title']} {problem['detail']}", err=True)
        raise typer.Exit(2)
    if json_file:
        write_json(json_file, found)
    _print(found)


def _print(found: dict[str, Any]) -> None:
    """A row a controller, least score first, and the ranking in words."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    answer = found["answer"]
    hours, begin = found["horizon_s"] / 3600, found["begin_s"]
    title = f"{hours:g} h from {begin:.0f} s on, {found['futures']} futures: median (5 % to 95 %)"
    table = Table(title=title, title_justify="left", title_style="bold", box=SIMPLE_HEAD, padding=(0, 1))
    shown = {"wait": 0, "served": 0, "incomplete": 0, "energy": 1, "cost": 2}
    figures = {each["controller"]: each["figures"] for each in answer["controllers"]}
    table.add_column("controller", no_wrap=True)
    for name in shown:
        unit = figures[found["names"][0]][name]["unit"]
        table.add_column(escape(f"{name} [{unit}]") if unit != "1" else name, justify="right", no_wrap=True)
    table.add_column(escape("score [EUR]"), justify="right")
    table.add_column("beats", justify="right")
    for each in answer["ranking"]:
        name = each["controller"]
        cells = [_band(figures[name][figure], digits) for figure, digits in shown.items()]
        acts = name == found["names"][0]
        beats = "acts" if acts else f"{each['beats']:.0%}"
        table.add_row(name, *cells, f"{each['score']:.2f}", beats)
    console = Console()
    console.width = max(console.width, console.measure(table, options=console.options.update(width=1000)).maximum)
    console.print(table)
    console.print(answer["advice"], highlight=False)
    for line in _faults(found):
        console.print(line, highlight=False)


def _faults(found: dict[str, Any]) -> list[str]:
    """What the futures have of the station's faults, in words."""
    if found["mended"]:
        return ["as if the faults of the station were mended now"]
    if found["doubt"]:
        return [f"without the faults that were found: {found['doubt']}"]
    return [f"in every future: {each['event']}{_size(each)}, since {each['begin_s']:.0f} s" for each in found["faults"]]


def _size(fault: dict[str, Any]) -> str:
    return "" if fault["size"] is None else f" {fault['size']:.3g} {fault['unit']}"


def _band(figure: dict[str, Any], digits: int) -> str:
    if figure["median"] is None:
        return "-"
    return f"{figure['median']:.{digits}f} ({figure['low']:.{digits}f} to {figure['high']:.{digits}f})"


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(forecast)
