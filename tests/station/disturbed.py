"""What tests of disturbed runs share: the true limits of every valve that was open, from the record alone."""

from __future__ import annotations

import numpy as np

from station.geometry import BUFFERS, INLETS
from station.limits import (
    buffer_temperature_margin,
    compressor_margin,
    flow_margin,
    gap_margin,
    hold_margin,
    vehicle_temperature_margin,
)


def least_margins(record, *, obeys_hold=True):
    """The least true margin [bar, g/s, K] of each limit over every second and open valve, with the TRUE constants."""
    plant = record.scenario.plant(record.replication)
    found = {}

    def note(name, margin, where):
        if where.any():
            found[name] = min(found.get(name, np.inf), float(margin[where].min()))

    vehicle_pressure, vehicle_temperature = record["pressure_vehicle"], record["temperature_vehicle"]
    for place, buffer in enumerate(BUFFERS):
        pressure, temperature = record[f"pressure_{buffer}"], record[f"temperature_{buffer}"]
        outlet, inlet = record[f"outlet_{buffer}"] == 1, record[f"inlet_{buffer}"] == 1
        note("flow", flow_margin(pressure, vehicle_pressure, plant), outlet)
        note("gap", gap_margin(pressure, vehicle_pressure, plant), outlet)
        note("vehicle_temperature", vehicle_temperature_margin(vehicle_temperature, plant, 1.0), outlet)
        note("compressor", compressor_margin(pressure, plant), inlet)
        note("buffer_temperature", buffer_temperature_margin(place, temperature, plant, 1.0), inlet)
        opened = inlet & ~np.concatenate(([False], inlet[:-1]))
        if obeys_hold:
            note("hold", hold_margin(pressure, plant), opened)
        assert not (inlet & outlet).any()
    inlets = sum(record[f"inlet_{buffer}"].astype(int) for buffer in BUFFERS)
    assert inlets.max() <= min(plant.compressor_count, INLETS.bit_count())
    assert sum(record[f"outlet_{buffer}"].astype(int) for buffer in BUFFERS).max() <= 1
    assert not any((record[f"outlet_{buffer}"] == 1)[record["vehicle"] < 0].any() for buffer in BUFFERS)
    return found
