"""The vector that the kernel of the switched controller reads: what it holds, and what is read from it."""

from __future__ import annotations

import math
from statistics import fmean
from typing import NamedTuple

import numpy as np

from controllers.switched.model import Demand, Prices
from controllers.switched.peak import HOUR, PEAK_SIZE, QUARTERS, SHARES, UNHEEDED, Peak
from controllers.switched.settings import (
    FILL_TEMPERATURE,
    FINISH_MARGIN,
    SwitchedSettings,
    scarce_pressure,
    target_masses,
    target_pressures,
    usual_compression,
    usual_fill,
)
from controllers.switched.value import (
    FILL_END_MARGIN,
    FILL_ROWS,
    POINTS,
    TerminalCost,
    fill_cost,
    restored_temperature,
    terminal_cost_of,
)
from station.compiled import kernel
from station.errors import InputError
from station.geometry import BUFFERS
from station.parameters import Station
from station.planning import Model, gas_pressure, is_thesis
from station.tariff import QUARTER
from station.valves import commands

EQUAL_BLOCKS = 4
"""So many blocks last as long as each other, the next so many one block more: what is far ahead is known less well."""


SPARSE = 1.3
"""Vehicles come far apart if their mean gap is so many times what the usual one takes of dispenser or compressor."""


SPARSE_SPAN = 4.0
"""And so many times as much where they come as far apart as matters."""


CROWDED, CROWDED_SPAN = 1.6, 0.6
"""Demand is high where it comes closer than so many times what the usual vehicle takes; in full, so much closer."""


CROWDED_SEEN = 20.0
"""And has been for so many vehicles: what a burst costs is made good after it, what a day of queues does is not."""


LARGE, LARGE_SPAN = 1.5, 1.5
"""Vehicles are large that ask for so many times what the usual one does, in full at so much more. Prices of time are
then those of patience 0 to near 1 again, for saving alone keeps such a fill going for hours."""


FIRST_GAP = 0.5
"""Gap between arrivals believed before one is seen, by `usual_fill`: rather too many vehicles than too few."""


CHOSEN_PEAK = 0.5
"""Of the power of the compressors that run together: the peak that is chosen. This and the next three: what saved most
on eight days of 20 vehicles at `h70-equal` while they were served as fast as by logic."""

RESERVE_FILLS = 2.0
"""Usual fills whose precooling is set aside in a quarter: the refrigerator goes on after one."""

EMPTY_SHARE = 0.6
"""Banks are empty when their mean pressure is so far from halfway up a usual fill to what they are restored to."""

DEAR_POWER = 1.0
"""The peak falls with this power of the price of energy by its mean, where that is dear."""


# Entries of the vector.
_PRICES, _USUAL, _REFERENCE = 0, 5, 9


(
    BLOCK,
    BLOCKS,
    FOLLOW,
    WIDTH,
    ON,
    OFF,
    _FIRST_GAP,
    _SPARSE_GAP,
    _SPARSE_FACTOR,
    _CROWDED_FACTOR,
    _LARGE_FACTOR,
    _COMMANDS,
) = range(12, 24)


_LIST = 24


_TABLE = _LIST + 20


_SPARSE_TABLE = _TABLE + FILL_ROWS * POINTS


_CROWDED_TABLE = _SPARSE_TABLE + FILL_ROWS * POINTS


_LARGE_TABLE = _CROWDED_TABLE + FILL_ROWS * POINTS


PEAK = _LARGE_TABLE + FILL_ROWS * POINTS


BOUNDED = PEAK + PEAK_SIZE
"""Entry that says whether a decision tells what no plan undercuts."""

_SIZE = BOUNDED + 1


class Pace(NamedTuple):
    """How close together vehicles come, and how much they ask for: shares from 0 to 1, all 0 for usual ones."""

    sparse: float
    crowded: float
    large: float


USUAL_PACE = Pace(0.0, 0.0, 0.0)


