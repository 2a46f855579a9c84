"""Tables of a gas whose molecules have a volume (Abel and Noble), in place of those of hydrogen: another form."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from station.plants.real_gas import leachman, tables
from station.plants.real_gas.tables import GasTables

COVOLUME = 7.69e-3  # [m3/kg]
R = leachman.SPECIFIC_GAS


def _properties(rho: Any, kelvin: Any) -> Any:
    rho, kelvin = np.broadcast_arrays(np.asarray(rho, float), np.asarray(kelvin, float))
    thin = leachman.properties(np.full(rho.shape, 1e-6), kelvin)
    pressure = rho * R * kelvin / (1 - COVOLUME * rho)
    return thin._replace(
        pressure=pressure, enthalpy=thin.internal_energy + pressure / rho, expansion=(1 - COVOLUME * rho) / kelvin,
        heat_capacity_pressure=thin.heat_capacity_volume + R,
    )  # fmt: skip


def abel_noble_tables() -> GasTables:
    """Tables with p = rho R T / (1 - b rho), whose energy is that of thin hydrogen; its choked flux is hydrogen's."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tables, "properties", _properties)
        patch.setattr(tables, "density", lambda p, kelvin: np.maximum(p, 1.0) / (R * kelvin + COVOLUME * p))
        patch.setattr(
            tables, "temperature_of_energy",
            lambda rho, u: leachman.temperature_of_energy(1e-6 + 0 * np.asarray(rho), u),
        )  # fmt: skip
        return tables.gas_tables.__wrapped__()
