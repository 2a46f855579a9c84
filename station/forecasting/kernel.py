"""The kernel of futures: seconds as every caller has them, of which sums and some pressures are kept, and no record."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from station.compiled import entry, inlined, numba_type, uncounted
from station.controller import CompiledController
from station.faults.plant import Rates
from station.geometry import BUFFERS, OUTLETS
from station.kernels import CONTROLLER, PARAMETERS, RATES, advance_second
from station.leaks import leak
from station.run import CLOCK, CONNECTED_VEHICLE, PERIOD, PRESSURE, PREVIOUS, ROW, RunParameters
from station.valves import count_inlets

COUNTED = 4
"""Entries of a row of `Tally.counts`."""

SECOND, SPAN, COMPRESSING, SHORTAGE = range(COUNTED)
"""What these are: seconds that are over, the span of the last, compressor-seconds, seconds in which a vehicle was
connected and no outlet open."""

_BUFFERS = len(BUFFERS)


class Futures(NamedTuple):
    """Futures in progress that begin at the same time, a row each."""

    states: np.ndarray  # (futures, state) as RunState.state, and room for the plant's notes
    counters: np.ndarray  # (futures, 5) as RunState.counters
    vehicles: np.ndarray  # (futures, vehicle columns, most vehicles)
    sizes: np.ndarray  # (futures,) how many vehicles each has
    memories: np.ndarray  # (futures, memory) of the controller
    fallbacks: np.ndarray  # (futures, memory) of its fallback


class Meter(NamedTuple):
    """How electric energy is counted."""

    columns: np.ndarray  # (powers,) columns of a record that are electric powers [kW]; none: by the valves
    compressor: float  # then each compressor at work takes so much [kW]
    precooler: float  # and the precooler so much while an outlet is open [kW]
    begins: np.ndarray  # (spans,) the seconds with which spans begin that are counted apart; the first is 0


class Tally(NamedTuple):
    """Sums and pressures of futures."""

    pressures: np.ndarray  # (futures, times, buffers) each `grid` seconds from the begin on [bar]
    spent: np.ndarray  # (futures, spans) electric energy [kW s]
    counts: np.ndarray  # (futures, COUNTED)


class Row(NamedTuple):
    """Room for the row that a second writes."""

    values: np.ndarray  # (value columns, 1)
    codes: np.ndarray  # (len(CODES), 1)
    counts: np.ndarray  # (len(COUNTS), 1)


@inlined
def _power(command: int, values: np.ndarray, meter: Meter) -> float:
    """Electric power in the second whose row has been written [kW]."""
    if meter.columns.size == 0:
        return meter.compressor * count_inlets(command) + (meter.precooler if command & OUTLETS else 0.0)
    total = 0.0
    for place in range(meter.columns.size):
        total += values[meter.columns[place], 0]
    return total


@inlined
def _count(
    command: int, connected: bool, values: np.ndarray, meter: Meter, spent: np.ndarray, counts: np.ndarray
) -> None:  # fmt: skip
    """Count a second that is over."""
    if counts[SPAN] + 1 < meter.begins.size and counts[SECOND] >= meter.begins[counts[SPAN] + 1]:
        counts[SPAN] += 1
    spent[counts[SPAN]] += PERIOD * _power(command, values, meter)
    counts[COMPRESSING] += count_inlets(command)
    counts[SHORTAGE] += 1 if connected and command & OUTLETS == 0 else 0
    counts[SECOND] += 1


@uncounted
def _run_on(
    futures: Futures, parameters: RunParameters, controller: CompiledController, fallback: CompiledController,
    until: float, rates: Rates, meter: Meter, grid: int, tally: Tally, row: Row,
) -> None:  # fmt: skip
    values, codes, rows = row
    decide, model, settings, _, obeys_hold, wake_pressure = controller
    leaks = max(rates) > 0.0
    for number in range(futures.sizes.size):
        state, counters, counts = futures.states[number], futures.counters[number], tally.counts[number]
        vehicles = futures.vehicles[number][:, : futures.sizes[number]]
        memory, pressures, spent = futures.memories[number], tally.pressures[number], tally.spent[number]
        behind = CompiledController(
            fallback.decide, fallback.model, fallback.settings, futures.fallbacks[number], fallback.obeys_hold,
            fallback.wake_pressure,
        )  # fmt: skip
        going = True
        while going and state[CLOCK] < until:
            counters[ROW] = 0
            going = advance_second(
                state, counters, vehicles, values, codes, rows, parameters, decide, model, settings, memory,
                obeys_hold, wake_pressure, behind,
            )  # fmt: skip
            if counts[SECOND] % grid == 0:
                for buffer in range(_BUFFERS):
                    pressures[counts[SECOND] // grid, buffer] = values[PRESSURE + buffer, 0]
            if going:
                _count(counters[PREVIOUS], rows[CONNECTED_VEHICLE, 0] >= 0, values, meter, spent, counts)
                if leaks:
                    leak(state, counters, vehicles, values, rates, parameters)


_ROWS, _NUMBERS = np.zeros((1, 1)), np.zeros((1, 1), np.int64)
_KINDS = (
    numba_type(Futures(_ROWS, _NUMBERS, np.zeros((1, 1, 1)), _NUMBERS[0], _ROWS, _ROWS)),
    numba_type(1.0),
    RATES,
    numba_type(Meter(_NUMBERS[0], 1.0, 1.0, _NUMBERS[0])),
    numba_type(1),
    numba_type(Tally(np.zeros((1, 1, 1)), _ROWS, _NUMBERS)),
    numba_type(Row(_ROWS, np.zeros((1, 1), np.uint8), np.zeros((1, 1), np.int32))),
)


@entry(*((_KINDS[0], each, CONTROLLER, CONTROLLER, *_KINDS[1:]) for each in PARAMETERS))
def run_futures(
    futures: Futures, parameters: RunParameters, controller: CompiledController, fallback: CompiledController,
    until: float, rates: Rates, meter: Meter, grid: int, tally: Tally, row: Row,
) -> None:  # fmt: skip
    """Run each future on to a time [s], or to its end where that is before; buffers leak at `rates` [g/s].

    Seconds are those of `station.kernels`, and none is passed over: `parameters` have an idle period of one. Each
    writes its row over that of the one before.
    """
    _run_on(futures, parameters, controller, fallback, until, rates, meter, grid, tally, row)
