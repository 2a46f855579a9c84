"""Settings of the switched controller, and the vector its kernel reads."""

from __future__ import annotations

from statistics import fmean, median
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from controllers.base import Settings
from controllers.switched.model import Demand, Prices
from controllers.switched.value import fill_end_pressure
from station.limits import start_limit
from station.parameters import Station
from station.planning import Model, driving_pressure, gas_mass, inlet_flow, is_thesis, most_dispensed
from station.quantities import PRESSURE_MAX
from station.valves import commands
from station.whole import WHOLE

BLOCKS_MAX = 60
WIDTH_MAX = 2000
FOLLOW_MAX = 12

WIDTH_A_SECOND, WIDTH_USUAL = 2.3, 100
"""States a beam keeps by the seconds of a block, at most so many: planning then takes some 80 us a second."""

CHOICES, CHOICES_POWER = 13, 2
"""Commands there are with one compressor; where there are more a beam is wider by this power of how many more."""


BLOCKS_A_FILLING, BLOCK_MIN, BLOCK_MAX = 10.0, 20.0, 60.0
"""Blocks in the time constant of the middle buffer, and limits of a block [s]: slow stations need longer plans."""

DEAREST = 8.0
"""What a second of an open outlet costs at patience 0 [s of compressor], where it draws half the compressor's power."""

FALL = 64.0
"""By what prices fall from patience 0 to near 1: to an eighth of a compressor-second."""

SAVING_SHARPNESS = 24
"""Saving alone begins only close to patience 1: its weight is patience to this power, 0.003 at 0.78."""

SAVING_PRICE = 0.15
"""On the prices of time at patience 1: they break ties, and keep a plan from putting a fill off for ever."""

WAITING = 1.56
"""Price of a second in which somebody waits, by that of an open outlet, however many wait: the dearest second there is.

A price for each of them would fill ever faster the longer the queue, which compresses much and shortens it little.
"""

SIDE_BY_SIDE = 0.8
"""Prices of time fall with this power of the number of compressors: together they make good sooner what was taken.

In the thesis's plant: where a plan counts work, a second of each of them is as dear as that of one.
"""

CHEAP_SHARE = 0.44
"""They grow with the square of the share of the compressor's pressure that the usual vehicle leaves unused, from here
on: gas of low pressure is compressed with little, and little is saved by letting a vehicle wait for it."""

OCCUPANCY = 0.25
"""Price of a second with a vehicle connected, by that of a waiting one: nobody may be coming."""

BOTTLENECK, SCARCE = 1.2, 0.5
"""Where compression takes so many times as long as dispensing, a second of it costs this share of waiting as well.

So it does wherever a plan counts work: a second against a low pressure, which costs little, is missed as much.
"""


SPARSE_FACTOR = 2.0
"""On the price of dispensing then: there is time to compress, and a fill that is over sooner keeps nobody."""


CROWDED_FACTOR = 0.58
"""On the prices of time then: vehicles wait for gas, and fuller buffers yield less of it."""


SPARE_SHARE = 0.4
"""High is kept this share of the way from what ends a usual fill to the compressor's pressure."""

INVENTORY_SHARE, INVENTORY_SHARED = 0.81, 0.77
"""Medium and low are kept at most at this share of the compressor's pressure, with one compressor and with several,
which make good sooner what was taken: a gram costs twice as much at 0.9."""

SAVING_MEDIUM, SAVING_LOW = 0.67, 0.585
"""The same of medium and of low at patience 1, where gas is only compressed for a vehicle that is there."""

SAVING_BLOCK = 0.55
"""On the length of a block there: what is compressed is given at once, and timing saves more than looking far ahead."""

FLOW_SHARE = 0.97
"""And low at most at this share of the gap at which an outlet gives all it may: warm gas presses more."""

FILLS_HELD = 2.0
"""So many usual fills banks hold above their least pressures, lest gas be scarce: one for who comes while they fill."""

START = 0.5
"""Price of opening a valve [s of compressor]."""


FINISH_MARGIN = 1.0
"""How far a plan fills beyond the finish pressure [bar]: its steps are longer than the plant's."""

