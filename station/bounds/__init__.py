"""Proved lower bounds on what any controller can reach: waits, compressor time, and one against the other.

`docs/bounds.md` has statement and proof; `proof.py` is what must be right, `proposal.py` only makes it tight.
"""

from station.bounds.grid import COARSE, FINE, Resolution
from station.bounds.scenario import Bounds, Point, StationPrices, bounds

__all__ = ["COARSE", "FINE", "Bounds", "Point", "Resolution", "StationPrices", "bounds"]
