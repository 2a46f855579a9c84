"""The variables of an exported unit: names, units, value references, and what each is for."""

from __future__ import annotations

from typing import NamedTuple

from station.geometry import BUFFERS, TANKS, VALVES


class Variable(NamedTuple):
    """A variable; its place in `VARIABLES` is its value reference."""

    name: str
    causality: str  # input, output, parameter
    unit: str  # as units are named in a model description; empty for a Boolean
    about: str


VARIABLES = (
    *(Variable(name, "input", "", "whether the valve is open") for name in VALVES),
    Variable("vehicle", "input", "", "whether a vehicle is connected; one begins when this becomes true"),
    Variable("vehicle_start_pressure", "input", "bar", "of the vehicle that begins"),
    Variable("vehicle_start_temperature", "input", "degC", "of the vehicle that begins"),
    Variable("vehicle_volume", "input", "m3", "of its tank"),
    *(Variable(f"pressure_{tank}", "output", "bar", "of the gas; 0 of no vehicle") for tank in TANKS),
    *(Variable(f"temperature_{tank}", "output", "degC", "of the gas; 0 of no vehicle") for tank in TANKS),
    *(Variable(f"mass_{tank}", "output", "g", "of the gas; 0 of no vehicle") for tank in TANKS),
    Variable("flow_compressor", "output", "g/s", "out of the compressors, mean of the last second"),
    Variable("flow_dispenser", "output", "g/s", "to the vehicle, mean of the last second"),
    *(Variable(f"initial_pressure_{buffer}", "parameter", "bar", "of the buffer at the start") for buffer in BUFFERS),
    *(Variable(f"initial_temperature_{each}", "parameter", "degC", "of the buffer at the start") for each in BUFFERS),
)  # fmt: skip
"""Every variable, Booleans first."""

BOOLEANS = 7
"""So many of the first are Boolean; all others are real."""

FACTORS = {"bar": (1e5, 0.0), "degC": (1.0, 273.15), "m3": (1.0, 0.0), "g": (1e-3, 0.0), "g/s": (1e-3, 0.0)}
"""Factor and offset from each unit to its base."""
