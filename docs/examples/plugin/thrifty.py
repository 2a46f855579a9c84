"""A controller of one's own: dispense from the emptiest buffer that can, refill only while nobody waits."""

from controllers.base import BaseController
from station import Decision, Valve
from station.geometry import BUFFERS


class Thrifty(BaseController):
    """Keeps the full buffers for the end of a fill and lets the compressor rest while a vehicle is connected."""

    name = "thrifty"
    about = "emptiest buffer first, refill between vehicles"

    def start(self, station):
        """Prepare for a run on `station`."""
        super().start(station)
        self.gap = station.dispenser.outlet_gap_min_bar
        self.full = 0.9 * station.compressor.pressure_bar

    def decide(self, seen):
        """Open one valve, or none; the shield closes what a limit forbids and asks logic instead."""
        by_pressure = sorted(range(3), key=lambda buffer: seen.pressure[buffer])
        for buffer in by_pressure:
            name = BUFFERS[buffer].upper()
            if seen.vehicle >= 0 and seen.pressure[buffer] - seen.vehicle_pressure >= self.gap:
                return Decision(Valve[f"OUTLET_{name}"])
            if seen.vehicle < 0 and seen.pressure[buffer] < self.full:
                return Decision(Valve[f"INLET_{name}"])
        return Decision(Valve[f"INLET_{BUFFERS[by_pressure[0]].upper()}"] if seen.vehicle >= 0 else 0)
