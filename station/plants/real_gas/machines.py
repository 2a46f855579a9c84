"""The machines of a station: banks after the data file machines.toml, all else as its section says."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from station.geometry import KELVIN
from station.plants.real_gas.compressor import Compressor, compressor_of
from station.plants.real_gas.hydrogen import BAR, load_data
from station.plants.real_gas.layout import Line
from station.plants.real_gas.precooler import Precooler
from station.plants.real_gas.tank import Shape, Tank, tank_of
from station.plants.real_gas.wall import Layer

if TYPE_CHECKING:
    from station.plants.real_gas.options import CompressorOptions, DispensingOptions, PrecoolerOptions

_MACHINES: dict[str, Any] = load_data("machines.toml")


def bank_of(volume: float, period: float) -> Tank:
    """A steel bank of a volume [m3] for steps of one period [s]; one cell of wall, which costs 0.1 K."""
    data = _MACHINES["bank"]
    diameter = data["inner_diameter_m"]
    steel = Layer(
        "steel", data["thickness_m"], data["density_kg_m3"], data["heat_capacity_J_kgK"], data["conductivity_W_mK"]
    )
    shape = Shape(volume, diameter, volume / (math.pi / 4 * diameter**2))
    return tank_of(shape, [steel], data["outer_coefficient_W_m2K"], period, cells_per_layer=1)


@lru_cache(maxsize=64)
def compressor_with(given: CompressorOptions, ambient: float) -> Compressor:
    """The compressor of a section at an ambient temperature [K]."""
    return compressor_of(
        given.displacement_m3_per_h / 3600, given.suction_bar * BAR, given.suction_c + KELVIN, given.clearance,
        given.stages, given.efficiency, given.pressure_max_bar * BAR, ambient + given.aftercooler_approach_k,
    )  # fmt: skip


def precooler_with(given: PrecoolerOptions) -> Precooler:
    """The precooler of a section."""
    return Precooler(
        given.block_mass_kg * _MACHINES["precooler"]["block_heat_capacity_J_kgK"], given.set_point_c + KELVIN,
        given.effectiveness, given.refrigeration_kw * 1e3, given.performance, given.leak_w_per_k, 0.0,
    )  # fmt: skip


def line_with(given: DispensingOptions) -> Line:
    """The valves, line and nozzle of a section."""
    return Line(
        given.valve_mm2 * 1e-6, given.line_l * 1e-3, _MACHINES["line"]["vent_pressure_MPa"] * 1e6,
        given.flow_max_g_per_s * 1e-3,
    )  # fmt: skip
