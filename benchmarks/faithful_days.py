"""Days at stations with real gas, as docs/faithful.md has them: `python -m benchmarks.faithful_days [PART...]`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from statistics import mean
from typing import Annotated

import numpy as np
import typer

from controllers import create_from
from station import Record, parse_scenario, simulate

HOURLY_WEIGHTS = (1, 1, 1, 1, 1, 2, 5, 8, 8, 5, 3, 3, 4, 4, 3, 4, 7, 9, 9, 6, 4, 3, 2, 1)
"""Demand of 24 hours, with two peaks."""

EVEN_WEIGHTS = (1,) * 24
"""Demand of 24 hours, all alike."""

ENDLESS = {name: {"volume_m3": 50.0} for name in ("high", "medium", "low")}
"""Banks whose pressure no day moves: a fill takes what ramp, nozzle and valve make of it."""

VOLUMES_M3 = (0.122, 0.157)
"""Least and greatest tank."""

EVERYBODY = ("logic", "reserve", "guarded", "switched", "scenario", "adaptive", "minlp1", "minlp2")
AT_EQUAL = (
    "logic", "switched:peak_kw=null", "switched", "switched:peak_kw=12", "scenario", "adaptive", "guarded", "reserve",
    "minlp1",
)  # fmt: skip
MANY = (
    ("h70-equal", "logic"), ("h70-equal", "switched:peak_kw=null"), ("h70-equal", "switched"), ("h70-light", "logic"),
    ("h70-light", "switched"), ("h70-light", "switched:peak_kw=auto"),
)  # fmt: skip


def day(
    station: str, count: int, controller: str, replication: int, seed: int = 0, weights: Sequence[int] = HOURLY_WEIGHTS,
    buffers: Mapping[str, Mapping[str, float]] | None = None,
) -> Record:  # fmt: skip
    """A day of so many vehicles; with `buffers` in place of the preset's."""
    fleet = [{"name": "light", "share": 1, "volume_m3": list(VOLUMES_M3)}]
    arrivals = {"kind": "profile", "count": count, "hourly_weights": list(weights), "fleet": fleet}
    there = {"preset": station} | ({} if buffers is None else {"buffers": buffers})
    scenario = parse_scenario({"name": "day", "station": there, "arrivals": arrivals})
    return simulate(scenario, create_from(controller), replication=replication, seed=seed)


def mean_fill(record: Record) -> float:
    """Of all vehicles [s]."""
    return float(np.mean(record.vehicles["finished"] - record.vehicles["connected"]))


def served_part() -> Iterator[str]:
    """40 vehicles at h70-light: waits, fills and energy, by replication 1 and 2, and what must not happen."""
    yield "controller | mean wait s | mean fill s | compressor kWh/kg | unserved, highest SoC, degC"
    for name in EVERYBODY:
        records = [day("h70-light", 40, name, k) for k in (1, 2)]
        told = [each.metrics() for each in records]
        work = [float(each["energy_compressor"][-1]) / m.delivered for each, m in zip(records, told, strict=True)]
        left = sum(m.vehicles_not_finished + m.vehicles_incomplete for m in told)
        charge, heat = (
            max(float(each.vehicles[of].max()) for each in records) for of in ("state_of_charge", "temperature_max")
        )
        yield (
            f"`{name}` | {_pair([m.t_avg for m in told], 1)} | {_pair([mean_fill(each) for each in records], 0)} | "
            f"{_pair(work, 3)} | {left:g}, {charge:.3f}, {heat:.0f}"
        )


