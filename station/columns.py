"""Columns of a record and of its table of vehicles, with their units."""

from __future__ import annotations

from station.geometry import TANKS, VALVES

# The kernel writes three blocks; the order of a block's columns is the order of these tables.
VALUES = {
    "time": "s",
    **{f"pressure_{tank}": "bar" for tank in TANKS},
    **{f"temperature_{tank}": "degC" for tank in TANKS},
    **{f"mass_{tank}": "g" for tank in TANKS},
    "flow_compressor": "g/s",
    "flow_dispenser": "g/s",
    "decision_cost": "bar2",
    "decision_bound": "bar2",
}
"""Floating-point columns and their units. A row is the state at `time` and what holds until the next row."""


CODES = {
    **dict.fromkeys(VALVES, "1"),
    **{f"refused_{valve}": "code" for valve in VALVES},
    "decision_status": "code",
}
"""Small codes: a valve is 0 or 1; `refused_*` is a station.Limit, `decision_status` a station.Status."""


COUNTS = {"vehicle": "index", "queue_length": "vehicles"}
"""Integer columns: the vehicle at the dispenser (-1 for none), and those waiting behind it."""


VEHICLE_COLUMNS = {
    "arrival": "s",
    "connected": "s",
    "finished": "s",
    "volume": "m3",
    "start_pressure": "bar",
    "start_temperature": "degC",
    "finish_pressure": "bar",
    "final_pressure": "bar",
    "delivered": "g",
}
"""Columns of the table of vehicles; NaN where a vehicle was not connected or not finished."""
