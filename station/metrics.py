"""Figures of merit of a run, from its record alone."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from station.controller import Status
from station.costs import COST_UNITS, METERS, costs
from station.geometry import BUFFERS
from station.plants.interface import plant_named
from station.recorded import RecordedRun

CHARGE_TEMPERATURE = 15.0
"""At which a full tank's finish pressure is meant [deg C]."""


@dataclass(frozen=True)
class Metrics(Mapping[str, float]):
    """Figures of merit; attributes and mapping alike. `UNITS` gives the unit of each.

    Those of money, whose units are in `station.costs.COST_UNITS`, are None and no items of the mapping where the
    station has no tariff.
    """

    t_total: float
    t_avg: float
    t_comp: float
    t_comp_restored: float
    t_dis: float
    wait_p50: float
    wait_p95: float
    wait_max: float
    queue_max: float
    queue_mean: float
    compressor_starts: float
    delivered: float
    energy: float
    energy_kwh: float | None
    pressure_high: float
    pressure_medium: float
    pressure_low: float
    vehicles: float
    vehicles_not_finished: float
    vehicles_incomplete: float
    t_liveness: float
    refused_valves: float
    duration: float
    energy_eur: float | None = None
    demand_eur: float | None = None
    stock_eur: float | None = None
    total_eur: float | None = None
    eur_per_kg: float | None = None
    kwh_per_kg: float | None = None
    peak_kw: float | None = None
    revenue_eur: float | None = None

    def __getitem__(self, name: str) -> float:
        if name in UNITS or (name in COST_UNITS and getattr(self, name) is not None):
            return getattr(self, name)
        raise KeyError(name)

    def __iter__(self) -> Iterator[str]:
        names = (item.name for item in fields(self))
        return (name for name in names if name in UNITS or getattr(self, name) is not None)

    def __len__(self) -> int:
        return sum(1 for _ in self)


UNITS = {
    "t_total": "s",
    "t_avg": "s",
    "t_comp": "s",
    "t_comp_restored": "s",
    "t_dis": "s",
    "wait_p50": "s",
    "wait_p95": "s",
    "wait_max": "s",
    "queue_max": "vehicles",
    "queue_mean": "vehicles",
    "compressor_starts": "1",
    "delivered": "kg",
    "energy": "precooler-seconds",
    "energy_kwh": "kWh",
    "pressure_high": "bar",
    "pressure_medium": "bar",
    "pressure_low": "bar",
    "vehicles": "1",
    "vehicles_not_finished": "1",
    "vehicles_incomplete": "1",
    "t_liveness": "s",
    "refused_valves": "1",
    "duration": "s",
}
"""Unit of each figure that every run has."""


def units_of(found: Iterable[Iterable[str]]) -> dict[str, str]:
    """Units of the figures in `found`, metrics or rows by name: those of every run, and of money what is there."""
    there = set().union(*found)
    return {**UNITS, **{name: unit for name, unit in COST_UNITS.items() if name in there}}


def metrics(record: RecordedRun) -> Metrics:
    """Figures of merit of one run.

    t_total is the sum of the waits from arrival to connection (a vehicle never connected waits to the end), t_avg
    that by vehicles, t_comp the compressor-seconds, t_dis the seconds with an outlet open. `t_comp_restored` adds
    the compressor-seconds that would bring each buffer back to its initial mass. `energy` counts a
    compressor-second twice a dispensing second, the 2:1 of Sec. 7.3; `energy_kwh` is what the plant used, or needs the
    station's powers.
    What it cost stands where the station has a tariff, as `station.costs.costs` tells.
    `vehicles_incomplete` are those not finished that left; in `t_liveness` a liveness rule decided.
    """
    time = record["time"]
    spans = np.diff(time)
    waits = _waits(record)
    inlets: NDArray[np.int64] = np.asarray(
        np.sum([record[f"inlet_{buffer}"][:-1] for buffer in BUFFERS], axis=0, dtype=np.int64)
    )
    outlets: NDArray[np.int64] = np.asarray(
        np.sum([record[f"outlet_{buffer}"][:-1] for buffer in BUFFERS], axis=0, dtype=np.int64)
    )
    queue = record["queue_length"][:-1]
    duration = float(time[-1])
    t_comp = _over_time(inlets, spans)
    t_dis = _over_time(outlets > 0, spans)
    refused = sum(int(np.count_nonzero(record[name])) for name in record.columns if name.startswith("refused_"))
    delivered = float(record.vehicles["delivered"].sum()) / 1000
    energy = _energy(record, t_comp, t_dis)
    return Metrics(
        t_total=float(waits.sum()),
        t_avg=float(waits.mean()),
        t_comp=t_comp,
        t_comp_restored=t_comp + _restoring(record),
        t_dis=t_dis,
        wait_p50=float(np.quantile(waits, 0.5)),
        wait_p95=float(np.quantile(waits, 0.95)),
        wait_max=float(waits.max()),
        queue_max=float(queue.max(initial=0)),
        queue_mean=_over_time(queue, spans) / duration if duration else 0.0,
        compressor_starts=float(_starts(inlets)),
        delivered=delivered,
        energy=2 * t_comp + t_dis,
        energy_kwh=energy,
        pressure_high=float(record["pressure_high"][-1]),
        pressure_medium=float(record["pressure_medium"][-1]),
        pressure_low=float(record["pressure_low"][-1]),
        vehicles=float(len(waits)),
        vehicles_not_finished=float(np.isnan(record.vehicles["finished"]).sum()),
        vehicles_incomplete=float(incomplete(record).sum()),
        t_liveness=_over_time(record["decision_status"][:-1] == Status.LIVENESS, spans),
        refused_valves=float(refused),
        duration=duration,
        **({} if energy is None else costs(record, delivered, energy)),
    )