FILL_TEMPERATURE = 60.0
"""Of a vehicle's gas in that estimate [deg C]: near the end of a fill."""

Seconds = Annotated[float, Field(ge=0, le=600, allow_inf_nan=False, json_schema_extra={"unit": "s"})]
Price = Annotated[float, Field(ge=0, le=1000, allow_inf_nan=False, json_schema_extra={"unit": "s of compressor"})]


Target = Annotated[float, Field(gt=0, le=PRESSURE_MAX, allow_inf_nan=False, json_schema_extra={"unit": "bar"})]


class SwitchedSettings(Settings):
    """Settings of `switched`; minimum on and off times come from the station's preset."""

    patience: Annotated[
        float, Field(ge=0, le=1, allow_inf_nan=False, description="0: serve at any cost; 1: save the compressor")
    ] = 0.68
    waiting_price: Annotated[
        Price | None, Field(description="Of a second in which somebody waits; left out: by patience")
    ] = None
    dispensing_price: Annotated[
        Price | None, Field(description="Of a second with an outlet open; left out: by patience")
    ] = None
    sparse_factor: Annotated[
        float,
        Field(
            ge=0, le=1000, allow_inf_nan=False, description="On the price of dispensing while vehicles come far apart"
        ),
    ] = SPARSE_FACTOR
    crowded_factor: Annotated[
        float,
        Field(ge=0, le=1000, allow_inf_nan=False, description="On the prices of time while vehicles queue all day"),
    ] = CROWDED_FACTOR
    block_s: Annotated[
        Annotated[float, Field(ge=5, le=300, allow_inf_nan=False, json_schema_extra={"unit": "s"})] | None,
        Field(description="How long a plan keeps a command; left out: by how fast the buffers fill"),
    ] = None
    blocks: Annotated[int, Field(ge=1, le=BLOCKS_MAX, description="Length of a plan"), WHOLE] = 14
    follow: Annotated[
        int,
        Field(ge=1, le=FOLLOW_MAX, description="Blocks for which a plan is followed while all comes as it expects"),
        WHOLE,
    ] = 3
    width: Annotated[
        Annotated[int, Field(ge=1, le=WIDTH_MAX), WHOLE] | None,
        Field(description="States the beam keeps after each block; left out: as many as the blocks leave time for"),
    ] = None
    bound: Annotated[
        bool, Field(description="Whether decisions tell what no plan undercuts; what is decided is the same")
    ] = True
    target_high_bar: Annotated[
        Target | None,
        Field(
            description="A plan restores what high holds at this pressure and ambient temperature; left out: what "
            "ends a usual fill, with something to spare"
        ),
    ] = None
    target_medium_bar: Annotated[
        Target | None, Field(description="The same of medium; left out: at most 0.81 of the compressor's pressure")
    ] = None
    target_low_bar: Annotated[
        Target | None,
        Field(description="The same of low; left out: no more than an empty vehicle can be given gas from"),
    ] = None
    minimum_on_s: Annotated[Seconds, Field(description="A valve stays open so long, unless a limit closes it")] = 10.0
    minimum_off_s: Annotated[Seconds, Field(description="A valve stays closed so long")] = 5.0

    peak_kw: Annotated[
        Annotated[float, Field(gt=0, le=1e5, allow_inf_nan=False, json_schema_extra={"unit": "kW"})]
        | Literal["auto"]
        | None,
        Field(
            description="The compressor stays off where the quarter's mean power would pass this, unless a vehicle "
            "would wait, and less where energy is dear; auto: half of the power of all compressors, where the tariff "
            "has a demand charge"
        ),
    ] = None

    def prices(self, station: Station) -> Prices:
        """The prices of a plan [s of compressor]."""
        usual = DEAREST * FALL**-self.patience * self.saving_factor * _time_factor(station)
        waiting = WAITING * usual if self.waiting_price is None else self.waiting_price
        dispensing = usual * _energy_ratio(station) if self.dispensing_price is None else self.dispensing_price
        occupancy = OCCUPANCY * waiting
        slow = usual_compression(station) > BOTTLENECK * usual_fill(station)
        scarce = SCARCE if slow or not is_thesis(station.control_constants()) else 0.0
        return Prices(dispensing, occupancy, waiting, START, scarce * (waiting + occupancy))

    @property
    def saving(self) -> float:
        """How far the compressor's time is all that counts, from 0 to 1."""
        return float(self.patience**SAVING_SHARPNESS)

    @property
    def saving_factor(self) -> float:
        """On the prices of time, where saving counts."""
        return 1.0 + self.saving * (SAVING_PRICE - 1.0)

    def beam(self, station: Station) -> int:
        """States the beam keeps after each block."""
        if self.width is not None:
            return self.width
        usual = min(round(WIDTH_A_SECOND * self.block(station)), WIDTH_USUAL)
        return round(usual * (len(commands(station.compressor.count)) / CHOICES) ** CHOICES_POWER)

    def minimum_times(self, station: Station) -> tuple[float, float]:
        """How long a valve stays open, and closed [s]: no less than the station keeps it so."""
        opened, closed = station.minimum_times
        return max(self.minimum_on_s, opened), max(self.minimum_off_s, closed)

    def block(self, station: Station) -> float:
        """How long a plan keeps a command [s]."""
        if self.block_s is not None:
            return self.block_s
        usual = min(max(median(_filling_times(station)) / BLOCKS_A_FILLING, BLOCK_MIN), BLOCK_MAX)
        return usual * (1.0 + self.saving * (SAVING_BLOCK - 1.0))


