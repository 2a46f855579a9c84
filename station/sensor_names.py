"""Names of a station's sensors, and of the events that are found in what they read."""

from __future__ import annotations

from station.geometry import BUFFERS, TANKS, VALVES

ANALOG = (*(f"pressure_{tank}" for tank in TANKS), *(f"temperature_{tank}" for tank in TANKS), "flow_compressor",
          "flow_dispenser")  # fmt: skip
"""Sensors with an error, the filter's channels, in its order."""

BANK_SENSORS = (*(f"pressure_{each}" for each in BUFFERS), *(f"temperature_{each}" for each in BUFFERS))
"""Sensors of the buffers: of them drift is told."""

VEHICLE_SENSORS = ("pressure_vehicle", "temperature_vehicle")
"""Those that each vehicle brings."""

METERS = ("flow_compressor", "flow_dispenser")
"""Flow meters, of which drift is told as well."""

POWER = "power_compressor"
"""Electric power of the compressors; it is no channel of the filter."""

SENSORS = (*ANALOG, *VALVES, "vehicle", "vehicle_volume", POWER)
"""Everything a tag can be: `vehicle` numbers the vehicle connected, -1 for none."""

HEARD = SENSORS.index("vehicle_volume")
"""All sensors before it must speak every second."""

DETECTABLE = (
    *(f"leak_{each}" for each in BUFFERS),
    "compressor_weak",
    "dispenser_clogged",
    *(f"{kind}_{name}" for kind in ("offset", "noisy", "frozen") for name in ANALOG),
    *(f"absent_{name}" for name in SENSORS[:HEARD]),
    *(f"drift_{name}" for name in BANK_SENSORS),
    *(f"stuck_{name}" for name in VALVES),
    "leak_line",
    *(f"drift_{each}" for each in METERS),
    *(f"leak_outlet_{each}" for each in BUFFERS),
    "precooler_weak",
)
"""Events that a detector tells, in its order; the last one at a plant that precools."""
