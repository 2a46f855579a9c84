"""A station: its sections, what must hold between them, and the constants that plants and controllers have of it."""

from __future__ import annotations

import json
import math
from functools import cache
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field, field_validator, model_validator

from station.alarm_rules import AlarmRule, check_rules
from station.control_model import ControlModel, thesis_model
from station.geometry import BUFFERS, KELVIN, BufferName
from station.limit_figures import limit_figures
from station.plants.interface import plant_named
from station.plants.real_gas.compressor import isentropic_work
from station.plants.real_gas.hydrogen import BAR
from station.plants.real_gas.options import RealGasOptions
from station.plants.real_gas.ramp_table import NOMINAL_BAR
from station.plants.real_gas.registration import REAL_GAS
from station.plants.thesis import THESIS, PlantConstants
from station.quantities import Part, finite, unique
from station.sections import Buffers, Compressor, ControlModelFigures, Dispenser, Precooler, Slot, Thermal, VehicleType
from station.shifts import Shifts
from station.tariff import Tariff

_TANK_LEAST_M3 = 1e-3
"""Real gas is not computed in a smaller tank [m3]: a second moves more than it holds."""

_MPA_PER_MIN = 10.0 / 60.0
"""In bar/s."""


def _known(name: str) -> str:
    plant_named(name)
    return name


def _checked(rules: list[AlarmRule] | None) -> list[AlarmRule] | None:
    if rules is not None:
        check_rules(rules)
    return rules


@cache
def _effort(suction: float, suction_c: float, stages: int, top: float) -> tuple[float, float]:
    """A compressor-second's work as a line over the pressure, its value at 0 and its slope [1/bar].

    Through the isentropic work from the suction [bar], [degC] to half of the pressure `top` [bar] and to all of it, by
    their mean.
    """
    pressures = np.array([0.5, 1.0]) * top
    reached = np.maximum(pressures, suction) * BAR
    work = isentropic_work(suction * BAR, suction_c + KELVIN, reached, stages)
    slope = float((work[1] - work[0]) / work.mean() / (pressures[1] - pressures[0]))
    return 1.0 - slope * float(pressures.mean()), slope