def settings_vector(settings: SwitchedSettings, station: Station) -> np.ndarray:
    """The settings the compiled controller reads, with what it expects of vehicles and the cost of their fills."""
    plant, usual = station.control_constants(), station.vehicle
    prices = settings.prices(station)
    admitted = commands(plant.compressor_count)
    vector = np.zeros(_TABLE)
    vector[_PRICES:_USUAL] = prices
    vector[_USUAL:_REFERENCE] = (
        usual.volume_m3, usual.finish_pressure_bar, usual.start_pressure_bar, usual.start_temperature_c,
    )  # fmt: skip
    vector[_REFERENCE:BLOCK] = target_masses(settings, station)
    vector[BLOCK:_LIST] = (
        settings.block(station), settings.blocks, settings.follow, settings.beam(station),
        *settings.minimum_times(station), FIRST_GAP * usual_fill(station),
        SPARSE * max(usual_fill(station), usual_compression(station)), settings.sparse_factor,
        settings.crowded_factor, 1.0 if settings.waiting_price is not None else 1.0 / settings.saving_factor,
        len(admitted),
    )  # fmt: skip
    vector[_LIST : _LIST + len(admitted)] = admitted
    vector = np.concatenate((vector, np.zeros(_SIZE - _TABLE)))
    price_fills(plant, vector)
    vector[PEAK : PEAK + SHARES] = peak_of(settings, station)
    vector[PEAK + SHARES : BOUNDED] = shares_of(station)
    vector[BOUNDED] = settings.bound
    return vector


def peak_of(settings: SwitchedSettings, station: Station) -> Peak:
    """The peak that the compressor heeds.

    Raises
    ------
    InputError
        if one is asked for at a station whose powers are not known.
    """
    asked, tariff = settings.peak_kw, station.tariff
    charged = tariff is not None and tariff.demand_eur_per_kw_month > 0.0
    if asked is None or (asked == "auto" and not charged):
        return UNHEEDED
    compressor, precooler = station.powers
    if compressor is None or precooler is None:
        raise InputError(
            f"station {station.name}", [("compressor.power_kw, precooler.power_kw", "peak_kw of switched needs them")]
        )
    usual = station.vehicle
    halfway = (usual.start_pressure_bar + usual.finish_pressure_bar) / 2
    together = compressor * min(station.compressor.count, len(BUFFERS))
    above = station.dispenser.outlet_gap_min_bar + FILL_END_MARGIN
    return Peak(
        CHOSEN_PEAK * together if asked == "auto" else asked,
        together,
        precooler,
        RESERVE_FILLS * precooler * usual_fill(station) / HOUR,
        usual.finish_pressure_bar + above,
        halfway + EMPTY_SHARE * (fmean(target_pressures(settings, station)) - halfway),
        scarce_pressure(station),
        above,
    )


def shares_of(station: Station) -> list[float]:
    """The share of the peak that the compressor heeds in each quarter of the day: less where energy is dear."""
    tariff = station.tariff
    if tariff is None or tariff.mean == 0.0:
        return [1.0] * QUARTERS
    prices = tariff.price_at(np.arange(float(QUARTERS)) * QUARTER)
    return [min(1.0, (tariff.mean / price) ** DEAR_POWER) if price > 0.0 else 1.0 for price in prices.tolist()]


@kernel
def pace_of(settings: np.ndarray, gap: float, seen: float, asked: float) -> Pace:
    """The pace of `seen` vehicles a mean `gap` [s] apart, counted in usual ones, of which each asks for `asked`."""
    large = min(max((asked - LARGE) / LARGE_SPAN, 0.0), 1.0)
    sparse = min(max((gap / settings[_SPARSE_GAP] - 1.0) / (SPARSE_SPAN - 1.0), 0.0), 1.0) ** 2
    crowded = min(max((CROWDED - SPARSE * gap / settings[_SPARSE_GAP]) / CROWDED_SPAN, 0.0), 1.0)
    return Pace(sparse, crowded * min(seen / CROWDED_SEEN, 1.0) ** 2, large)


