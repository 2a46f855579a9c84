"""The data file of hydrogen as numbers: equation of state and transport properties, with their sources."""

from __future__ import annotations

import tomllib
from importlib.resources import files
from typing import Any

import numpy as np

DATA = files("station") / "data" / "real_gas"
"""Where the data files of this room are."""


def load_data(name: str) -> dict[str, Any]:
    """The tables of the data file `name`, one that ships with the package."""
    return tomllib.loads((DATA / name).read_text(encoding="utf-8"))


HYDROGEN = load_data("hydrogen.toml")
_STATE = HYDROGEN["state"]

BAR = 1e5
"""[Pa]"""

MOLAR_MASS: float = _STATE["molar_mass_kg_mol"]
"""Of hydrogen [kg/mol]."""

SPECIFIC_GAS: float = _STATE["gas_constant_J_molK"] / MOLAR_MASS
"""Gas constant R / M of Leachman's equation [J/(kg K)]."""

CRITICAL_TEMPERATURE: float = _STATE["critical_temperature_K"]
"""[K]"""

CRITICAL_DENSITY: float = _STATE["critical_density_mol_L"] * 1e3 * MOLAR_MASS
"""[kg/m3]"""

RESIDUAL: dict[str, np.ndarray] = {name: np.array(row, float) for name, row in _STATE["residual"].items()}
"""Coefficients of the 14 residual terms, by their names in the paper's Eq. (32)."""

IDEAL: dict[str, Any] = _STATE["ideal"]
"""Coefficients of the ideal part, the paper's Eq. (31)."""
