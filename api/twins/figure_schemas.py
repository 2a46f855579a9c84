"""The figures of windows of a twin's record as REST answers them."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, Field

from api.twins.day_schemas import FIGURES, figure
from api.twins.window_tally import WINDOW_UNITS
from api.twins.windows import By
from station.shifts import DAY_H

_LOSS_MAX = 1e12

_MORE: dict[str, Any] = {
    "vehicles_connected": figure("vehicles", "Connected in it", 40),
    "state_of_charge_mean": figure("1", "State of charge of the vehicles that left in it, mean", 0.951),
    "state_of_charge_min": figure("1", "The least of these", 0.95),
    "compressor_kwh": figure("kWh", "Electric energy of the compressors", 250.1),
    "precooler_kwh": figure("kWh", "Electric energy of the precooler", 60.1),
    "kwh_per_kg": figure("kWh/kg", "`energy_kwh` by what was dispensed", 1.75),
    "revenue_eur": figure("EUR", "What was dispensed at the tariff's price; null where it has none", 2_125.2),
    "margin_eur": figure("EUR", "Revenue less `total_eur`", 2_039.3, -_LOSS_MAX),
    "occupied_s": figure("s", "Time with a vehicle at the dispenser", 12_100),
    "utilisation": figure("1", "Share of the time with a vehicle at the dispenser", 0.14),
    "availability": figure("1", "Share of the time in which no vehicle at the dispenser was given nothing", 0.99),
    "whole_s": figure("s", "Seconds of it that are kept one by one; if not all are, what needs them is null", 28_800),
    "unread_s": figure("s", "Seconds in which a reading was missing, and the one before was taken", 0),
}


class WindowFigures(BaseModel):
    """Figures of one window; null where there is none, or where the record does not tell it."""

    from_s: Annotated[int, FIGURES["from_s"]]
    to_s: Annotated[int, FIGURES["to_s"]]
    vehicles_arrived: Annotated[int | None, FIGURES["vehicles_arrived"]]
    vehicles_connected: Annotated[int | None, _MORE["vehicles_connected"]]
    vehicles_served: Annotated[int | None, FIGURES["vehicles_served"]]
    vehicles_incomplete: Annotated[int | None, FIGURES["vehicles_incomplete"]]
    vehicles_waiting: Annotated[int | None, FIGURES["vehicles_waiting"]]
    wait_mean_s: Annotated[float | None, FIGURES["wait_mean_s"]]
    wait_p95_s: Annotated[float | None, FIGURES["wait_p95_s"]]
    wait_max_s: Annotated[float | None, FIGURES["wait_max_s"]]
    state_of_charge_mean: Annotated[float | None, _MORE["state_of_charge_mean"]]
    state_of_charge_min: Annotated[float | None, _MORE["state_of_charge_min"]]
    delivered_kg: Annotated[float | None, FIGURES["delivered_kg"]]
    compressor_s: Annotated[int | None, FIGURES["compressor_s"]]
    dispensing_s: Annotated[int | None, FIGURES["dispensing_s"]]
    occupied_s: Annotated[int | None, _MORE["occupied_s"]]
    utilisation: Annotated[float | None, _MORE["utilisation"]]
    availability: Annotated[float | None, _MORE["availability"]]
    energy_kwh: Annotated[float | None, FIGURES["energy_kwh"]]
    compressor_kwh: Annotated[float | None, _MORE["compressor_kwh"]]
    precooler_kwh: Annotated[float | None, _MORE["precooler_kwh"]]
    kwh_per_kg: Annotated[float | None, _MORE["kwh_per_kg"]]
    energy_eur: Annotated[float | None, FIGURES["energy_eur"]]
    demand_eur: Annotated[float | None, FIGURES["demand_eur"]]
    stock_eur: Annotated[float | None, FIGURES["stock_eur"]]
    total_eur: Annotated[float | None, FIGURES["total_eur"]]
    eur_per_kg: Annotated[float | None, FIGURES["eur_per_kg"]]
    revenue_eur: Annotated[float | None, _MORE["revenue_eur"]]
    margin_eur: Annotated[float | None, _MORE["margin_eur"]]
    peak_kw: Annotated[float | None, FIGURES["peak_kw"]]
    compressor_starts: Annotated[int | None, FIGURES["compressor_starts"]]
    refused_valves: Annotated[int | None, FIGURES["refused_valves"]]
    refused: Annotated[dict[str, int] | None, FIGURES["refused"]]
    deadlines_missed: Annotated[int | None, FIGURES["deadlines_missed"]]
    liveness_s: Annotated[int | None, FIGURES["liveness_s"]]
    whole_s: Annotated[int, _MORE["whole_s"]]
    unread_s: Annotated[int, _MORE["unread_s"]]


class TwinFigures(BaseModel):
    """The figures of a stretch of a twin's record, whole or by hour, shift or day."""

    twin: Annotated[str, Field(description="Id of the twin", examples=["demo"])]
    by: Annotated[By, Field(description="What the stretch is cut into", examples=["shift"])]
    shift_h: Annotated[
        int, Field(ge=1, le=DAY_H, description="Length of a shift here", json_schema_extra={"unit": "h"}, examples=[8])
    ]
    units: Annotated[
        dict[str, str], Field(description="Unit of each figure", examples=[{"delivered_kg": "kg", "total_eur": "EUR"}])
    ]
    items: Annotated[list[WindowFigures], Field(description="The windows, in order", examples=[[]])]


UNITS = {name: unit for name, unit in WINDOW_UNITS.items() if name in WindowFigures.model_fields}
"""Unit of each figure of a window but `refused`, whose are counts."""