def _energy(record: RecordedRun, compressing: float, dispensing: float) -> float | None:
    """Electric energy of compressors and precooler [kWh]; of a plant that keeps no account, from the station's powers.

    `compressing` and `dispensing` are the seconds of both.
    """
    if record.columns.keys() >= set(METERS):
        return float(sum(record[name][-1] for name in METERS))
    compressor, precooler = record.scenario.station.powers
    if compressor is None or precooler is None:
        return None
    return (compressor * compressing + precooler * dispensing) / 3600


def incomplete(record: RecordedRun) -> NDArray[np.bool_]:
    """Which vehicles left before they were full, (vehicles,)."""
    left = np.isnan(record.vehicles["finished"]) & ~np.isnan(record.vehicles["connected"])
    if record["vehicle"][-1] >= 0:
        left[record["vehicle"][-1]] = False  # still there
    return left


def state_of_charge(vehicles: Mapping[str, Any], plant: str) -> Any:
    """Mass of vehicles over their mass at their finish pressure and 15 deg C; scalars or arrays by column.

    `vehicles` has VEHICLE_COLUMNS. The reference is that of SAE J2601's state of charge, with the gas law of the
    station's `plant`, which may tell it itself.
    """
    if "state_of_charge" in vehicles:
        return vehicles["state_of_charge"]
    volume, mass = vehicles["volume"], plant_named(plant).held
    held = mass(vehicles["start_pressure"], vehicles["start_temperature"], volume) + vehicles["delivered"]
    return held / mass(vehicles["finish_pressure"], CHARGE_TEMPERATURE, volume)


def _over_time(levels: NDArray[Any], spans: NDArray[np.float64]) -> float:
    """Integral over time of what holds for each span [s].

    Not np.dot: BLAS may share a sum among threads of its own, which then fight the comparison's for the cores, and
    whose number decides how it is rounded.
    """
    return float((levels * spans).sum())


def _waits(record: RecordedRun) -> NDArray[np.float64]:
    """Wait of each vehicle [s]; one never connected waits from arrival to the end of the run."""
    end = record["time"][-1]
    connected = np.where(np.isnan(record.vehicles["connected"]), end, record.vehicles["connected"])
    return np.maximum(connected - record.vehicles["arrival"], 0.0)


def _starts(inlets: NDArray[np.int64]) -> int:
    """How often a compressor starts, all starting from rest."""
    return int(np.maximum(np.diff(inlets, prepend=0), 0).sum())


def _restoring(record: RecordedRun) -> float:
    """Compressor-seconds that refill each buffer to its initial mass at 25 deg C; a surplus gives no credit.

    Infinite where the initial mass lies out of reach at 25 deg C.
    """
    station = record.scenario.station
    plant = plant_named(station.plant)
    constants, total = plant.constants_of(station, communication=record.scenario.communication), 0.0
    for buffer, name in enumerate(BUFFERS):
        mass = record[f"mass_{name}"]
        if mass[-1] < mass[0]:
            total += float(plant.restoring_time(buffer, mass[-1], mass[0], constants))
    return total
