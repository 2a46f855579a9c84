"""How temperatures move in a second, and by how much at most."""

from __future__ import annotations

from station.bounds.grid import Grid
from station.bounds.spline import Floats
from station.plants.thesis import exchange_rate


def drift(grid: Grid, heating: float, temperature: Floats) -> Floats:
    """Change of temperature in a second [K] at `heating` [K/s]."""
    found: Floats = heating + exchange_rate(temperature, grid.plant)
    return found


def largest_drift(grid: Grid, heating: float, nodes: Floats) -> float:
    """The largest change of temperature in a second on a domain [K]."""
    plant = grid.plant
    away = max(plant.ambient_temperature - nodes[0], nodes[-1] - plant.ambient_temperature)
    return abs(heating) + plant.heat_exchange * float(away)
