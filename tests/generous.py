"""A station whose service takes few cells to prove."""

from __future__ import annotations

from station import Station, load_station

GENEROUS = {"volume": 3.0, "inlet_heating": 0.03, "outlet_cooling": 0.01, "vehicle_heating": 0.12, "compressor": 2.0}


def generous() -> Station:
    """thesis-fit with more storage, cooled inlets and twice the compressor."""
    given = load_station("thesis-fit").model_dump()
    given["name"] = "generous"
    for buffer in given["buffers"].values():
        buffer["volume_m3"] *= GENEROUS["volume"]
        buffer["inlet_heating_k_per_s"] = GENEROUS["inlet_heating"]
        buffer["outlet_cooling_k_per_s"] = GENEROUS["outlet_cooling"]
    given["vehicle"]["heating_k_per_s"] = GENEROUS["vehicle_heating"]
    given["compressor"]["inlet_coefficient_g_per_s_bar"] *= GENEROUS["compressor"]
    return Station.model_validate(given)
