"""Every drill of the page, found or not: `python -m benchmarks.drills [--station h70-light] [--controller switched]`.

A station drawn for each drill is followed by a calibrated file that is off by a twentieth of a percent, in air that is
up to 5 K off. The fault begins by chance between the third and the sixth hour of half a day with 20 vehicles, has the
size that the page suggests, and stays.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np

from benchmarks.following import HALF_DAY, VEHICLES, WIDTH, told
from benchmarks.measured_forecasts import drawn_station, measured
from controllers import create_from
from station import Station, load_station, parse_scenario, simulate
from station.estimation.score import score
from station.geometry import BUFFERS, VALVES
from station.measured_day import tags_of_day
from station.sensor_names import ANALOG

OFF = 0.05
"""The file is off by so much at most [%]."""

SIZES = {"pressure": "bar", "temperature": "k", "flow": "g_per_s"}
"""How the field of a sensor's size ends."""


def drills(real_gas: bool) -> Iterator[dict[str, Any]]:
    """The faults that the page offers but those of clocks, in sizes that it suggests."""
    yield from ({"kind": "leak", "buffer": bank, "rate_g_per_s": 1.0} for bank in BUFFERS)
    yield {"kind": "compressor_weak", "loss_percent": 25.0}
    yield {"kind": "compressor_tripped"}
    yield {"kind": "dispenser_clogged", "loss_percent": 25.0}
    if real_gas:
        yield {"kind": "precooler_weak", "warmer_k": 5.0}
    yield {"kind": "line_leak", "rate_g_per_s": 1.0}
    yield from ({"kind": "outlet_leak", "valve": f"outlet_{bank}", "rate_g_per_s": 2.0} for bank in BUFFERS)
    for valve in VALVES:
        yield from ({"kind": "valve_stuck", "valve": valve, "position": where} for where in ("closed", "open"))
    for sensor in ANALOG:
        unit = SIZES[sensor.partition("_")[0]]
        yield {"kind": "sensor_offset", "sensor": sensor, f"offset_{unit}": 10.0 if unit == "bar" else 5.0}
        yield {"kind": "sensor_drift", "sensor": sensor, f"drift_{unit}_per_h": 3.0}
        yield {"kind": "sensor_noisy", "sensor": sensor, f"noise_{unit}": 4.0}
        yield {"kind": "sensor_frozen", "sensor": sensor}
        yield {"kind": "sensor_absent", "sensor": sensor}


def drill(preset: str, controller: str, fault: dict[str, Any], seed: int) -> tuple[dict[str, Any], list[str]]:
    """How a fault is judged, and events that it does not explain.

    A valve that sticks and moves nothing all day cannot be told: `untold` says so then.
    """
    hidden: Station = drawn_station(preset, seed, OFF / WIDTH)
    known = load_station(preset).model_copy(update={"calibrated": True})
    begin = float(np.random.default_rng([seed, 6]).integers(3 * 3600, 6 * 3600))
    law = {"kind": "uniform", "count": VEHICLES // 2, "period_s": float(HALF_DAY)}
    given = {"name": "drill", "station": hidden.model_dump(mode="json"), "arrivals": law}
    scenario = parse_scenario({**given, "time_limit_s": float(HALF_DAY), "faults": [{**fault, "begin_s": begin}]})
    record = simulate(scenario, create_from(controller), replication=seed, seed=seed)
    found = score(told(measured(record, seed), known), scenario.faults, tags_of_day(), known)
    judged = found["faults"][0]
    if fault["kind"] == "valve_stuck" and fault["position"] == "closed" and not judged["found"]:
        used = bool(np.any(np.asarray(record[fault["valve"]])[int(begin) :]))
        judged["untold"] = judged["untold"] if used else "no use was made of it"
    return judged, found["false_events"]


def main() -> None:
    """Parse the arguments, print each drill and how many were told."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--station", default="thesis-fit")
    parser.add_argument("--controller", default="logic")
    parser.add_argument("--seed", type=int, default=1, help="of the first drill")
    asked = parser.parse_args()
    count: Counter[str] = Counter()
    for place, fault in enumerate(drills(load_station(asked.station).real_gas is not None)):
        judged, false = drill(asked.station, asked.controller, fault, asked.seed + place)
        state = "told" if judged["found"] else "cannot be told" if judged["untold"] else "missed"
        count[state] += 1
        count["told alone"] += bool(judged["found"] and not false)
        when = f" after {judged['delay_s']:.0f} s" if judged["found"] else ""
        also = f"; also {', '.join(sorted(set(false)))}" if false else ""
        about = " ".join(str(value) for value in fault.values())
        print(f"{about}: {judged['name']} {state}{when}{also}", flush=True)
    print(", ".join(f"{state}: {number}" for state, number in sorted(count.items())))


if __name__ == "__main__":
    main()
