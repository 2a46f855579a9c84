"""Lattice on which draws are priced: pressures of vehicles, of buffers, and flows, one apart by the same step.

A draw's flow is proportional to its gap u = p_b - p_v, so a draw is known by v and u. With v_i and u_j on lattices of
one step, the buffer's pressure v_i + u_j lies on a lattice of that step too, and the least gap is a line of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from station.bounds.grid import Grid
from station.bounds.spline import Floats

_FLOWS = 40
"""Flows at which draws are priced; between them prices are concave, above their straight lines."""


@dataclass(frozen=True)
class Lattice:
    """Nodes of draws into vehicles whose pressure and gas a gram are bounded."""

    step: float  # [bar]
    vehicle: Floats  # v_i, up to the highest finish pressure [bar]
    gap: Floats  # u_j, from the least gap [bar]
    flow: Floats  # at u_j [g/s]
    buffer: Floats  # [bar]
    offset: int  # buffer[offset + i + j] = vehicle[i] + gap[j]
    table: Floats  # flows at which prices are known [g/s]

    @classmethod
    def of(cls, grid: Grid) -> Lattice:
        """The lattice of a grid at its resolution."""
        plant = grid.plant
        span = float(grid.pressure[-1] - grid.pressure[0])
        cells = int(np.ceil(span / grid.resolution.step))
        step = span / cells
        offset = 2 + int(np.ceil(1.5 * max(grid.kappa) * plant.limits.dispenser_flow_max / step))
        vehicle = np.asarray(grid.pressure[0] + step * np.arange(cells + 1))
        top = grid.pressure_max + step
        widest = min(plant.limits.dispenser_flow_max / plant.outlet_coefficient, top - grid.pressure[0])
        gaps = 1 + max(1, int(np.ceil((widest - plant.limits.outlet_gap_min) / step)))
        gap = np.asarray(plant.limits.outlet_gap_min + step * np.arange(gaps))
        least = grid.pressure[0] + plant.limits.outlet_gap_min - offset * step
        buffer = least + step * np.arange(max(int(np.ceil((top - least) / step)) + 1, offset + len(vehicle) + gaps))
        flow = plant.outlet_coefficient * gap
        share = np.linspace(0.0, 1.0, _FLOWS) ** 2
        table = flow[0] + (flow[-1] - flow[0]) * share
        return cls(step, vehicle, gap, np.asarray(flow), np.asarray(buffer), offset, np.asarray(table))