@kernel
def prices_of(settings: np.ndarray, pace: Pace) -> Prices:
    """The prices in the vector at a pace."""
    sparse = 1.0 + pace.sparse * (settings[_SPARSE_FACTOR] - 1.0)
    time = (1.0 + pace.crowded * (settings[_CROWDED_FACTOR] - 1.0)) * (
        1.0 + pace.large * (settings[_LARGE_FACTOR] - 1.0)
    )
    return Prices(
        sparse * time * settings[_PRICES], time * settings[_PRICES + 1], time * settings[_PRICES + 2],
        settings[_PRICES + 3], time * settings[_PRICES + 4],
    )  # fmt: skip


@kernel
def price_fills(model: Model, vector: np.ndarray) -> None:
    """Tabulate in the vector what filling costs at the station `model`."""
    paces = (Pace(0.0, 0.0, 0.0), Pace(1.0, 0.0, 0.0), Pace(0.0, 1.0, 0.0), Pace(0.0, 0.0, 1.0))
    stored = 0.0
    if not is_thesis(model):
        stored = math.inf
        for buffer in range(len(model.buffer_volume)):
            kept = vector[_REFERENCE + buffer]
            stored = min(stored, gas_pressure(kept, restored_temperature(model), model.buffer_volume[buffer], model))
    for place in range(len(paces)):
        begin = _TABLE + place * FILL_ROWS * POINTS
        cost = fill_cost(model, FILL_TEMPERATURE, vector[_USUAL], prices_of(vector, paces[place]), stored)
        vector[begin : begin + FILL_ROWS * POINTS] = cost.ravel()


@kernel
def demand_of(volume: float, finish: float, asked: float, settings: np.ndarray) -> Demand:
    """The vehicle connected, of `volume` [m3] up to `finish` [bar], and those to come, `asked` times the usual one.

    Where nobody says at which pressure the vehicle leaves (NaN) it is the usual one.
    """
    return Demand(
        volume,
        (finish if finish > 0.0 else settings[_USUAL + 1]) + FINISH_MARGIN,
        asked * settings[_USUAL],
        settings[_USUAL + 1] + FINISH_MARGIN,
        settings[_USUAL + 2],
        settings[_USUAL + 3],
    )


@kernel
def usual_demand_of(settings: np.ndarray) -> tuple[float, float]:
    """Volume of the usual vehicle times the rise of its pressure [m3 bar], and its finish pressure [bar]."""
    return settings[_USUAL] * (settings[_USUAL + 1] - settings[_USUAL + 2]), settings[_USUAL + 1]


@kernel
def terminal_costs_of(
    demand: Demand, model: Model, settings: np.ndarray
) -> tuple[TerminalCost, TerminalCost, TerminalCost]:
    """The constants of high, medium, and low: a plan restores `target_masses`."""
    return (
        terminal_cost_of(0, settings[_REFERENCE], demand, model),
        terminal_cost_of(1, settings[_REFERENCE + 1], demand, model),
        terminal_cost_of(2, settings[_REFERENCE + 2], demand, model),
    )


@kernel
def fills_of(settings: np.ndarray, pace: Pace) -> np.ndarray:
    """Cost of filling at a pace, as `fill_cost` tells it, (FILL_ROWS, POINTS)."""
    usual = settings[_TABLE:_SPARSE_TABLE]
    sparse = settings[_SPARSE_TABLE:_CROWDED_TABLE]
    crowded = settings[_CROWDED_TABLE:_LARGE_TABLE]
    large = settings[_LARGE_TABLE:PEAK]
    found = usual + pace.sparse * (sparse - usual) + pace.crowded * (crowded - usual) + pace.large * (large - usual)
    return found.reshape((FILL_ROWS, POINTS))


@kernel
def commands_of(settings: np.ndarray) -> np.ndarray:
    """The commands the station admits."""
    return settings[_LIST : _LIST + int(settings[_COMMANDS])].astype(np.int64)


@kernel
def blocks_of(settings: np.ndarray) -> np.ndarray:
    """Lengths of a plan's blocks [s]: those further ahead are longer."""
    found = np.empty(int(settings[BLOCKS]))
    for place in range(found.size):
        found[place] = settings[BLOCK] * (1.0 + place // EQUAL_BLOCKS)
    return found


@kernel
def first_gap_of(settings: np.ndarray) -> float:
    """Gap between arrivals believed before one is seen [s]."""
    return float(settings[_FIRST_GAP])
