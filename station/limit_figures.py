"""The figures of a station that its limits are: each once, with its unit and the parameter it comes from.

Constants of every plant, and of the model that controllers have, hold them as `limits`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from station.geometry import KELVIN


class LimitFigures(NamedTuple):
    """The figures that margins of limits compare with."""

    buffer_temperature_max: float  # T_bmax of Eq. (7.15) [deg C]
    vehicle_temperature_max: float  # T_Vmax of Eq. (7.13) [deg C]
    dispenser_flow_max: float  # of Eq. (7.11); infinite: no limit [g/s]
    outlet_gap_min: float  # p_dref of Eq. (7.12) [bar]
    hold_pressure: float  # threshold of Eq. (7.16); infinite: no limit [bar]
    buffer_temperature_min: float  # nothing flows out of a colder buffer; -273.15: no limit [deg C]


def limit_figures(station: Any) -> LimitFigures:
    """The figures that the sections of a `station.parameters.Station` say, each in the unit of its field."""
    return LimitFigures(
        buffer_temperature_max=station.thermal.buffer_temperature_max_c,
        vehicle_temperature_max=station.vehicle.temperature_max_c,
        dispenser_flow_max=station.dispenser.flow_max_g_per_s,
        outlet_gap_min=station.dispenser.outlet_gap_min_bar,
        hold_pressure=station.compressor.hold_pressure_bar,
        buffer_temperature_min=-KELVIN if station.real_gas is None else station.real_gas.bank_temperature_min_c,
    )
