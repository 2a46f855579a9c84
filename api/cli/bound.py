"""The command `bound`: what no controller can do better on a scenario, proved."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from api.cli.options import StationOption, scenario_of
from station import InputError

if TYPE_CHECKING:
    from station.bounds import Bounds

_WAITS = (0.0, 60.0, 300.0, 600.0)


def bound(
    scenarios: Annotated[
        list[str] | None, typer.Argument(metavar="[SCENARIO]...", help="names or files; default S1 S2 S3 S4")
    ] = None,
    station: StationOption = None,
    wait: Annotated[
        list[float] | None,
        typer.Option(metavar="SECONDS", help="a limit on t_avg for the trade-off, as often as wanted; 0 60 300 600"),
    ] = None,
    replication: Annotated[int, typer.Option(min=0, help="0 is the pattern, others are drawn")] = 0,
    seed: Annotated[int, typer.Option("--seed", min=0, help="seed of replications >= 1")] = 0,
    json_file: Annotated[Path | None, typer.Option("--json", metavar="FILE", help="write every bound as JSON")] = None,
    *,
    quick: Annotated[bool, typer.Option("--quick", help="coarser potentials: seconds, and looser bounds")] = False,
) -> None:
    """Prove what no controller can do better: waits, compressor time, and one against the other."""
    from api.cli.console import working
    from api.files import check_writable, write_json
    from station.bounds import COARSE, FINE, StationPrices, bounds

    if json_file:
        check_writable(json_file)
    limits = wait or list(_WAITS)
    for limit in limits:
        if not (math.isfinite(limit) and limit >= 0):
            raise InputError("bound", [("--wait", f"must be a finite number of seconds, at least 0; given {limit:g}")])
    chosen = [scenario_of(name, station) for name in scenarios or ["S1", "S2", "S3", "S4"]]
    known: dict[str, StationPrices] = {}
    found: list[Bounds] = []
    for scenario in chosen:
        key = scenario.station.model_dump_json()
        if key not in known:
            alike = [other for other in chosen if other.station == scenario.station]
            with working(f"pricing {scenario.station.name}"):
                arriving = [other.vehicles(replication, seed) for other in alike]
                known[key] = StationPrices.of(arriving, scenario, COARSE if quick else FINE)
        count = len(scenario.vehicles(replication, seed).arrival)
        with working(f"bounding {scenario.name}"):
            totals = [limit * count for limit in limits]
            found.append(bounds(scenario, totals, prices=known[key], replication=replication, seed=seed))
    _print(found)
    if json_file:
        write_json(json_file, [item.document() for item in found])


def _print(found: list[Bounds]) -> None:
    """A table: for each scenario the waits nobody undercuts, and the compressor time at each limit on them."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    table = Table(box=SIMPLE_HEAD, padding=(0, 1), title="No controller does better [s]", title_justify="left")
    for heading in ("scenario", "station", "vehicles", "t_avg", "where t_avg is at most", "restored"):
        table.add_column(heading, justify="left" if heading in {"scenario", "station"} else "right", no_wrap=True)
    for item in found:
        head = [item.scenario, item.station, str(item.vehicles), _seconds(item.t_total / item.vehicles)]
        table.add_row(*head, "any", _seconds(item.t_comp_restored))
        for point in item.trade_off:
            table.add_row("", "", "", "", _seconds(point.wait / item.vehicles), _seconds(point.restored))
    console = Console()
    console.width = max(console.width, 100)
    console.print(table)
    console.print("Every controller, also one that knows the future; every vehicle filled. Proof: docs/bounds.md")


def _seconds(value: float) -> str:
    return "impossible" if math.isinf(value) else f"{value:,.0f}".replace(",", " ")


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(bound)