def _time_factor(station: Station) -> float:
    """On the prices of time, by how many compressors there are and how far below their pressure vehicles leave."""
    model = station.control_constants()
    unused = 1.0 - station.vehicle.finish_pressure_bar / model.compressor_pressure
    together = station.compressor.count**SIDE_BY_SIDE if is_thesis(model) else 1.0
    return float(max(unused / CHEAP_SHARE, 1.0) ** 2 / together)


def _energy_ratio(station: Station) -> float:
    """Power of the precooler by that of the compressor, as a multiple of the 1 : 2 of Sec. 7.3."""
    precooler, compressor = station.precooler.power_kw, station.compressor.power_kw
    return 1.0 if precooler is None or compressor is None else 2.0 * precooler / compressor


def _filling_times(station: Station) -> list[float]:
    """Time constant with which the compressor fills each buffer at ambient temperature [s]."""
    model, coefficient = station.control_constants(), station.compressor.inlet_coefficient_g_per_s_bar
    ambient = station.thermal.ambient_temperature_c
    if not is_thesis(model):
        top = model.compressor_pressure
        half = float(inlet_flow(0.5 * top, model))
        return [float(gas_mass(top, ambient, tank.volume_m3, model)) / half for tank in station.buffers.all]
    return [float(gas_mass(1.0, ambient, tank.volume_m3, model)) / coefficient for tank in station.buffers.all]


def _usual_grams(station: Station) -> float:
    """What the usual vehicle takes [g]."""
    vehicle, model = station.vehicle, station.control_constants()
    full = gas_mass(vehicle.finish_pressure_bar, FILL_TEMPERATURE, vehicle.volume_m3, model)
    return float(full - gas_mass(vehicle.start_pressure_bar, vehicle.start_temperature_c, vehicle.volume_m3, model))


def scarce_pressure(station: Station) -> float:
    """Mean pressure of the banks below which they hold too little above their least pressures [bar]; 0: have none.

    All of them hold the same share of what they may; at most the mean of their greatest pressures.
    """
    model, ambient = station.control_constants(), station.thermal.ambient_temperature_c
    least = np.array(model.buffer_pressure_min)
    if not least.any():
        return 0.0
    most = model.compressor_pressure - np.array(model.unfilled)

    def mean_and_gas(share: float) -> tuple[float, float]:
        held = least + share * (most - least)
        grams = [
            float(gas_mass(bar, ambient, volume, model) - gas_mass(lower, ambient, volume, model))
            for bar, lower, volume in zip(held, least, model.buffer_volume, strict=True)
        ]
        return float(held.mean()), sum(grams)

    wanted = FILLS_HELD * _usual_grams(station)
    shares = np.linspace(0.0, 1.0, 101)
    return next((mean for mean, gas in map(mean_and_gas, shares) if gas >= wanted), float(most.mean()))


