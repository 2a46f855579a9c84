"""A hidden station: parameters nobody knows, run with a controller, and written as if measured. Seeded."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pyarrow as pa

from benchmarks.drills import OFF
from benchmarks.following import HALF_DAY, WIDTH, told
from benchmarks.measured_forecasts import drawn_station
from benchmarks.measured_forecasts import measured as frames_measured
from controllers import create_from
from station import Scenario, load_station, simulate
from station.geometry import BUFFERS, TANKS, VALVES
from station.measurement import Tag, TagMap
from station.parameters import Station
from station.record import Record
from station.scenario import parse_scenario
from station.sensor_names import ANALOG

SPREAD, TOP_SPREAD, AMBIENT_SPREAD = 0.15, 0.03, 5.0


def hidden_station(seed: int, spread: float = SPREAD, ambient: float = AMBIENT_SPREAD) -> Station:
    """The preset with every figure of its plant off by up to `spread`, the compressor's pressure by less."""
    rng = np.random.default_rng([seed, 26])
    given: dict[str, Any] = load_station("thesis-fit").model_dump()

    def move(part: dict[str, Any], name: str, width: float = spread) -> None:
        part[name] *= 1 + width * rng.uniform(-1, 1)

    for name in BUFFERS:
        for field in ("volume_m3", "inlet_heating_k_per_s", "outlet_cooling_k_per_s"):
            move(given["buffers"][name], field)
    move(given["compressor"], "pressure_bar", TOP_SPREAD * spread / SPREAD)
    move(given["compressor"], "inlet_coefficient_g_per_s_bar")
    move(given["dispenser"], "outlet_coefficient_g_per_s_bar")
    move(given["vehicle"], "heating_k_per_s")
    move(given["thermal"], "heat_exchange_per_s")
    given["thermal"]["ambient_temperature_c"] += ambient * rng.uniform(-1, 1)
    return Station.model_validate({**given, "name": f"hidden-{seed}"})


def hidden_real_station(seed: int, spread: float = SPREAD, ambient: float = AMBIENT_SPREAD) -> Station:
    """The preset of real gas with what a calibration finds off by up to `spread`, and in other air."""
    rng = np.random.default_rng([seed, 28])
    given: dict[str, Any] = load_station("h70-light").model_dump()
    unit, ways, cold = (given["real_gas"][name] for name in ("compressor", "dispensing", "precooler"))
    parts = [*((given["buffers"][name], "volume_m3") for name in BUFFERS), (unit, "displacement_m3_per_h"),
             (unit, "clearance"), (ways, "valve_mm2")]  # fmt: skip
    for part, name in parts:
        part[name] *= 1 + spread * rng.uniform(-1, 1)
    cold["set_point_c"] += 20 * spread * rng.uniform(-1, 1)
    given["thermal"]["ambient_temperature_c"] += ambient * rng.uniform(-1, 1)
    return Station.model_validate({**given, "name": f"hidden-{seed}"})


def in_usual_air(station: Station) -> Station:
    """The station as it is known to who does not read the air's temperature."""
    usual = load_station("h70-light").thermal.ambient_temperature_c
    return station.model_copy(
        update={"thermal": station.thermal.model_copy(update={"ambient_temperature_c": usual})}
    )  # fmt: skip


def day(
    station: Station, vehicles: int = 40, seconds: float = 86_400, controller: str = "logic", faults: Any = ()
) -> Record:
    """A day with vehicles at even distances, which start at pressures of their own."""
    rng = np.random.default_rng([vehicles, 7])
    arriving = [
        {"time_s": float(round(seconds * (k + 0.3) / vehicles)), "start_pressure_bar": float(rng.uniform(100, 180))}
        for k in range(vehicles)
    ]
    scenario: Scenario = parse_scenario(
        {
            "name": "hidden",
            "station": station.model_dump(),
            "arrivals": {"kind": "trace", "vehicles": arriving},
            "time_limit_s": seconds,
            "faults": list(faults),
        }
    )
    return simulate(scenario, create_from(controller))


def truth(record: Record, seconds: int) -> dict[str, np.ndarray]:
    """The true values of every sensor at each second; after the run's end the rest is cut off."""
    rows = min(seconds, len(record) - 1)
    return {name: np.array(record[name][:rows], float) for name in (*ANALOG, *VALVES, "vehicle", "time")}


