"""Days of 12 h with 20 to 100 vehicles, usual ones or a mixed fleet, at the presets and two stations of our own.

Rows of docs/controllers.md and docs/faithful.md: `benchmarks/data/fleet_days.json`, written by `--resume --json`.
"""

from __future__ import annotations

import json
import math
import sys
from itertools import product
from pathlib import Path
from typing import Annotated, Any, TextIO

import numpy as np
import typer

from api.files import check_writable, write_json
from benchmarks.duel import Outcome, Verdict, joined, outcome, outcomes, verdict
from benchmarks.machine import machine
from station.scenario import Scenario, parse_scenario

SEED = 26_112_311
"""Fixed before anything was tuned; tuning used others."""

PERIOD = 43_200.0
"""Span of the arrivals [s]."""

LIMIT = 400_000.0
"""Time limit of a run [s]: a station that is asked for more than it can give works on until all are served."""

STATIONS: dict[str, dict[str, Any]] = {
    "thesis-fit": {}, "thesis-fit-a": {}, "thesis-fit-b": {}, "thesis-fit-cascade": {}, "light-duty-700": {},
    "two compressors": {"preset": "light-duty-700", "compressor": {"count": 2}},
    "350 bar": {
        "preset": "thesis-fit-b",
        "vehicle": {"volume_m3": 0.4, "start_pressure_bar": 60.0, "finish_pressure_bar": 350.0},
    },
    "h70-light": {}, "h70-equal": {}, "h35-bus": {}, "h70-truck": {},
}  # fmt: skip
"""Presets, and changes to one under a name of our own."""

FLEET = [
    {"name": "car", "share": 6, "volume_m3": [0.1, 0.25]},
    {"name": "van", "share": 2, "volume_m3": [0.2, 0.4]},
    {
        "name": "bus", "share": 1, "volume_m3": [0.6, 1.5], "start_pressure_bar": [20, 120],
        "finish_pressure_bar": [350, 350],
    },
]  # fmt: skip

FLEETS = {
    "h35-bus": [{**each, "finish_pressure_bar": [350, 350]} for each in FLEET],
    "h70-truck": [*FLEET, {"name": "truck", "share": 3, "volume_m3": [1.0, 2.0]}],
}
"""Mixed fleets of stations that have their own."""

PORTION = 10
"""Days of a cell that are played before FILE is written anew."""

CHARGE_MAX, HEAT_MAX = 1.0, 85.0
"""No vehicle may have more: state of charge, and degC."""


def day(place: int, station: str, mixed: bool, seed: int = SEED) -> Scenario:
    """Day `place`: its number of vehicles and its law are drawn, and with `mixed` the vehicles from three classes."""
    random = np.random.default_rng([seed, place])
    count = int(random.integers(20, 101))
    laws: list[dict[str, Any]] = [
        {"kind": "uniform", "count": count, "period_s": PERIOD},
        {"kind": "normal", "count": count, "period_s": PERIOD, "truncation": float(random.uniform(0.5, 2.5))},
        {"kind": "poisson", "rate_per_h": 3600 * count / PERIOD, "period_s": PERIOD},
        {"kind": "profile", "count": count, "hourly_weights": random.uniform(0.2, 1.0, 12).tolist()},
    ]
    law = laws[int(random.integers(len(laws)))]
    return parse_scenario(
        {
            "name": f"day-{place}",
            "station": {"preset": station, "name": station, **STATIONS[station]},
            "arrivals": {**law, "fleet": FLEETS.get(station, FLEET)} if mixed else law,
            "time_limit_s": LIMIT,
        }
    )


def _play(task: tuple[str, int, str, bool]) -> Outcome:
    controller, place, station, mixed = task
    return outcome(day(place, station, mixed), controller, replication=place + 1, seed=SEED)


def cells() -> list[tuple[str, bool]]:
    """Stations with usual vehicles, then with a mixed fleet; at 350 bar cars of it would not find their 700."""
    return [(name, mixed) for mixed in (False, True) for name in STATIONS if not (mixed and name == "350 bar")]


def fleet_of(mixed: bool) -> str:
    """The name of a fleet."""
    return "mixed" if mixed else "usual"


def against_logic(controller: str, station: str, mixed: bool, places: range, progress: TextIO | None = None) -> Verdict:
    """`controller` against logic on the days at `places`; `progress` is a terminal's line."""
    played: dict[str, list[Outcome]] = {"logic": [], controller: []}
    tasks = [(name, place, station, mixed) for place in places for name in played]
    for (name, place, *_), item in zip(tasks, outcomes(_play, tasks), strict=True):
        played[name].append(item)
        if progress is not None:
            progress.write(f"\r{controller}, {station}, {fleet_of(mixed)}: {place + 1} of {places.stop} days\x1b[K")
            progress.flush()
    return verdict(played["logic"], played[controller])


