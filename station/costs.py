"""Costs by a station's tariff: of a run from its record alone, or of any time whose energy was counted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from station.geometry import BUFFERS
from station.parameters import Station
from station.plants.interface import plant_named
from station.recorded import RecordedRun
from station.scenario import Scenario
from station.tariff import MONTH, QUARTER, Tariff

COST_UNITS = {
    "energy_eur": "EUR",
    "demand_eur": "EUR",
    "stock_eur": "EUR",
    "total_eur": "EUR",
    "eur_per_kg": "EUR/kg",
    "kwh_per_kg": "kWh/kg",
    "peak_kw": "kW",
    "revenue_eur": "EUR",
}
"""Figures of money and their units: where the station has a tariff, the last where it has a price of hydrogen."""

Floats = NDArray[np.float64]

_HOUR = 3600.0
METERS = ("energy_compressor", "energy_precooler")
"""Columns of a record whose plant keeps account of its energy."""


def costs(record: RecordedRun, delivered: float, energy: float) -> dict[str, float]:
    """The figures of COST_UNITS of a run with so much hydrogen [kg] and electric energy [kWh]; {} without a tariff.

    `energy_eur` is the energy of compressors and precooler at the price of its time; `peak_kw` the highest mean power
    of a quarter of an hour, counted from the start, in which a part left at the end of the run counts as a whole one;
    `demand_eur` the charge on it for the length of the run; `stock_eur` buys back what each buffer is short of its
    initial mass at the end, a surplus in another gives no credit; `total_eur` is the sum of the three. Within a row
    power is constant.
    """
    tariff = record.scenario.station.tariff
    if tariff is None:
        return {}
    time, meter = record["time"], _meter(record)
    edges = account_edges(tariff, 0.0, float(time[-1]))
    spent = np.diff(np.interp(edges, time, meter))
    masses = [[float(record[f"mass_{name}"][row]) for name in BUFFERS] for row in (0, -1)]
    stock = stock_eur(record.scenario, *masses)
    bill = bill_of(tariff, edges, spent, float(time[-1]), stock, delivered)
    found = {**bill, "kwh_per_kg": energy / delivered if delivered else math.inf}
    if tariff.hydrogen_eur_per_kg is not None:
        found["revenue_eur"] = tariff.hydrogen_eur_per_kg * delivered
    return {name: found[name] for name in COST_UNITS if name in found}


def account_edges(tariff: Tariff, begin: float, end: float) -> NDArray[np.float64]:
    """Times from `begin` to `end` between which energy is counted apart [s]: prices change, and quarters end.

    Quarters of an hour are counted from `begin`, prices by the time since the run's midnight.
    """
    changes = tariff.changes(end)
    quarters = np.arange(begin, end, QUARTER)
    found: NDArray[np.float64] = np.unique(np.concatenate((changes[changes > begin], quarters, [begin, end])))
    return found


def bill_of(
    tariff: Tariff, edges: NDArray[np.float64], spent: NDArray[np.float64], duration: float, stock: float,
    delivered: float,
) -> dict[str, float]:  # fmt: skip
    """Figures of COST_UNITS, from `energy_eur` to `peak_kw` without `kwh_per_kg`, of a time that began at `edges[0]`.

    `spent` [kWh] is the electric energy between each of `account_edges` and the next, `duration` [s] how much of the
    time has passed, `stock` [EUR] what `stock_eur` gives, `delivered` the hydrogen dispensed [kg].
    """
    quarters = np.bincount(((edges[:-1] - edges[0]) // QUARTER).astype(int), weights=spent)
    peak = float(quarters.max(initial=0.0)) * _HOUR / QUARTER
    bill = {
        "energy_eur": float((tariff.price_at((edges[:-1] + edges[1:]) / 2) * spent).sum()),
        "demand_eur": peak * tariff.demand_eur_per_kw_month * duration / MONTH,
        "stock_eur": stock,
    }
    total = sum(bill.values())
    return {**bill, "total_eur": total, "eur_per_kg": total / delivered if delivered else math.inf, "peak_kw": peak}


def _powers(station: Station) -> tuple[float, float]:
    """Of a compressor and of the precooler [kW]; 0 where a station does not say, which has then no tariff."""
    compressor, precooler = station.powers
    return compressor or 0.0, precooler or 0.0


def _meter(record: RecordedRun) -> NDArray[np.float64]:
    """Electric energy since the start at each row [kWh]; of a plant that keeps no account, from the powers."""
    if record.columns.keys() >= set(METERS):
        found: NDArray[np.float64] = record[METERS[0]] + record[METERS[1]]
        return found
    compressor, precooler = _powers(record.scenario.station)
    inlets = np.sum([record[f"inlet_{buffer}"][:-1] for buffer in BUFFERS], axis=0, dtype=float)
    outlets = np.any([record[f"outlet_{buffer}"][:-1] for buffer in BUFFERS], axis=0)
    spent = (compressor * inlets + precooler * outlets) * np.diff(record["time"]) / _HOUR
    return np.append(0.0, np.cumsum(spent))


def stock_eur(scenario: Scenario, first: Sequence[float], last: Sequence[float]) -> float:
    """Price of what buffers miss of their `first` masses at the `last` [g], in the order of BUFFERS [EUR].

    Infinite where the compressor cannot restore it; 0 without a tariff.
    """
    station = scenario.station
    if station.tariff is None:
        return 0.0
    constants = plant_named(station.plant).constants_of(station, communication=scenario.communication)
    return float(stocks_eur(station, np.array(first), np.array([last]), constants)[0])


def stocks_eur(station: Station, first: Floats, last: Floats, constants: Any) -> Floats:
    """The price that `stock_eur` tells of each of several ends of a station with a tariff, (ends,) [EUR].

    Parameters
    ----------
    station
        It, with a tariff.
    first
        Masses at first, (buffers,) [g].
    last
        Masses at each end, (ends, buffers) [g].
    constants
        Those of its plant.
    """
    tariff, plant, total = station.tariff, plant_named(station.plant), np.zeros(len(last))
    if tariff is None:
        return total
    for buffer, before in enumerate(first.tolist()):
        missing = last[:, buffer] < before
        now = last[missing, buffer]
        if tariff.stock_eur_per_kg is not None:
            total[missing] += tariff.stock_eur_per_kg * (before - now) / 1000
        elif plant.restoring_energy is not None:
            total[missing] += tariff.mean * plant.restoring_energy(buffer, now, before, constants)
        else:
            seconds = plant.restoring_time(buffer, now, before, constants)
            total[missing] += tariff.mean * _powers(station)[0] * seconds / _HOUR
    return total
