"""A day of a station that nobody knows, as its sensors would tell it: day.csv.

The station is thesis-fit with volumes, rates and coefficients up to 15 % off; the vehicles are those of S4. Noise is
1 bar, 0.5 K and 2 % of flow, 2 % of the samples are missing. No measured data: our own simulator made it.
"""

import csv
from pathlib import Path

import numpy as np

from controllers import create
from station import load_scenario, load_station, simulate
from station.geometry import VALVES
from station.parameters import Station
from station.sensor_names import ANALOG

random = np.random.default_rng(26)
given = load_station("thesis-fit").model_dump()
for buffer in ("high", "medium", "low"):
    for field in ("volume_m3", "inlet_heating_k_per_s", "outlet_cooling_k_per_s"):
        given["buffers"][buffer][field] *= random.uniform(0.85, 1.15)
given["compressor"]["inlet_coefficient_g_per_s_bar"] *= random.uniform(0.85, 1.15)
given["dispenser"]["outlet_coefficient_g_per_s_bar"] *= random.uniform(0.85, 1.15)
hidden = Station.model_validate({**given, "name": "hidden"})

record = simulate(load_scenario("S4").on(hidden), create("switched"))
seconds = len(record) - 1
columns = {"time_s": record["time"][:seconds].astype(int)}
for name in (*ANALOG, *VALVES, "vehicle"):
    values = record[name][:seconds].astype(float)
    if name.startswith("pressure"):
        values += random.normal(0.0, 1.0, seconds)
    elif name.startswith("temperature"):
        values += random.normal(0.0, 0.5, seconds)
    elif name.startswith("flow"):
        values *= random.normal(1.0, 0.02, seconds)
    values[random.random(seconds) < 0.02] = np.nan
    columns[name] = values

with Path("day.csv").open("w", newline="", encoding="utf-8") as file:
    writer = csv.writer(file)
    writer.writerow(columns)
    for row in zip(*columns.values(), strict=True):
        writer.writerow("" if np.isnan(value) else f"{value:.6g}" for value in row)
for buffer in ("high", "medium", "low"):
    print(f"{buffer:<8} {getattr(hidden.buffers, buffer).volume_m3:.5f} m3")
