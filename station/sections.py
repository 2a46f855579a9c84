"""The sections of a station file: each parameter once, with type, unit and bounds."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from station.quantities import (
    PRESSURE_MAX,
    Coefficient,
    HeatingRate,
    Part,
    Power,
    Pressure,
    Temperature,
    Volume,
    finite,
)
from station.whole import WHOLE


class Buffer(Part):
    """A cascade buffer."""

    volume_m3: Volume
    initial_pressure_bar: Pressure
    initial_temperature_c: Temperature = 25.0
    inlet_heating_k_per_s: HeatingRate
    outlet_cooling_k_per_s: HeatingRate


class Buffers(Part):
    """The three cascade buffers."""

    high: Buffer
    medium: Buffer
    low: Buffer

    @property
    def all(self) -> tuple[Buffer, Buffer, Buffer]:
        """High, medium, low."""
        return self.high, self.medium, self.low


class Compressor(Part):
    """The compressors, all alike."""

    count: Annotated[
        int, Field(ge=1, le=16, description="n_com of Eq. (7.18); from the fourth on one finds no buffer"), WHOLE
    ] = 1
    pressure_bar: Pressure
    inlet_coefficient_g_per_s_bar: Coefficient
    hold_pressure_bar: Pressure = 800.0
    power_kw: Power | None = None


class Precooler(Part):
    """The precooler, which runs while the dispenser does."""

    power_kw: Power | None = None


class Dispenser(Part):
    """The one dispenser."""

    outlet_coefficient_g_per_s_bar: Coefficient
    flow_max_g_per_s: Annotated[float, finite("g/s", gt=0, le=1000, about="Eq. (7.11)")] = 60.0
    outlet_gap_min_bar: Annotated[float, finite("bar", ge=0, le=PRESSURE_MAX, about="Eq. (7.12)")] = 100.0


class Thermal(Part):
    """Surroundings and buffer limit."""

    ambient_temperature_c: Temperature = 25.0
    heat_exchange_per_s: Annotated[float, finite("1/s", ge=0, le=0.1, about="c_Tn")]
    buffer_temperature_max_c: Temperature


class Slot(Part):
    """Duties of the station under every controller: no vehicle is left waiting for nothing."""

    liveness_s: Annotated[
        float,
        finite(
            "s", ge=0, le=86_400,
            about="Logic's command stands in where a vehicle could be given gas and was given none for so long; 0: "
            "never, and no fill ends incomplete. `liveness_s` of a controller's settings goes before",
        ),
    ] = 600.0  # fmt: skip
    incomplete_s: Annotated[
        float,
        finite(
            "s", gt=0, le=86_400,
            about="A fill ends incomplete where nothing can be given for so long and the best gap does not grow",
        ),
    ] = 1200.0  # fmt: skip
    emptiest_bar: (
        Annotated[
            float,
            finite(
                "bar", ge=0, le=PRESSURE_MAX,
                about="The emptiest vehicle that may come: where liveness is on, one buffer is not filled so far that "
                "the dispenser's greatest flow would keep such a vehicle from it; left out: where a scenario's fleet "
                "or trace has vehicles emptier than the usual ones, the emptiest of these, else none",
            ),
        ]
        | None
    ) = None  # fmt: skip


class VehicleType(Part):
    """The usual vehicle: what arrives when a scenario does not say otherwise."""

    volume_m3: Volume
    start_pressure_bar: Pressure
    start_pressure_spread_bar: Annotated[
        float, finite("bar", ge=0, le=PRESSURE_MAX, about="Half-width of the uniform law of replications >= 1")
    ] = 0.0
    start_temperature_c: Temperature = 25.0
    finish_pressure_bar: Pressure
    heating_k_per_s: HeatingRate
    temperature_max_c: Temperature = 80.0

    @property
    def start_range(self) -> tuple[float, float]:
        """The pressures with which usual vehicles come, from and to [bar]."""
        return (
            self.start_pressure_bar - self.start_pressure_spread_bar,
            self.start_pressure_bar + self.start_pressure_spread_bar,
        )

    @model_validator(mode="after")
    def _fills(self) -> VehicleType:
        if self.start_pressure_bar - self.start_pressure_spread_bar <= 0:
            raise ValueError("start_pressure_spread_bar must stay below start_pressure_bar: a tank is never empty")
        if self.start_pressure_bar + self.start_pressure_spread_bar >= self.finish_pressure_bar:
            raise ValueError(
                f"finish_pressure_bar must exceed every start pressure "
                f"({self.start_pressure_bar + self.start_pressure_spread_bar:g} bar)"
            )
        if self.start_temperature_c > self.temperature_max_c:
            raise ValueError(f"start_temperature_c must not exceed temperature_max_c = {self.temperature_max_c:g} degC")
        return self


PredictionError = Annotated[float, finite("bar", ge=0, le=2000, about="RMS error")]


class ControlModelFigures(Part):
    """The figures that controllers plan with in place of those of the thesis's equations; see `ControlModel`.

    Volumes, limits, ramp and nozzle are the station's own.
    """

    driving_pressure_bar: Annotated[
        float, finite("bar", gt=0, le=20_000, about="p0, at which the compressor's flow would vanish")
    ]
    inlet_coefficient_g_per_s_bar: Coefficient
    outlet_coefficient_g_per_s_bar: Annotated[float, finite("g/(s bar)", gt=0, le=1000, about="Flow per bar")]
    inlet_heating_k_per_s: Annotated[list[HeatingRate], Field(min_length=3, max_length=3, description="By buffer")]
    outlet_cooling_k_per_s: Annotated[list[HeatingRate], Field(min_length=3, max_length=3, description="By buffer")]
    heat_exchange_per_s: Annotated[float, finite("1/s", ge=0, le=0.1, about="c_Tn of the buffers")]
    covolume_l_per_kg: Annotated[float, finite("L/kg", ge=0, le=20, about="b of p = m R T / (V - m b)")]
    delivered_k: Annotated[
        float, finite("K", gt=0, le=1000, about="Of a vehicle warmed by nothing but the gas it is given")
    ]
    wall_conductance_g_per_s_m3: Annotated[
        float, finite("g/(s m3)", ge=0, le=1e5, about="Heat that its tank takes, over c_v, a cubic metre of it")
    ]
    buffer_errors_bar: list[PredictionError] = Field(
        [], max_length=3, description="RMS of its predictions on days held out, after 60, 300, 900 s"
    )
    vehicle_errors_bar: list[PredictionError] = Field(
        [], max_length=3, description="The same of the vehicle, after 60, 120, 180 s"
    )
