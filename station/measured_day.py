"""A run as its sensors would tell it: noise, missing samples, and the faults of sensors and clocks of its scenario."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from station.faults.kinds import Fault
from station.faults.sensors import ClockSkew, SensorAbsent, SensorDrift, SensorFrozen, SensorNoisy, SensorOffset
from station.geometry import BUFFERS, VALVES
from station.measurement import FLOW_NOISE, NOISE, Tag, TagMap, kind_of
from station.record import Record
from station.sensor_names import ANALOG, POWER

if TYPE_CHECKING:
    import pyarrow as pa

MISSING = 0.02
"""Part of the samples that get lost."""

TOLD = (*VALVES, "vehicle")
"""What a station says besides its sensors, which is never wrong."""

VOLUME = "vehicle_volume"
"""What a vehicle says of its tank, where it communicates."""

_MORE = (VOLUME, POWER)
"""What is measured behind them, where it is known."""


def tags_of_day() -> TagMap:
    """The tag map of `measured_day`: columns are called as sensors, transmitters have a clock of their own."""
    return TagMap(
        tags=[
            Tag(tag=name, column=name, sensor=name, source="plc" if name in (*TOLD, VOLUME) else "transmitters")
            for name in (*ANALOG, *TOLD, *_MORE)
        ]
    )


def measured_day(record: Record, seed: int = 0, missing: float = MISSING) -> pa.Table:
    """A table with a row a row of the record and a column a sensor, in bar, degC and g/s, with the time in s.

    Noise is normal: 1 bar, 0.5 K, 2 % of a flow. The faults are those of the record's scenario that are of sensors or
    clocks; faults of the plant have happened. Equal arguments give equal tables.

    Parameters
    ----------
    record : Record
        The run.
    seed : int
        Of noise and missing samples.
    missing : float
        Part of the samples that get lost, from 0 to 1.

    Returns
    -------
    pyarrow.Table
        `time_s` and a column a sensor; null where a sample is missing, and everywhere
        in `vehicle_volume` where vehicles do not communicate, and `power_compressor` where no power is known.
    """
    import pyarrow as pa

    rows = len(record) - 1
    time = record["time"][:rows]
    faults = record.scenario.faults
    table = {"time_s": pa.array(time)}
    for place, name in enumerate((*ANALOG, *TOLD)):
        random = np.random.default_rng([seed, place])
        values = noisy(record[name][:rows].astype(float), name, random)
        for fault in faults:
            if getattr(fault, "sensor", None) == name:
                values = misread(values, time, fault, random)
        values[random.random(rows) < missing] = np.nan
        if name in ANALOG:
            values = _stamped(values, time, faults)
        table[name] = pa.array(values, from_pandas=True)
    for name, values in zip(_MORE, (_volumes(record, rows), _powers(record, rows)), strict=True):
        random = np.random.default_rng([seed, len(table)])
        values[random.random(rows) < missing] = np.nan
        told = noisy(values, name, random)
        table[name] = pa.array(
            _stamped(told, time, faults) if name == POWER else told, pa.float64(), from_pandas=True
        )  # fmt: skip
    return pa.table(table)


def _volumes(record: Record, rows: int) -> NDArray[np.float64]:
    """Tanks that the vehicles of each row tell [m3]; NaN where there is none, or it does not communicate."""
    if not record.scenario.communication:
        return np.full(rows, np.nan)
    volumes = np.append(record.vehicles["volume"], np.nan)  # -1, nobody, is the last
    return np.asarray(volumes[record["vehicle"][:rows].astype(np.int64)])


def _powers(record: Record, rows: int) -> NDArray[np.float64]:
    """Power of the compressors [kW]: each of the thesis's plant its power while it fills; NaN where none is known."""
    if POWER in record.columns:
        return np.array(record[POWER][:rows], float)
    power, _ = record.scenario.station.powers
    filling = sum((record[valve][:rows].astype(float) for valve in VALVES[: len(BUFFERS)]), np.zeros(rows))
    return filling * (np.nan if power is None else power)


def noisy(values: NDArray[np.float64], name: str, random: np.random.Generator) -> NDArray[np.float64]:
    """Readings of a healthy sensor in place of the true values."""
    kind = kind_of(name)
    if kind in ("flow", "power"):
        return np.asarray(values * random.normal(1.0, FLOW_NOISE, len(values)))
    return np.asarray(values + random.normal(0.0, NOISE[kind], len(values))) if kind in NOISE else values


def misread(
    values: NDArray[np.float64], time: NDArray[np.float64], fault: Fault, random: np.random.Generator
) -> NDArray[np.float64]:
    """Readings of a sensor with a fault in place of those it would give; a flow that is none is as noisy as one."""
    there = (time >= fault.begin_s) & (time < fault.until)
    changed = values.copy()
    if isinstance(fault, SensorOffset | SensorDrift):
        hours = (time - fault.begin_s) / 3600 if isinstance(fault, SensorDrift) else np.ones(len(time))
        added = fault.amount * hours
        changed += there * (noisy(added, fault.sensor, random) if kind_of(fault.sensor) == "flow" else added)
    elif isinstance(fault, SensorNoisy):
        changed += there * random.normal(0.0, fault.amount, len(values))
    elif isinstance(fault, SensorAbsent):
        changed[there] = np.nan
    elif isinstance(fault, SensorFrozen):
        known = values[(time <= fault.begin_s) & np.isfinite(values)]
        changed[there] = known[-1] if len(known) else np.nan
    return changed


def _stamped(values: NDArray[np.float64], time: NDArray[np.float64], faults: Sequence[Fault]) -> NDArray[np.float64]:
    """Samples of transmitters by their clock."""
    for fault in faults:
        if isinstance(fault, ClockSkew):
            values = _skewed(values, time, fault)
    return values


def _skewed(values: NDArray[np.float64], time: NDArray[np.float64], fault: ClockSkew) -> NDArray[np.float64]:
    """Samples that stand in the rows of another time; where no row has that time they are lost."""
    there = (time >= fault.begin_s) & (time < fault.until)
    moved = np.where(there, np.nan, values)
    stamped = time[there] + fault.skew_s
    rows = np.minimum(np.searchsorted(time, stamped), len(time) - 1)
    fits = time[rows] == stamped
    moved[rows[fits]] = values[there][fits]
    return moved