def usual_compression(station: Station) -> float:
    """About how long the compressor works for the usual vehicle [s]: at the least pressure that fills it halfway."""
    vehicle, model = station.vehicle, station.control_constants()
    halfway = (vehicle.start_pressure_bar + vehicle.finish_pressure_bar) / 2
    room = driving_pressure(model) - halfway - model.limits.outlet_gap_min
    return _usual_grams(station) / (model.inlet_coefficient * max(room, 1.0) * model.compressor_count)


def usual_fill(station: Station) -> float:
    """About how long the usual vehicle takes [s]: its mass at the flow of mean pressures.

    Buffers hold the inventory that is kept: how much there is of gas does not say how fast a station fills.
    """
    vehicle = station.vehicle
    start, finish = vehicle.start_pressure_bar, vehicle.finish_pressure_bar
    grams = _usual_grams(station)
    stored = fmean(_inventory(station))
    gap = max(stored - (start + finish) / 2, station.dispenser.outlet_gap_min_bar)
    model, middle = station.control_constants(), (start + finish) / 2
    mass = gas_mass(middle, FILL_TEMPERATURE, vehicle.volume_m3, model)
    most = most_dispensed(mass, FILL_TEMPERATURE, middle, vehicle.volume_m3, model, 1.0)
    return float(grams / min(model.outlet_coefficient * gap, most))


def _inventory(station: Station, saving: float = 0.0) -> list[float]:
    """Pressures to keep the buffers at, at ambient temperature [bar], high, medium, low.

    They serve the usual vehicle: high ends its fill with something to spare, the others hold gas at the same pressure,
    and so at the same price, where it is not dear yet. From low even an empty vehicle can be given gas: Eq. (7.11).
    Of what a bank may give above its least pressure they hold as large a share.
    """
    usual, plant = station.vehicle, station.control_constants()
    finish = usual.finish_pressure_bar + FINISH_MARGIN
    demand = Demand(
        usual.volume_m3, finish, usual.volume_m3, finish, usual.start_pressure_bar, usual.start_temperature_c
    )
    enough, top = float(fill_end_pressure(demand, plant)), plant.compressor_pressure
    high = enough + SPARE_SHARE * (top - enough)
    kept = INVENTORY_SHARE if plant.compressor_count == 1 else INVENTORY_SHARED
    medium, low = (kept + saving * (share - kept) for share in (SAVING_MEDIUM, SAVING_LOW))
    usual_ones = [high, min(medium * top, high), min(low * top, high, FLOW_SHARE * float(start_limit(plant)))]
    return [_above_least(bar, kept, bank, plant) for bank, bar in enumerate(usual_ones)]


def _above_least(pressure: float, share: float, bank: int, model: Model) -> float:
    """The pressure to keep a bank at [bar]: at least this share of what it may give above its least pressure."""
    least = model.buffer_pressure_min[bank]
    if least == 0.0:
        return pressure
    return max(pressure, least + share * (model.compressor_pressure - model.unfilled[bank] - least))


def target_pressures(settings: SwitchedSettings, station: Station) -> list[float]:
    """The inventory a plan restores at ambient temperature [bar], high, medium, low."""
    given = (settings.target_high_bar, settings.target_medium_bar, settings.target_low_bar)
    usual = _inventory(station, settings.saving)
    return [own if bar is None else bar for bar, own in zip(given, usual, strict=True)]


def target_masses(settings: SwitchedSettings, station: Station) -> list[float]:
    """The inventory a plan restores [g], high, medium, low."""
    ambient, model = station.thermal.ambient_temperature_c, station.control_constants()
    return [
        float(gas_mass(bar, ambient, tank.volume_m3, model))
        for bar, tank in zip(target_pressures(settings, station), station.buffers.all, strict=True)
    ]