def as_document(controller: str, station: str, mixed: bool, found: Verdict) -> dict[str, Any]:
    """A verdict as JSON holds it; pairs are logic's figure and the controller's."""
    return {
        "controller": controller, "station": station, "fleet": fleet_of(mixed), "days": found.days,
        "waits_no_longer": found.wait, "compresses_no_more": found.compress, "both": found.both,
        "mean_t_avg_s": found.t_avg, "mean_t_comp_restored_s": found.t_comp_restored, "mean_t_dis_s": found.t_dis,
        "not_served": found.unserved, "days_with_one_not_served_that_logic_serves": found.left,
        "state_of_charge_max": _known(found.charge), "vehicle_temperature_max_c": _known(found.heat),
        "cpu_of_an_hour_s": _known(found.cpu),
    }  # fmt: skip


def _known(value: float) -> float | None:
    return None if math.isnan(value) else value


def as_verdict(row: dict[str, Any]) -> Verdict:
    """A verdict from what JSON holds of it."""
    may_be_unknown = ("state_of_charge_max", "vehicle_temperature_max_c", "cpu_of_an_hour_s")
    return Verdict(
        row["days"], row["waits_no_longer"], row["compresses_no_more"], row["both"],
        tuple(row["mean_t_avg_s"]), tuple(row["mean_t_comp_restored_s"]), tuple(row["mean_t_dis_s"]),
        tuple(row["not_served"]), row["days_with_one_not_served_that_logic_serves"],
        *(math.nan if row[name] is None else row[name] for name in may_be_unknown),
    )  # fmt: skip


def kept(row: dict[str, Any]) -> bool:
    """Whether everybody is served whom logic serves, nobody beyond what a tank bears."""
    charge, heat = row["state_of_charge_max"], row["vehicle_temperature_max_c"]
    within = (charge is None or charge <= CHARGE_MAX) and (heat is None or heat <= HEAT_MAX)
    return within and not row["days_with_one_not_served_that_logic_serves"]


def rows_of(file: Path) -> list[dict[str, Any]]:
    """Rows that were written with `--json`; none where there is no such file."""
    return json.loads(file.read_text())["rows"] if file.exists() else []


def main(
    controllers: Annotated[list[str] | None, typer.Argument(help="switched, if none is named")] = None,
    *,
    days: Annotated[int, typer.Option(min=1, max=10_000, help="at each station, with each fleet")] = 20,
    station: Annotated[list[str] | None, typer.Option(help="one of them; may be given again")] = None,
    fleet: Annotated[str, typer.Option(help="usual, mixed or both")] = "both",
    json_file: Annotated[Path | None, typer.Option("--json", metavar="FILE", help="write what was found")] = None,
    resume: Annotated[bool, typer.Option(help="keep the days that FILE has, and play only others")] = False,
) -> None:
    """Controllers against logic on drawn days of 12 h; status 1 where one leaves a vehicle that logic finishes.

    And where a tank is filled or warmed beyond what it bears.
    """
    wanted = [cell for cell in cells() if fleet in (fleet_of(cell[1]), "both") and cell[0] in (station or STATIONS)]
    if not wanted:
        raise typer.BadParameter(f"no days at {station or 'any station'} with fleet {fleet!r}; stations: {[*STATIONS]}")
    if json_file:
        check_writable(json_file)
    rows = {_cell(row): row for row in rows_of(json_file)} if resume and json_file else {}
    progress = sys.stderr if sys.stderr.isatty() else None
    for (at, mixed), name in product(wanted, controllers or ["switched"]):
        cell = (name, at, fleet_of(mixed))
        portions = _portions(rows[cell]["days"] if cell in rows else 0, days, PORTION if json_file else days)
        for places in portions:
            found = against_logic(name, at, mixed, places, progress)
            row = as_document(name, at, mixed, joined(as_verdict(rows[cell]), found) if cell in rows else found)
            rows = {key: each for key, each in rows.items() if key != cell} | {cell: row}
            if json_file:
                write_json(json_file, {"seed": SEED, "machine": machine(), "rows": [*rows.values()]})
        if portions:
            typer.echo(json.dumps(rows[cell]))
    raise typer.Exit(int(not all(map(kept, rows.values()))))


def _portions(first: int, days: int, size: int) -> list[range]:
    """The days from `first` to `days` in portions, so that a run that is stopped loses one at most."""
    return [range(start, min(start + size, days)) for start in range(first, days, size)]


def _cell(row: dict[str, Any]) -> tuple[str, str, str]:
    return row["controller"], row["station"], row["fleet"]


if __name__ == "__main__":
    typer.run(main)
