"""What tests of disturbed runs share: the true limits of every valve that was open, from the record alone."""

from __future__ import annotations

import numpy as np

from station.geometry import BUFFERS, INLETS
from station.limits import Situation, state_limits


def least_margins(record, *, obeys_hold=True):
    """The least true margin [bar, g/s, K] of each limit over every second and open valve, with the TRUE constants."""
    plant = record.scenario.plant(record.replication)
    found = {}

    def note(name, margin, where):
        if where.any():
            found[name] = min(found.get(name, np.inf), float(margin[where].min()))

    vehicle = record["pressure_vehicle"], record["temperature_vehicle"]
    for place, buffer in enumerate(BUFFERS):
        at = Situation(place, record[f"pressure_{buffer}"], record[f"temperature_{buffer}"], *vehicle)
        valves = {side: record[f"{side}_{buffer}"] == 1 for side in ("inlet", "outlet")}
        for limit in state_limits():
            where = valves[limit.side]
            if limit.of_closed:
                where = where & ~np.concatenate(([False], where[:-1])) & obeys_hold
            note(limit.name, limit.margin(at, plant, 1.0), where)
        assert not (valves["inlet"] & valves["outlet"]).any()
    inlets = sum(record[f"inlet_{buffer}"].astype(int) for buffer in BUFFERS)
    assert inlets.max() <= min(plant.compressor_count, INLETS.bit_count())
    assert sum(record[f"outlet_{buffer}"].astype(int) for buffer in BUFFERS).max() <= 1
    assert not any((record[f"outlet_{buffer}"] == 1)[record["vehicle"] < 0].any() for buffer in BUFFERS)
    return found