class Station(Part):
    """A hydrogen refueling station: every parameter but the arrivals."""

    name: Annotated[str, Field(min_length=1, max_length=64)]
    about: str = ""
    source: str = ""
    buffers: Buffers
    compressor: Compressor
    precooler: Precooler = Precooler()
    dispenser: Dispenser
    thermal: Thermal
    vehicle: VehicleType
    slot: Slot = Slot()
    plant: Annotated[
        str,
        AfterValidator(_known),
        Field(exclude_if=lambda name: name == THESIS.name, description="Whose equations the station follows"),
    ] = THESIS.name
    real_gas: Annotated[
        RealGasOptions | None,
        Field(exclude_if=lambda given: given is None, description="What the plant 'real-gas' needs"),
    ] = None
    tariff: Annotated[
        Tariff | None,
        Field(exclude_if=lambda given: given is None, description="What energy costs; left out: no metric is of money"),
    ] = None
    shifts: Annotated[
        Shifts,
        Field(exclude_if=lambda given: given == Shifts(), description="By which figures of a twin's record are cut"),
    ] = Shifts()
    calibrated: Annotated[
        bool,
        Field(
            exclude_if=lambda given: not given,
            description="Whether an accepted calibration found its figures: small leaks are told then",
        ),
    ] = False
    unknown_buffers: Annotated[
        list[BufferName],
        Field(
            default_factory=list,
            max_length=len(BUFFERS),
            exclude_if=lambda given: not given,
            description="Whose volumes a calibration's day told too little of: no leak of theirs is told",
        ),
        AfterValidator(unique),
    ]
    volume_deviations_percent: dict[
        BufferName, Annotated[float, finite("%", ge=0, le=100, about="Standard deviation of a buffer's volume")]
    ] = Field(
        {},
        exclude_if=lambda given: not given,
        description="How surely a calibration knew the buffers' volumes, but for the class of its meters",
    )
    control_model: Annotated[
        ControlModelFigures | None,
        Field(
            exclude_if=lambda given: given is None,
            description="What controllers plan with at a station with real gas, as `hrs identify` finds it",
        ),
    ] = None
    alarms: Annotated[
        list[AlarmRule] | None,
        AfterValidator(_checked),
        Field(exclude_if=lambda given: given is None, description="Table of alarms; left out: the one that ships"),
    ] = None
    controllers: dict[str, dict[str, Any]] = Field(
        {}, description="Settings of controllers that belong to this station, by controller; they check them"
    )

    @field_validator("controllers")
    @classmethod
    def _plain(cls, controllers: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
        """What a file can hold and a database keep, since controllers look at their own settings alone."""
        try:
            json.dumps(controllers, allow_nan=False, ensure_ascii=False).encode()
        except (TypeError, ValueError, RecursionError) as error:
            raise ValueError(f"controllers must hold texts, finite numbers, lists and tables: {error}") from None
        return controllers

    @model_validator(mode="after")
    def _consistent(self) -> Station:
        top = self.compressor.pressure_bar
        for name, buffer in zip(BUFFERS, self.buffers.all, strict=True):
            if buffer.initial_pressure_bar >= top:
                raise ValueError(
                    f"buffers.{name}.initial_pressure_bar must lie below compressor.pressure_bar = {top:g} bar; "
                    f"given {buffer.initial_pressure_bar:g}"
                )
            most = top if self.real_gas is None else getattr(self.real_gas.bank_pressure_max_bar, name)
            if buffer.initial_pressure_bar > most:
                raise ValueError(
                    f"buffers.{name}.initial_pressure_bar must not exceed real_gas.bank_pressure_max_bar.{name} = "
                    f"{most:g} bar; given {buffer.initial_pressure_bar:g}"
                )
            if buffer.initial_temperature_c > self.thermal.buffer_temperature_max_c:
                raise ValueError(
                    f"buffers.{name}.initial_temperature_c must not exceed thermal.buffer_temperature_max_c = "
                    f"{self.thermal.buffer_temperature_max_c:g} degC; given {buffer.initial_temperature_c:g}"
                )
        self._check_surroundings()
        if (self.plant == REAL_GAS.name) != (self.real_gas is not None):
            raise ValueError(f"real_gas must be given with plant = {REAL_GAS.name!r}, and with no other")
        if self.tariff is not None and self.real_gas is None and None in self.powers:
            raise ValueError("tariff needs compressor.power_kw and precooler.power_kw, of which this plant's energy is")
        if self.control_model is not None and self.real_gas is None:
            raise ValueError(f"control_model must be given with plant = {REAL_GAS.name!r} alone, whose ramp it has")
        self.check_finish("vehicle.finish_pressure_bar", self.vehicle.finish_pressure_bar)
        self.check_tank("vehicle.volume_m3", self.vehicle.volume_m3)
        self._check_filling()
        flow = self.dispenser.outlet_coefficient_g_per_s_bar * self.dispenser.outlet_gap_min_bar
        if flow > self.dispenser.flow_max_g_per_s:
            raise ValueError(
                f"dispenser.flow_max_g_per_s must be at least {flow:g} g/s, the flow at outlet_gap_min_bar; "
                "with less no outlet could ever open"
            )
        return self

    def _check_surroundings(self) -> None:
        """Raise ValueError if the air or the compressor's source would keep the station from working at all."""
        ambient, most = self.thermal.ambient_temperature_c, self.thermal.buffer_temperature_max_c
        if ambient >= most:
            raise ValueError(
                f"thermal.ambient_temperature_c must lie below thermal.buffer_temperature_max_c = {most:g} degC, "
                f"or no buffer is filled; given {ambient:g}"
            )
        if self.real_gas is None:
            return
        suction = self.real_gas.compressor.suction_bar
        for name, most in self.real_gas.bank_pressure_max_bar:
            if suction >= most:
                raise ValueError(
                    f"real_gas.compressor.suction_bar must lie below real_gas.bank_pressure_max_bar.{name} = "
                    f"{most:g} bar, or nothing is compressed into that bank; given {suction:g}"
                )

    @property
    def powers(self) -> tuple[float | None, float | None]:
        """Electric power of a compressor and of the precooler while they run [kW]; None where the file says none."""
        return self.compressor.power_kw, self.precooler.power_kw

    @property
    def finish_pressure_max(self) -> float:
        """The highest pressure a vehicle can reach [bar]: below every buffer by the outlet gap."""
        return self._highest[0] - self.dispenser.outlet_gap_min_bar

    @property
    def _highest(self) -> tuple[float, str]:
        """The highest pressure of a buffer [bar], and the field that says it."""
        if self.real_gas is None:
            return self.compressor.pressure_bar, "compressor.pressure_bar"
        name, most = max(self.real_gas.bank_pressure_max_bar, key=lambda bank: bank[1])
        return most, f"real_gas.bank_pressure_max_bar.{name}"

    def check_finish(self, field: str, pressure: float) -> None:
        """Raise ValueError unless a vehicle can reach `pressure` [bar]."""
        if pressure >= self.finish_pressure_max:
            raise ValueError(
                f"{field} must lie below {self.finish_pressure_max:g} bar, {self._highest[1]} less "
                f"dispenser.outlet_gap_min_bar: nobody could reach it; given {pressure:g}"
            )

    def check_nominal(self, field: str, pressure: float, *, communication: bool) -> None:
        """Raise ValueError unless a fill of a nominal working pressure [bar] can be prepared where that is needed.

        With real gas, ramps that the model chooses and ends of fills without communication are worked out beforehand.
        """
        if self.real_gas is None or (communication and self.real_gas.dispensing.ramp_choice == "fixed"):
            return
        if pressure not in NOMINAL_BAR:
            known = " or ".join(f"{bar:g}" for bar in NOMINAL_BAR)
            raise ValueError(
                f"{field} must be {known} bar, for which ramps are chosen (real_gas.dispensing.ramp_choice = 'auto') "
                f"and fills without communication end; given {pressure:g}"
            )

    def _bar_per_g(self, volume: float, hottest: float) -> float:
        """How much a gram raises the pressure of a tank at most [bar/g]; 0 where the plant's steps cannot overshoot."""
        return plant_named(self.plant).stiffness(hottest, volume)

    def check_tank(self, field: str, volume: float) -> None:
        """Raise ValueError if a second's flow into a tank of `volume` [m3] could overshoot its buffer's pressure."""
        self._check_room(field, volume)
        coefficient = self.dispenser.outlet_coefficient_g_per_s_bar
        vehicle = self._bar_per_g(volume, self.vehicle.temperature_max_c)
        for buffer in self.buffers.all:
            share = coefficient * (vehicle + self._bar_per_g(buffer.volume_m3, self.thermal.buffer_temperature_max_c))
            if share >= 1:
                raise ValueError(
                    f"{field} and the buffers must be large enough for dispenser.outlet_coefficient_g_per_s_bar: "
                    f"a second would move {share:.3g} times the pressure difference, "
                    f"the limit is 1; given {volume:g} m3"
                )

    def _check_room(self, field: str, volume: float) -> None:
        """Raise ValueError if a tank of `volume` [m3] is too small for real gas."""
        if self.real_gas is not None and volume < _TANK_LEAST_M3:
            raise ValueError(f"{field} must be at least {_TANK_LEAST_M3:g} m3 with real gas; given {volume:g}")

    def _check_filling(self) -> None:
        """Raise ValueError if a second of filling a buffer could overshoot the compressor's pressure."""
        for name, buffer in zip(BUFFERS, self.buffers.all, strict=True):
            self._check_room(f"buffers.{name}.volume_m3", buffer.volume_m3)
            rise = self._bar_per_g(buffer.volume_m3, self.thermal.buffer_temperature_max_c)
            share = self.compressor.inlet_coefficient_g_per_s_bar * rise
            if share >= 1:
                raise ValueError(
                    f"buffers.{name}.volume_m3 must be large enough for compressor.inlet_coefficient_g_per_s_bar: "
                    f"a second of filling would close {share:.3g} times the distance to compressor.pressure_bar, "
                    f"the limit is 1; given {buffer.volume_m3:g} m3"
                )

    def _unfilled(self) -> tuple[float, float, float]:
        """By how much the pressure to which each buffer is filled lies below the compressor's [bar]."""
        if self.real_gas is None:
            return 0.0, 0.0, 0.0
        top, most = self.compressor.pressure_bar, self.real_gas.bank_pressure_max_bar
        return top - most.high, top - most.medium, top - most.low

    @property
    def bank_pressures_max(self) -> tuple[float, float, float]:
        """The pressure to which each buffer is filled at most [bar]."""
        top = self.compressor.pressure_bar
        high, medium, low = self._unfilled()
        return top - high, top - medium, top - low

    @property
    def minimum_times(self) -> tuple[float, float]:
        """How long the shield keeps a valve open, and closed [s]."""
        return (0.0, 0.0) if self.real_gas is None else (self.real_gas.minimum_on_s, self.real_gas.minimum_off_s)

    def emptiest(self, named: float) -> float | None:
        """The emptiest vehicle that one buffer is kept able to give gas [bar], where some come with `named` [bar].

        None where none is: the station does not say, and usual ones come as empty.
        """
        if self.slot.emptiest_bar is not None:
            return self.slot.emptiest_bar
        return named if named < self.vehicle.start_range[0] else None

    def _least_pressures(self) -> tuple[float, float, float]:
        """Below which nothing may flow out of each buffer; 0 for no limit [bar]."""
        if self.real_gas is None:
            return 0.0, 0.0, 0.0
        least = self.real_gas.bank_pressure_min_bar
        return least.high, least.medium, least.low

    def constants(self) -> PlantConstants:
        """The numbers of chapter 7's equations and of the limits: the model that controllers have of any plant."""
        high, medium, low = self.buffers.all
        return PlantConstants(
            buffer_volume=(high.volume_m3, medium.volume_m3, low.volume_m3),
            compressor_pressure=self.compressor.pressure_bar,
            inlet_coefficient=self.compressor.inlet_coefficient_g_per_s_bar,
            outlet_coefficient=self.dispenser.outlet_coefficient_g_per_s_bar,
            inlet_heating=(high.inlet_heating_k_per_s, medium.inlet_heating_k_per_s, low.inlet_heating_k_per_s),
            outlet_cooling=(high.outlet_cooling_k_per_s, medium.outlet_cooling_k_per_s, low.outlet_cooling_k_per_s),
            vehicle_heating=self.vehicle.heating_k_per_s,
            heat_exchange=self.thermal.heat_exchange_per_s,
            ambient_temperature=self.thermal.ambient_temperature_c,
            limits=limit_figures(self),
            compressor_count=self.compressor.count,
            unfilled=self._unfilled(),
            buffer_pressure_min=self._least_pressures(),
        )

    def control_constants(self) -> ControlModel:
        """The control model: the section's figures, those of the thesis's equations where there is none."""
        given = self.control_model
        if given is None:
            return self.form_constants(real_gas=False)
        (high_in, medium_in, low_in), (high_out, medium_out, low_out) = (
            given.inlet_heating_k_per_s, given.outlet_cooling_k_per_s,
        )  # fmt: skip
        return self.form_constants(real_gas=True)._replace(
            inlet_coefficient=given.inlet_coefficient_g_per_s_bar,
            outlet_coefficient=given.outlet_coefficient_g_per_s_bar,
            inlet_heating=(high_in, medium_in, low_in),
            outlet_cooling=(high_out, medium_out, low_out),
            heat_exchange=given.heat_exchange_per_s,
            driving_pressure=given.driving_pressure_bar,
            covolume=given.covolume_l_per_kg * 1e-6,
            delivered_temperature=given.delivered_k,
            wall_conductance=given.wall_conductance_g_per_s_m3,
        )

    def form_constants(self, *, real_gas: bool) -> ControlModel:
        """The control model before it is identified: the thesis's, or with limits, ramp and nozzle of real gas."""
        base, gas = thesis_model(self.constants()), self.real_gas
        if not real_gas or gas is None:
            return base
        most = gas.bank_pressure_max_bar
        top = max(most.high, most.medium, most.low)
        unit = gas.compressor
        effort_base, effort_slope = _effort(unit.suction_bar, unit.suction_c, unit.stages, top)
        return base._replace(
            compressor_pressure=top,
            unfilled=(top - most.high, top - most.medium, top - most.low),
            limits=base.limits._replace(dispenser_flow_max=math.inf, hold_pressure=math.inf),
            nozzle_flow=gas.dispensing.flow_max_g_per_s,
            ramp=gas.dispensing.ramp_mpa_per_min * _MPA_PER_MIN,
            effort_base=effort_base,
            effort_slope=effort_slope,
        )