def measured(
    true: dict[str, np.ndarray], seed: int, missing: float = 0.02, skew: float = 0.0, pressure: float = 1.0,
    temperature: float = 0.5, flow: float = 0.02,
) -> pa.Table:  # fmt: skip
    """The record as sensors tell it: the two halves of the station have clocks of their own, `skew` seconds apart."""
    rng = np.random.default_rng([seed, 27])
    count = len(true["time"])
    table: dict[str, Any] = {"time_s": true["time"]}
    shift = round(skew)
    for name, values in true.items():
        if name == "time":
            continue
        read = values.copy()
        if name.startswith("pressure"):
            read += pressure * rng.standard_normal(count)
        elif name.startswith("temperature"):
            read += temperature * rng.standard_normal(count)
        elif name.startswith("flow"):
            read *= 1 + flow * rng.standard_normal(count)
        read[rng.random(count) < missing] = np.nan
        if shift and name not in (*VALVES, "vehicle"):
            moved = np.full(count, np.nan)
            moved[max(shift, 0) : count + min(shift, 0)] = read[max(-shift, 0) : count - max(shift, 0)]
            read = moved
        table[name] = pa.array(read, from_pandas=True)
    return pa.table(table)


def tags(sensors: tuple[str, ...] = (*ANALOG, *VALVES, "vehicle")) -> TagMap:
    """A map whose columns are called as the sensors are; transmitters have another clock than valves."""
    return TagMap(
        tags=[
            Tag(tag=name, column=name, sensor=name, source="plc" if name in (*VALVES, "vehicle") else "transmitters")
            for name in sensors
        ]
    )


def leaking(
    station: Station, record: Record, buffer: int, begin: int, rate: float, seconds: int | None = None
) -> dict[str, np.ndarray]:
    """The same commands again at the same station, with a leak of a buffer from a second on [g/s].

    What the controller would have done otherwise does not matter to who follows it.
    """
    return replayed(
        station, record, lambda row, x: x.__setitem__(8 + buffer, x[8 + buffer] - rate * (row >= begin)), seconds
    )


def replayed(
    station: Station, record: Record, disturb: Any, seconds: int | None = None, *, compressor: Any = None,
    air: Any = None,
) -> dict[str, np.ndarray]:  # fmt: skip
    """The first seconds of a record's commands applied again; `disturb(row, state)` changes the masses after each.

    `compressor(row)` is what is left of the compressor, `air(row)` by how much warmer the air is [K].
    """
    from station.plants.thesis import advance, gas_pressure

    true = truth(record, seconds or len(record))
    constants = station.constants()
    state = np.zeros(12)
    for tank in range(4):
        state[tank], state[4 + tank] = record[f"pressure_{TANKS[tank]}"][0], record[f"temperature_{TANKS[tank]}"][0]
        state[8 + tank] = record[f"mass_{TANKS[tank]}"][0]
    vehicle = -1
    commands = sum(true[valve].astype(int) << bit for bit, valve in enumerate(VALVES))
    for row in range(len(true["time"])):
        if true["vehicle"][row] != vehicle:
            vehicle = true["vehicle"][row]
            for place, what in ((3, "pressure"), (7, "temperature"), (11, "mass")):
                state[place] = record[f"{what}_vehicle"][row]
        for tank in range(4):
            there = tank < 3 or vehicle >= 0
            true[f"pressure_{TANKS[tank]}"][row] = state[tank] if there else np.nan
            true[f"temperature_{TANKS[tank]}"][row] = state[4 + tank] if there else np.nan
        plant = constants
        if compressor is not None:
            plant = constants._replace(inlet_coefficient=constants.inlet_coefficient * compressor(row))
        if air is not None:
            plant = plant._replace(ambient_temperature=constants.ambient_temperature + air(row))
        spent = advance(state, station.vehicle.volume_m3 if vehicle >= 0 else 0.0, int(commands[row]), 1.0, plant)
        true["flow_compressor"][row], true["flow_dispenser"][row] = spent.compressed, spent.dispensed
        disturb(row, state)
        for tank in range(3):
            state[tank] = gas_pressure(state[8 + tank], state[4 + tank], constants.buffer_volume[tank])
    return true


def csv_text(table: pa.Table) -> str:
    """The table as a CSV file's text."""
    from pyarrow import csv

    out = io.BytesIO()
    csv.write_csv(table, out)
    return out.getvalue().decode()


def told_of_half_a_day(preset, controller, seed):
    """What is told of a drawn station that nothing ails, with 20 vehicles, by a calibrated file that is hardly off."""
    hidden, known = drawn_station(preset, seed, OFF / WIDTH), load_station(preset)
    law = {"kind": "uniform", "count": 20, "period_s": float(HALF_DAY)}
    given = {"name": "day", "station": hidden.model_dump(mode="json"), "arrivals": law}
    scenario = parse_scenario({**given, "time_limit_s": float(HALF_DAY)})
    record = simulate(scenario, create_from(controller), replication=seed, seed=seed)
    return told(frames_measured(record, seed), known.model_copy(update={"calibrated": True}))
