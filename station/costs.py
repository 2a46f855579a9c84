"""Costs of a run by its station's tariff, from its record alone."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from station.geometry import BUFFERS
from station.parameters import Station
from station.plants.interface import plant_named
from station.recorded import RecordedRun
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
    peak = _peak(time, meter)
    bill = {
        "energy_eur": _bill(time, meter, tariff),
        "demand_eur": peak * tariff.demand_eur_per_kw_month * float(time[-1]) / MONTH,
        "stock_eur": _stock(record, tariff),
    }
    total = sum(bill.values())
    found = {
        **bill,
        "total_eur": total,
        "eur_per_kg": total / delivered if delivered else math.inf,
        "kwh_per_kg": energy / delivered if delivered else math.inf,
        "peak_kw": peak,
    }
    if tariff.hydrogen_eur_per_kg is not None:
        found["revenue_eur"] = tariff.hydrogen_eur_per_kg * delivered
    return found


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


def _between(edges: NDArray[np.float64], time: NDArray[np.float64], meter: NDArray[np.float64]) -> Any:
    """Energy between each edge [s] and the next [kWh]."""
    return np.diff(np.interp(edges, time, meter))


def _bill(time: NDArray[np.float64], meter: NDArray[np.float64], tariff: Tariff) -> float:
    """Price of the energy [EUR]."""
    edges = tariff.changes(float(time[-1]))
    return float((tariff.price_at(edges[:-1]) * _between(edges, time, meter)).sum())


def _peak(time: NDArray[np.float64], meter: NDArray[np.float64]) -> float:
    """Highest mean power of a quarter [kW]."""
    quarters = np.arange(math.ceil(time[-1] / QUARTER) + 1) * QUARTER  # the meter stands still after the last row
    return float(_between(quarters, time, meter).max(initial=0.0)) * _HOUR / QUARTER


def _stock(record: RecordedRun, tariff: Tariff) -> float:
    """Price of what is missing of the initial stock [EUR]; infinite where the compressor cannot restore it."""
    station = record.scenario.station
    plant, total = plant_named(station.plant), 0.0
    constants = plant.constants_of(station, communication=record.scenario.communication)
    for buffer, name in enumerate(BUFFERS):
        mass = record[f"mass_{name}"]
        if mass[-1] >= mass[0]:
            continue
        if tariff.stock_eur_per_kg is not None:
            total += tariff.stock_eur_per_kg * float(mass[0] - mass[-1]) / 1000
        elif plant.restoring_energy is not None:
            total += tariff.mean * plant.restoring_energy(buffer, mass[-1], mass[0], constants)
        else:
            seconds = plant.restoring_time(buffer, mass[-1], mass[0], constants)
            total += tariff.mean * _powers(station)[0] * seconds / _HOUR
    return total
