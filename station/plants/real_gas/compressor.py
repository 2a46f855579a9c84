"""A compressor: flow from its suction state, stages and volumetric efficiency, power from the isentropic work."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from station.compiled import uncounted
from station.plants.real_gas.leachman import Array, density, isentropic_enthalpy, properties
from station.plants.real_gas.tables import PRESSURE_MAX

_NODES = 257
_EXPANSION = 1 / 1.41
"""Of the gas that is left in the clearance: isentropic, the ideal gas' exponent."""


class Compressor(NamedTuple):
    """A compressor as kernels use it."""

    displacement: float  # swept volume flow at the suction [m3/s]
    density: float  # at the suction [kg/m3]
    enthalpy: float  # at the suction [J/kg]
    pressure: float  # at the suction [Pa]
    clearance: float  # share of the swept volume
    stages: int
    efficiency: float  # overall: isentropic work over electric work
    pressure_max: float  # it stops there [Pa]
    delivery: float  # of the gas behind the aftercooler [K]
    work: Array  # isentropic work [J/kg] at pressures from the suction's to the table's end, equally far apart
    work_scale: float  # nodes per Pa


def isentropic_work(suction: float, kelvin: float, pressure: Array, stages: int) -> Array:
    """Work [J/kg] from a suction state [Pa], [K] to pressures [Pa]: stages of equal ratio, each from `kelvin` again."""
    ratio = (pressure / suction) ** (1 / stages)
    total = np.zeros(pressure.shape)
    for stage in range(stages):
        low = suction * ratio**stage
        before = properties(density(low, kelvin), kelvin)
        total += isentropic_enthalpy(low * ratio, before.entropy) - before.enthalpy
    return total


def compressor_of(
    displacement: float, suction: float, kelvin: float, clearance: float, stages: int, efficiency: float,
    pressure_max: float, delivery: float,
) -> Compressor:  # fmt: skip
    """A compressor.

    Parameters
    ----------
    displacement
        Swept volume flow of its first stage [m3/s].
    suction, kelvin
        Pressure [Pa] and temperature [K] of the source.
    clearance
        Volume left at the end of a stroke, as a share of the swept volume.
    stages
        Of equal ratio, cooled back to the suction's temperature between them.
    efficiency
        Isentropic over electric work.
    pressure_max
        Where it stops [Pa].
    delivery
        Temperature behind the aftercooler [K].
    """
    pressure = np.linspace(suction, PRESSURE_MAX, _NODES)
    before = properties(density(suction, kelvin), kelvin)
    return Compressor(
        displacement, float(density(suction, kelvin)), float(before.enthalpy), suction, clearance, stages, efficiency,
        pressure_max, delivery, isentropic_work(suction, kelvin, pressure, stages), 1 / (pressure[1] - pressure[0]),
    )  # fmt: skip


@uncounted
def compressor_flow(p: float, unit: Compressor) -> float:
    """Flow [kg/s] against a pressure [Pa]: displacement, suction density, and what the clearance's gas leaves free."""
    if p >= unit.pressure_max:
        return 0.0
    expanded = max(p / unit.pressure, 1.0) ** (_EXPANSION / unit.stages)  # of a stage's clearance, in its volumes
    filled = 1.0 - unit.clearance * (expanded - 1.0)
    return unit.displacement * unit.density * max(filled, 0.0)


@uncounted
def compressor_work(p: float, unit: Compressor) -> float:
    """Electric work [J/kg] against a pressure [Pa]; below the suction's the gas flows by itself."""
    place = (p - unit.pressure) * unit.work_scale
    if place <= 0.0:
        return 0.0
    node = min(int(place), unit.work.shape[0] - 2)
    part = place - node
    return ((1.0 - part) * unit.work[node] + part * unit.work[node + 1]) / unit.efficiency
