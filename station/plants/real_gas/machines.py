"""The usual machines of a station, from the data file machines.toml: banks, compressor, precooler, line."""

from __future__ import annotations

import math
from typing import Any

from station.geometry import KELVIN
from station.plants.real_gas.compressor import Compressor, compressor_of
from station.plants.real_gas.hydrogen import load_data
from station.plants.real_gas.layout import Line
from station.plants.real_gas.precooler import Precooler
from station.plants.real_gas.tank import Shape, Tank, tank_of
from station.plants.real_gas.wall import Layer

_MACHINES: dict[str, Any] = load_data("machines.toml")


def usual_bank(volume: float, period: float) -> Tank:
    """A steel bank of a volume [m3] for steps of one period [s]; one cell of wall, which costs 0.1 K."""
    data = _MACHINES["bank"]
    diameter = data["inner_diameter_m"]
    steel = Layer(
        "steel", data["thickness_m"], data["density_kg_m3"], data["heat_capacity_J_kgK"], data["conductivity_W_mK"]
    )
    shape = Shape(volume, diameter, volume / (math.pi / 4 * diameter**2))
    return tank_of(shape, [steel], data["outer_coefficient_W_m2K"], period, cells_per_layer=1)


def usual_compressor(ambient: float) -> Compressor:
    """The usual compressor; its aftercooler brings the gas near the ambient temperature [K]."""
    data = _MACHINES["compressor"]
    return compressor_of(
        data["displacement_m3_h"] / 3600,
        data["suction_pressure_MPa"] * 1e6,
        data["suction_temperature_C"] + KELVIN,
        data["clearance"],
        data["stages"],
        data["efficiency"],
        data["pressure_max_MPa"] * 1e6,
        ambient + data["aftercooler_approach_K"],
    )


def usual_precooler() -> Precooler:
    """The usual precooler."""
    data = _MACHINES["precooler"]
    return Precooler(
        data["block_mass_kg"] * data["block_heat_capacity_J_kgK"],
        data["set_point_C"] + KELVIN,
        data["effectiveness"],
        data["refrigeration_kW"] * 1e3,
        data["coefficient_of_performance"],
        data["leak_W_K"],
    )


def usual_line(flow_max: float) -> Line:
    """The usual valves and line, with a nozzle's limit of flow [kg/s]."""
    data = _MACHINES["line"]
    return Line(data["valve_mm2"] * 1e-6, data["volume_L"] * 1e-3, data["vent_pressure_MPa"] * 1e6, flow_max)
