"""Tables of drawn days in docs/controllers.md and docs/faithful.md, of what was played for them.

Played by `python -m benchmarks.fleet_days CONTROLLER... --days 200 --resume --json benchmarks/data/fleet_days.json`,
some hours on two cores for all; `python -m benchmarks.fleet_days_document` writes the tables.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from benchmarks.documents import rewrite, table
from benchmarks.fleet_days import STATIONS, rows_of
from station.preset_files import load_station

DATA = Path(__file__).parent / "data" / "fleet_days.json"

CONTROLLERS = ("switched", "adaptive", "scenario", "guarded", "reserve", "minlp1", "minlp2", "minlp3")


def is_real(station: str) -> bool:
    """Whether a station of `STATIONS` follows real gas."""
    return load_station(STATIONS[station].get("preset", station)).real_gas is not None


def _sorted(rows: list[dict[str, Any]], *, real: bool) -> list[dict[str, Any]]:
    order = list(STATIONS)
    found = [row for row in rows if is_real(row["station"]) == real]
    return sorted(
        found,
        key=lambda row: (CONTROLLERS.index(row["controller"]), row["fleet"] == "mixed", order.index(row["station"])),
    )


def _cells(row: dict[str, Any]) -> list[str]:
    days = row["days"]
    shares = (row[name] for name in ("waits_no_longer", "compresses_no_more", "both"))
    means = (row[name] for name in ("mean_t_avg_s", "mean_t_comp_restored_s", "not_served"))
    return [
        f"`{row['controller']}`", row["station"], row["fleet"], f"{days}",
        *(f"{100 * share / days:.3g} %" for share in shares), *(f"{a:.0f} -> {b:.0f}" for a, b in means),
        f"{row['days_with_one_not_served_that_logic_serves']}",
    ]  # fmt: skip


HEADINGS = (
    "controller", "station", "fleet", "days", "waits no longer", "compresses no more", "both", "mean t_avg [s]",
    "mean t_comp_restored [s]", "not served", "days with one that logic serves",
)  # fmt: skip


def thesis_part() -> str:
    """Days at stations of the thesis's plant."""
    rows = _sorted(rows_of(DATA), real=False)
    taken = [row["cpu_of_an_hour_s"] for row in rows]  # none where a machine of another speed played them
    cells = [[*_cells(row), "" if cpu is None else f"{1e3 * cpu:.0f}"] for row, cpu in zip(rows, taken, strict=True)]
    return table((*HEADINGS, "CPU of an hour [ms]"), cells, 3)


def real_part() -> str:
    """Days at stations of real gas, with what tanks were filled and warmed to."""
    rows = _sorted(rows_of(DATA), real=True)
    cells = [
        [*_cells(row), f"{row['state_of_charge_max']:.3f}", f"{row['vehicle_temperature_max_c']:.0f}"] for row in rows
    ]
    return table((*HEADINGS, "greatest state of charge", "warmest vehicle [degC]"), cells, 3)


def main() -> None:
    """Write the tables."""
    rewrite("controllers.md", {"days": thesis_part()})
    rewrite("faithful.md", {"days": real_part()})


if __name__ == "__main__":
    main()
