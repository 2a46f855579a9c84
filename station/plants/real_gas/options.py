"""The section `real_gas` of a station file: what the faithful plant needs besides the parameters of every station.

Volumes and initial states of the banks, the number of compressors, the least gap of an outlet, temperatures and the
usual vehicle stand where they stand for every station. What is left out here is that of the data files of this room.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from station.plants.real_gas.catalog import DISPENSING
from station.plants.real_gas.hydrogen import BAR, load_data
from station.plants.real_gas.tables import PRESSURE_MAX
from station.whole import WHOLE

_MACHINES = load_data("machines.toml")
_COMPRESSOR, _PRECOOLER, _LINE = (_MACHINES[name] for name in ("compressor", "precooler", "line"))
_TOP = PRESSURE_MAX / BAR  # [bar]


def _figure(unit: str, about: str, *, gt: float | None = None, ge: float | None = None, le: float | None = None) -> Any:
    return Field(gt=gt, ge=ge, le=le, allow_inf_nan=False, description=about, json_schema_extra={"unit": unit})


class Section(BaseModel):
    """A group of figures; unknown fields are errors, and so are texts where numbers belong."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


_Greatest = Annotated[float, _figure("bar", "The bank is filled up to here", gt=0, le=_TOP)]


class BankPressures(Section):
    """The greatest pressure of each bank."""

    high: _Greatest
    medium: _Greatest
    low: _Greatest


_Least = Annotated[float, _figure("bar", "Nothing flows out of the bank below; 0: no limit", ge=0, le=_TOP)]


class LeastPressures(Section):
    """The least pressure of each bank."""

    high: _Least = 0.0
    medium: _Least = 0.0
    low: _Least = 0.0


class CompressorOptions(Section):
    """The compressors, all alike."""

    suction_bar: Annotated[float, _figure("bar", "Pressure of the source", gt=0, le=_TOP)] = (
        _COMPRESSOR["suction_pressure_MPa"] * 10
    )
    suction_c: Annotated[float, _figure("degC", "Temperature of the source", ge=-50, le=60)] = _COMPRESSOR[
        "suction_temperature_C"
    ]
    displacement_m3_per_h: Annotated[
        float, _figure("m3/h", "Swept volume flow of the first stage", ge=1e-3, le=10_000)
    ] = _COMPRESSOR["displacement_m3_h"]
    clearance: Annotated[float, _figure("1", "Volume left at a stroke's end by the swept one", ge=0, le=0.5)] = (
        _COMPRESSOR["clearance"]
    )
    stages: Annotated[int, Field(ge=1, le=8, description="Of equal ratio"), WHOLE] = _COMPRESSOR["stages"]
    efficiency: Annotated[float, _figure("1", "Isentropic over electric work", gt=0, le=1)] = _COMPRESSOR["efficiency"]
    aftercooler_approach_k: Annotated[float, _figure("K", "Gas behind it over the surroundings", ge=0, le=60)] = (
        _COMPRESSOR["aftercooler_approach_K"]
    )
    pressure_max_bar: Annotated[float, _figure("bar", "It stops there", gt=0, le=_TOP)] = (
        _COMPRESSOR["pressure_max_MPa"] * 10
    )

    @model_validator(mode="after")
    def _compresses(self) -> CompressorOptions:
        if self.suction_bar >= self.pressure_max_bar:
            most = self.pressure_max_bar
            raise ValueError(f"suction_bar must lie below pressure_max_bar = {most:g} bar; given {self.suction_bar:g}")
        return self


class PrecoolerOptions(Section):
    """The precooler: a block that the gas passes through, and its refrigerator."""

    block_mass_kg: Annotated[float, _figure("kg", "Of aluminium", ge=1, le=1e5)] = _PRECOOLER["block_mass_kg"]
    set_point_c: Annotated[float, _figure("degC", "The block is cooled down to here", ge=-60, le=40)] = _PRECOOLER[
        "set_point_C"
    ]
    effectiveness: Annotated[float, _figure("1", "Share of the enthalpy difference given up", ge=0, le=1)] = _PRECOOLER[
        "effectiveness"
    ]
    refrigeration_kw: Annotated[float, _figure("kW", "Heat that can be taken out", ge=0, le=1e4)] = _PRECOOLER[
        "refrigeration_kW"
    ]
    performance: Annotated[float, _figure("1", "Heat taken out over electric power", gt=0, le=10)] = _PRECOOLER[
        "coefficient_of_performance"
    ]
    leak_w_per_k: Annotated[float, _figure("W/K", "From the surroundings", ge=0, le=1e4)] = _PRECOOLER["leak_W_K"]


_RAMP: Any = {"ge": DISPENSING["limits"]["ramp_min_MPa_min"], "le": DISPENSING["limits"]["ramp_max_MPa_min"]}
_LITRES_MAX = 1e6  # no tank is larger [L]
_Volumes = Annotated[
    list[Annotated[float, Field(ge=1, le=_LITRES_MAX, allow_inf_nan=False)]], Field(min_length=1, max_length=64)
]
_Starts = Annotated[
    list[Annotated[float, Field(gt=0, le=_TOP, allow_inf_nan=False)]], Field(min_length=1, max_length=64)
]