def money_part() -> Iterator[str]:
    """20 vehicles at h70-equal: means of four replications."""
    yield "controller | EUR/kg | energy + demand + stock EUR | peak kW | kWh/kg | mean wait s | mean fill s | starts"
    for name in AT_EQUAL:
        records = [day("h70-equal", 20, name, k) for k in range(1, 5)]
        told = [each.metrics() for each in records]
        of = {key: mean(getattr(m, key) for m in told) for key in (
            "eur_per_kg", "energy_eur", "demand_eur", "stock_eur", "peak_kw", "kwh_per_kg", "t_avg",
            "compressor_starts",
        )}  # fmt: skip
        costs = f"{of['energy_eur']:.2f} + {of['demand_eur']:.2f} + {of['stock_eur']:.2f}"
        service = f"{of['t_avg']:.0f} | {mean(map(mean_fill, records)):.0f} | {of['compressor_starts']:.0f}"
        yield (
            f"`{name}` | {of['eur_per_kg']:.3f} | {costs} | {of['peak_kw']:.1f} | {of['kwh_per_kg']:.2f} | {service}"
        )


def saved_part() -> Iterator[str]:
    """Twelve days of 20 vehicles at h70-equal: what `switched` costs less than logic."""
    rows = []
    for seed in (0, 7):
        for k in range(1, 7):
            logic, mine = (day("h70-equal", 20, name, k, seed) for name in ("logic", "switched"))
            one, two = logic.metrics(), mine.metrics()
            longest = [float(np.max(each.vehicles["finished"] - each.vehicles["connected"])) for each in (logic, mine)]
            rows.append((1 - (two.eur_per_kg or 0) / (one.eur_per_kg or 1), one.t_avg, two.t_avg, *longest))
    costs, *others = np.array(rows).T
    shown = ", ".join(f"{100 * cost:.0f} %" for cost in sorted(costs))
    yield f"EUR/kg {100 * costs.mean():.1f} % less: {shown}"
    yield f"mean wait {others[0].mean():.1f} -> {others[1].mean():.1f} s"
    yield f"longest fill {others[2].max():.0f} -> {others[3].max():.0f} s"


def many_part() -> Iterator[str]:
    """40 vehicles: means of four replications."""
    yield "station, controller | EUR/kg | peak kW | mean wait s | mean fill s"
    for station, name in MANY:
        records = [day(station, 40, name, k) for k in range(1, 5)]
        told = [each.metrics() for each in records]
        cost, peak, wait = (mean(getattr(m, key) for m in told) for key in ("eur_per_kg", "peak_kw", "t_avg"))
        yield f"`{station}`, `{name}` | {cost:.3f} | {peak:.1f} | {wait:.0f} | {mean(map(mean_fill, records)):.0f}"


def waits_part() -> Iterator[str]:
    """40 vehicles at h70-light, twelve days each: what `switched` waits, and what no choice of banks could undercut."""
    yield "arrivals, seed | mean wait s: logic, switched, endless banks | mean fill s | kWh/kg, greatest | unserved"
    for name, weights in (("even", EVEN_WEIGHTS), ("two peaks", HOURLY_WEIGHTS)):
        for seed in (0, 7):
            logic, mine, least = (
                [day("h70-light", 40, controller, k, seed, weights, buffers) for k in range(1, 13)]
                for controller, buffers in (("logic", None), ("switched", None), ("logic", ENDLESS))
            )
            waits = [mean(each.metrics().t_avg for each in records) for records in (logic, mine, least)]
            fills = [mean(map(mean_fill, records)) for records in (logic, mine, least)]
            told = [each.metrics() for each in mine]
            work = max(float(e["energy_compressor"][-1]) / m.delivered for e, m in zip(mine, told, strict=True))
            left = sum(m.vehicles_not_finished + m.vehicles_incomplete for m in told)
            yield (
                f"{name}, {seed} | {', '.join(f'{w:.1f}' for w in waits)} | {', '.join(f'{f:.0f}' for f in fills)} | "
                f"{work:.3f} | {left:g}"
            )


def _pair(values: Sequence[float], digits: int) -> str:
    return ", ".join(f"{value:.{digits}f}" for value in values)


PARTS = {"served": served_part, "money": money_part, "saved": saved_part, "many": many_part, "waits": waits_part}


def main(
    part: Annotated[list[str] | None, typer.Argument(help=f"some of {', '.join(PARTS)}; all if left out")] = None,
) -> None:
    """Print the tables, row by row."""
    for name in part or PARTS:
        for line in PARTS[name]():
            typer.echo(line)


if __name__ == "__main__":
    typer.run(main)
