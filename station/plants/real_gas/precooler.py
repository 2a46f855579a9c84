"""A precooler: a cold block that the gas passes through, and the refrigerator that cools it again."""

from __future__ import annotations

from typing import NamedTuple

from station.compiled import uncounted
from station.plants.real_gas.gas import enthalpy
from station.plants.real_gas.tables import GasTables


class Precooler(NamedTuple):
    """A precooler as kernels use it."""

    capacity: float  # heat capacity of the block [J/K]
    set_point: float  # [K]
    effectiveness: float  # share of the enthalpy difference to the block that the gas gives up
    refrigeration: float  # heat that the refrigerator can take out [W]
    performance: float  # heat taken out over electric power
    leak: float  # from the surroundings [W/K]
    warmer: float = 0.0  # by so much the gas meets more than the block's temperature: a fault [K]


@uncounted
def cooled(h: float, p: float, block: float, unit: Precooler, gas: GasTables) -> float:
    """Enthalpy [J/kg] behind the precooler of gas that came with `h` and leaves at the nozzle's pressure `p` [Pa]."""
    return h - unit.effectiveness * (h - enthalpy(p, block + unit.warmer, gas))


@uncounted
def block_after(
    block: float, heat: float, surroundings: float, period: float, unit: Precooler
) -> tuple[float, float, float]:
    """The block's temperature a period on [K], heat that leaked in and heat that the refrigerator took out [J].

    `heat` [J] came from the gas. The refrigerator takes what brings the block to its set point, as far as it can.
    """
    leaked = unit.leak * (surroundings - block) * period
    warm = unit.capacity * (block - unit.set_point) + heat + leaked
    taken = min(max(warm, 0.0), unit.refrigeration * period)
    return block + (heat + leaked - taken) / unit.capacity, leaked, taken