class RampTableOptions(Section):
    """Ramps by the volume of a tank and its pressure at the start; the last row and column hold beyond their edge."""

    volume_l: Annotated[_Volumes, Field(description="Each row holds up to here", json_schema_extra={"unit": "L"})]
    start_bar: Annotated[_Starts, Field(description="Each column holds up to here", json_schema_extra={"unit": "bar"})]
    ramp_mpa_per_min: Annotated[
        list[list[Annotated[float, Field(allow_inf_nan=False, **_RAMP)]]],
        Field(description="A row for each volume", json_schema_extra={"unit": "MPa/min"}),
    ]

    @model_validator(mode="after")
    def _fits(self) -> RampTableOptions:
        for name in ("volume_l", "start_bar"):
            edges = getattr(self, name)
            if any(low >= high for low, high in pairwise(edges)):
                raise ValueError(f"{name} must increase; given {edges}")
        shape = [len(row) for row in self.ramp_mpa_per_min]
        if shape != [len(self.start_bar)] * len(self.volume_l):
            raise ValueError(
                f"ramp_mpa_per_min must have {len(self.volume_l)} rows of {len(self.start_bar)} ramps, as volume_l and "
                f"start_bar have edges; given rows of {shape}"
            )
        return self


class DispensingOptions(Section):
    """Valves, line and nozzle, and how a fill goes and ends."""

    valve_mm2: Annotated[float, _figure("mm2", "Effective area of each outlet", ge=0.01, le=1e4)] = _LINE["valve_mm2"]
    line_l: Annotated[float, _figure("L", "Volume between precooler and vehicle", ge=1e-3, le=100)] = _LINE["volume_L"]
    flow_max_g_per_s: Annotated[float, _figure("g/s", "The nozzle's limit, which saturates", ge=0.1, le=1000)] = (
        DISPENSING["limits"]["flow_max_g_s"]
    )
    ramp_mpa_per_min: Annotated[
        float,
        _figure("MPa/min", "Of the vehicle's pressure; the greatest where one is chosen or given by a table", **_RAMP),
    ]
    ramp_choice: Annotated[
        Literal["fixed", "auto"],
        Field(description="auto: the largest with which the worst tank for all that is known stays below 85 degC"),
    ] = "fixed"
    ramp_table: Annotated[
        RampTableOptions | None,
        Field(exclude_if=lambda given: given is None, description="Ramps of one's own instead of a fixed one"),
    ] = None
    target_percent: Annotated[float, _figure("%", "State of charge that ends a fill", gt=0, le=100)] = DISPENSING[
        "usual"
    ]["target_percent"]
    tank_max_l: Annotated[
        float, _figure("L", "A vehicle that holds more has several such tanks side by side", ge=20, le=3000)
    ] = DISPENSING["usual"]["tank_max_L"]
    tank_35: Annotated[
        Literal["type1", "type3", "type4"], Field(description="Class of tanks of up to 50 MPa nominal pressure")
    ] = "type3"
    tank_70: Annotated[Literal["type1", "type3", "type4"], Field(description="Class of the others")] = "type4"

    @model_validator(mode="after")
    def _one_ramp(self) -> DispensingOptions:
        if self.ramp_choice == "auto" and self.ramp_table is not None:
            raise ValueError("ramp_table must be left out with ramp_choice = 'auto'")
        return self


class RealGasOptions(Section):
    """Options that the faithful plant needs."""

    bank_pressure_max_bar: BankPressures
    bank_pressure_min_bar: LeastPressures = LeastPressures()
    bank_temperature_min_c: Annotated[
        float, _figure("degC", "Nothing flows out of a bank that is as cold", ge=-100, le=20)
    ] = -40.0
    minimum_on_s: Annotated[
        float, _figure("s", "A valve stays open so long, unless a limit closes it", ge=0, le=600)
    ] = 0.0
    minimum_off_s: Annotated[float, _figure("s", "A valve stays closed so long", ge=0, le=600)] = 0.0
    compressor: CompressorOptions = CompressorOptions()
    precooler: PrecoolerOptions = PrecoolerOptions()
    dispensing: DispensingOptions

    @model_validator(mode="after")
    def _within(self) -> RealGasOptions:
        for name, top in self.bank_pressure_max_bar:
            if top > self.compressor.pressure_max_bar:
                raise ValueError(
                    f"bank_pressure_max_bar.{name} must not exceed compressor.pressure_max_bar = "
                    f"{self.compressor.pressure_max_bar:g} bar; given {top:g}"
                )
            least = getattr(self.bank_pressure_min_bar, name)
            if least >= top:
                raise ValueError(
                    f"bank_pressure_min_bar.{name} must lie below bank_pressure_max_bar.{name} = {top:g} bar; "
                    f"given {least:g}"
                )
        return self
