"""The command `figures`: vehicles, waits, hydrogen, energy and cost of any stretch of a twin's record."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any
from urllib.parse import quote

import typer

from api.cli.options import UrlOption

ENDINGS = {".csv": "csv", ".parquet": "parquet", ".json": "json"}
"""Format of a file of figures by its ending."""


class By(StrEnum):
    """What a stretch is cut into."""

    WINDOW = "window"
    HOUR = "hour"
    SHIFT = "shift"
    DAY = "day"


def figures(
    twin: Annotated[str, typer.Argument(metavar="TWIN", help="a twin, live or ended")],
    first: Annotated[
        int | None, typer.Option("--from", min=0, metavar="S", help="first second; default the first that is kept")
    ] = None,
    last: Annotated[
        int | None, typer.Option("--to", min=1, metavar="S", help="end of the last second; default the newest")
    ] = None,
    by: Annotated[By, typer.Option(help="what the stretch is cut into")] = By.WINDOW,
    shift: Annotated[
        int | None, typer.Option(min=1, max=24, help="length of a shift [h], if not the station's")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="write every figure, one row a window (.csv, .parquet or .json)")
    ] = None,
    html_file: Annotated[
        Path | None, typer.Option("--html", metavar="FILE", help="write a report that prints on A4")
    ] = None,
    url: UrlOption = None,
) -> None:
    """Show the figures of a stretch of a twin's record, whole or by hour, shift or day.

    A key is read from HRS_API_KEY.
    """
    from api.client import Client
    from api.files import check_ending, check_writable, write_whole
    from api.settings import load_settings

    if out:
        check_ending(out, tuple(ENDINGS))
    if html_file:
        check_writable(html_file)
    path = f"/v1/twins/{quote(twin, safe='')}"
    query: dict[str, Any] = {"from_s": first, "to_s": last, "by": str(by), "shift_h": shift}
    with Client(load_settings(url=url)) as client:
        found = client.get(f"{path}/figures", **query)
        query |= {"from_s": found["items"][0]["from_s"], "to_s": found["items"][-1]["to_s"]}  # files are of the same
        if out:
            write_whole(out, client.read(f"{path}/figures", **query, format=ENDINGS[out.suffix]))
        if html_file:
            write_whole(html_file, client.read(f"{path}/report", **query))
    _print(found)


_COLUMNS = {
    "vehicles_served": ("served", 0), "wait_mean_s": ("mean wait [s]", 0), "wait_p95_s": ("wait p95 [s]", 0),
    "delivered_kg": ("kg", 1), "energy_kwh": ("kWh", 1), "total_eur": ("EUR", 2), "eur_per_kg": ("EUR/kg", 3),
    "peak_kw": ("peak [kW]", 1), "compressor_starts": ("starts", 0), "utilisation": ("use", 3),
    "availability": ("available", 4),
}  # fmt: skip
"""Figures that the table shows: heading and decimals; files have all of them."""

_OF_MONEY = ("total_eur", "eur_per_kg", "peak_kw")


def _print(found: dict[str, Any]) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    items = found["items"]
    billed = any(each["energy_eur"] is not None for each in items)
    shown = {name: each for name, each in _COLUMNS.items() if billed or name not in _OF_MONEY}
    table = Table(box=SIMPLE_HEAD, padding=(0, 1))
    for heading in ("from [s]", "to [s]", *(heading for heading, _ in shown.values())):
        table.add_column(escape(heading), justify="right", no_wrap=True)
    for each in items:
        cells = ("-" if each[name] is None else f"{each[name]:.{decimals}f}" for name, (_, decimals) in shown.items())
        table.add_row(str(each["from_s"]), str(each["to_s"]), *cells)
    console = Console()
    console.width = max(console.width, console.measure(table, options=console.options.update(width=1000)).maximum)
    console.print(table)
    missing = sum(each["to_s"] - each["from_s"] - each["whole_s"] for each in items)
    if missing:
        console.print(f"{missing} s of it are kept as minutes, or no more: - stands for what these do not tell")


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(figures)
