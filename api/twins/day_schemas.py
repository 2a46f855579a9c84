"""The days of a twin as REST answers them."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, Field

from api.twins.days import DAY_S, DAYS_MAX


def figure(unit: str, about: str, example: Any, ge: float = 0) -> Any:
    """A figure of an answer: its unit, what it is, an example, and the least that it can be."""
    return Field(ge=ge, description=about, json_schema_extra={"unit": unit}, examples=[example])


FIGURES: dict[str, Any] = {
    "day": figure("index", "Number of the day; the first is 0", 3),
    "from_s": figure("s", "First second counted, simulated", 259_200),
    "to_s": figure("s", "End of the last second counted, simulated", 345_600),
    "vehicles_arrived": figure("vehicles", "Arrived in it", 40),
    "vehicles_served": figure("vehicles", "Left in it with a full tank", 39),
    "vehicles_incomplete": figure(
        "vehicles",
        "Left in it before their tanks were full, since nothing could be given any more or they were too warm",
        0,
    ),
    "vehicles_waiting": figure("vehicles", "Waited in its last second", 1),
    "wait_mean_s": figure("s", "Mean wait of the vehicles connected in it; null where none was", 84.5),
    "wait_p95_s": figure("s", "95 % of them waited at most so long", 310.0),
    "wait_max_s": figure("s", "Longest of these waits", 352.0),
    "delivered_kg": figure("kg", "Hydrogen dispensed", 177.1),
    "compressor_s": figure("s", "Compressor-seconds", 13_356),
    "dispensing_s": figure("s", "Time with an outlet open", 10_913),
    "energy_kwh": figure("kWh", "Of compressor and precooler; null where the station has no powers", 310.2),
    "energy_eur": figure("EUR", "Of that energy at the price of its time; null where the station has no tariff", 55.8),
    "demand_eur": figure("EUR", "Charge on `peak_kw` for the length of time counted", 30.1),
    "stock_eur": figure(
        "EUR", "To buy back what buffers are short of their masses at its begin; null where nothing can", 0.0
    ),
    "total_eur": figure("EUR", "Sum of these three", 85.9),
    "eur_per_kg": figure("EUR/kg", "The sum by what was dispensed; null where nothing was", 0.49),
    "peak_kw": figure("kW", "Highest mean power of a quarter of an hour, from its begin", 92.0),
    "compressor_starts": figure("1", "How often a compressor started", 61),
    "refused_valves": figure("1", "Valves that a limit kept closed, summed over the seconds", 1_240),
    "refused": Field(
        description="The same by limit",
        json_schema_extra={"unit": "1"},
        examples=[{"flow": 0, "gap": 1_200, "hold": 40}],
    ),
    "deadlines_missed": figure("1", "Seconds in which logic decided for a late controller", 0),
    "liveness_s": figure("s", "Time in which a liveness rule decided: a vehicle had been given nothing", 0),
}
"""Unit, meaning and an example of each figure of a day; of other stretches, too."""


class TwinDay(BaseModel):
    """Figures of one day of a twin, as metrics of the record of these seconds give them."""

    day: Annotated[int, FIGURES["day"]]
    from_s: Annotated[int, FIGURES["from_s"]]
    to_s: Annotated[int, FIGURES["to_s"]]
    vehicles_arrived: Annotated[int, FIGURES["vehicles_arrived"]]
    vehicles_served: Annotated[int, FIGURES["vehicles_served"]]
    vehicles_incomplete: Annotated[int, FIGURES["vehicles_incomplete"]]
    vehicles_waiting: Annotated[int, FIGURES["vehicles_waiting"]]
    wait_mean_s: Annotated[float | None, FIGURES["wait_mean_s"]]
    wait_p95_s: Annotated[float | None, FIGURES["wait_p95_s"]]
    wait_max_s: Annotated[float | None, FIGURES["wait_max_s"]]
    delivered_kg: Annotated[float, FIGURES["delivered_kg"]]
    compressor_s: Annotated[int, FIGURES["compressor_s"]]
    dispensing_s: Annotated[int, FIGURES["dispensing_s"]]
    energy_kwh: Annotated[float | None, FIGURES["energy_kwh"]]
    energy_eur: Annotated[float | None, FIGURES["energy_eur"]]
    demand_eur: Annotated[float | None, FIGURES["demand_eur"]]
    stock_eur: Annotated[float | None, FIGURES["stock_eur"]]
    total_eur: Annotated[float | None, FIGURES["total_eur"]]
    eur_per_kg: Annotated[float | None, FIGURES["eur_per_kg"]]
    peak_kw: Annotated[float | None, FIGURES["peak_kw"]]
    compressor_starts: Annotated[int, FIGURES["compressor_starts"]]
    refused_valves: Annotated[int, FIGURES["refused_valves"]]
    refused: Annotated[dict[str, int], FIGURES["refused"]]
    deadlines_missed: Annotated[int, FIGURES["deadlines_missed"]]
    liveness_s: Annotated[int, FIGURES["liveness_s"]]


class TwinDays(BaseModel):
    """The days of a twin, the oldest first; the last is the running one."""

    day_s: Annotated[
        int,
        Field(
            ge=1, description="Length of a day, counted from the twin's start", json_schema_extra={"unit": "s"},
            examples=[DAY_S],
        ),
    ]  # fmt: skip
    items: Annotated[
        list[TwinDay],
        Field(description=f"At most {DAYS_MAX} past days and the running one; older ones are events", examples=[[]]),
    ]
