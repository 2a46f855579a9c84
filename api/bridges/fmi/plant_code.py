"""The plant's second as C: CasADi traces the formulas of station/plants/thesis.py and writes them."""

from __future__ import annotations

import json
from typing import Any

import casadi

from station.geometry import TANKS, VEHICLE
from station.measurement import range_of
from station.parameters import Station
from station.plants.interface import M, P, T
from station.plants.thesis import (
    THESIS,
    PlantConstants,
    buffer_temperature,
    gas_mass,
    gas_pressure,
    inlet_flow,
    next_mass,
    outlet_flow,
    refuse_others,
    vehicle_temperature,
)
from station.quantities import PRESSURE_MAX, VOLUME_MAX
from station.run import PERIOD

STATES = 3 * len(TANKS)


def _second(plant: PlantConstants) -> Any:
    """A second: state (12,), valves (6,) each 0 or 1, and volume [m3] to the next state and the two flows [g/s]."""
    state, valves, volume = casadi.SX.sym("state", STATES), casadi.SX.sym("valves", 6), casadi.SX.sym("volume")
    after = [casadi.SX(0)] * STATES
    compressed, dispensed, outlets = casadi.SX(0), casadi.SX(0), casadi.SX(0)
    for buffer in range(3):
        inlet, outlet, pressure = valves[buffer], valves[3 + buffer], state[P + buffer]
        inflow = inlet * inlet_flow(pressure, plant)
        outflow = outlet * outlet_flow(pressure, state[P + VEHICLE], plant)
        compressed, dispensed, outlets = compressed + inflow, dispensed + outflow, outlets + outlet
        mass = next_mass(state[M + buffer], inflow, outflow, PERIOD)
        temperature = buffer_temperature(buffer, state[T + buffer], inlet, outlet, plant, PERIOD)
        after[P + buffer] = gas_pressure(mass, temperature, plant.buffer_volume[buffer])
        after[T + buffer], after[M + buffer] = temperature, mass
    mass = next_mass(state[M + VEHICLE], dispensed, 0.0, PERIOD)
    temperature = vehicle_temperature(state[T + VEHICLE], outlets, plant, PERIOD)
    after[P + VEHICLE] = gas_pressure(mass, temperature, volume)
    after[T + VEHICLE], after[M + VEHICLE] = temperature, mass
    flows = casadi.vertcat(compressed, dispensed)
    return casadi.Function("second", [state, valves, volume], [casadi.vertcat(*after), flows])


def _held() -> Any:
    """The mass [g] of gas at a pressure [bar] and temperature [deg C] in a volume [m3]."""
    given = [casadi.SX.sym(name) for name in ("pressure", "temperature", "volume")]
    return casadi.Function("held", given, [gas_mass(*given)])


def header_of(station: Station, name: str, token: str, starts: list[float]) -> str:
    """`unit.h` of a station: its names, its start values, and its second in C.

    Raises
    ------
    PlantError
        naming a plant other than the thesis's, whose kernel is no formula that could be traced.
    """
    refuse_others(station.plant, "export as an FMU")
    plant: PlantConstants = THESIS.constants_of(station)
    code = casadi.CodeGenerator("plant", {"with_header": False, "verbose": False})
    sizes = []
    for function in (_second(plant), _held()):
        code.add(function)
        for part in ("arg", "res", "iw", "w"):
            size = max(1, int(getattr(function, f"sz_{part}")()))
            sizes.append(f"#define {function.name().upper()}_SZ_{part.upper()} {size}")
    lines = [
        f"#define UNIT_NAME {json.dumps(name)}",
        f"#define UNIT_TOKEN {json.dumps(token)}",
        f"#define BUFFER_VOLUMES {_braced(plant.buffer_volume)}",
        f"#define STARTS {_braced(starts)}",
        f"#define PRESSURE_MAX {PRESSURE_MAX:g}",
        f"#define TEMPERATURE_MAX {range_of('temperature_vehicle')[1]:g}",
        f"#define VOLUME_MAX {VOLUME_MAX:g}",
        *sizes,
        "#if defined(__GNUC__)",  # of what CasADi writes about a function, the function alone is used
        "#define CASADI_SYMBOL_EXPORT __attribute__((unused)) static",
        "#else",
        "#define CASADI_SYMBOL_EXPORT static",
        "#endif",
    ]
    return "\n".join([*lines, "", code.dump(), ""])


def _braced(values: Any) -> str:
    """Numbers as an initialiser, each with all its digits."""
    return "{" + ", ".join(repr(float(value)) for value in values) + "}"
