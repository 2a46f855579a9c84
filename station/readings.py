"""Readings of the sensors, found again from the record of a run."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from station.compiled import kernel
from station.controller import Observation
from station.geometry import TANKS, VALVES, VEHICLE
from station.plants.interface import reads_nozzle
from station.record import Record
from station.sensors import OFF, SensorModel, read


@kernel
def _read_again(times: np.ndarray, values: np.ndarray, thermal: bool, sensors: SensorModel) -> np.ndarray:
    found = np.empty_like(values)
    for row in range(values.shape[1]):
        for tank in range(values.shape[0]):
            found[tank, row] = read(values[tank, row], tank, thermal, times[row], sensors)
    return found


def readings(record: Record) -> tuple[np.ndarray, np.ndarray]:
    """The pressures [bar] and temperatures [deg C] that the sensors reported, each (4, rows); NaN without a vehicle.

    Without communication the vehicle's rows hold the readings of its connection only, and the rest is NaN; but for the
    pressure where the dispenser reads it itself.
    """
    sensors = record.scenario.sensor_model(record.replication)
    reads, found = reads_nozzle(record.scenario.plant(record.replication)), []
    for what in ("pressure", "temperature"):
        true = np.array([record[f"{what}_{tank}"] for tank in TANKS])
        if not (record.scenario.communication or (reads and what == "pressure")):
            vehicle = record["vehicle"]
            true[VEHICLE, 1:][vehicle[1:] == vehicle[:-1]] = np.nan
        read_again = true if sensors.kind == OFF else _read_again(record["time"], true, what == "temperature", sensors)
        found.append(read_again)
    return found[0], found[1]


def observations(record: Record) -> Iterator[Observation]:
    """Readings of the sensors second by second, reconstructed after a run.

    Of a vehicle without communication it holds what was reported at its connection; NaN later, when nothing is.
    """
    pressure, temperature = readings(record)
    scenario = record.scenario
    live = scenario.communication or reads_nozzle(scenario.plant(record.replication))
    command = np.bitwise_or.reduce([record[valve].astype(int) << bit for bit, valve in enumerate(VALVES)])
    for row in range(len(record)):
        vehicle = int(record["vehicle"][row])
        known = scenario.communication and vehicle >= 0
        p, t = pressure[:, row].tolist(), temperature[:, row].tolist()
        yield Observation(
            float(record["time"][row]), 1.0, tuple(p[:VEHICLE]), tuple(t[:VEHICLE]), vehicle, p[VEHICLE], t[VEHICLE],
            float(record.vehicles["volume"][vehicle]) if known else scenario.station.vehicle.volume_m3,
            live, int(record["queue_length"][row]), int(command[row - 1]) if row else 0,
        )  # fmt: skip
