"""Valves in a second, in the filter of the faithful plant: as told, as the meters say, or as before."""

from __future__ import annotations

import numpy as np

from station.compiled import uncounted
from station.estimation.real_gas.states import Scratch
from station.geometry import VALVES
from station.sensor_names import ANALOG

_FLOW_C, _FLOW_D = ANALOG.index("flow_compressor"), ANALOG.index("flow_dispenser")
_VALVES = len(ANALOG)
_NOTHING = 0.2  # of what the meter read last of an open inlet, up to which nothing flows [1]
_CLOSE = 0.3  # a flow is that of so many inlets if it lies within this part of an inlet's [1]
_USUAL = 30.0  # how often a valve moves is told by so many of the seconds that tell it
_RESTLESS = 0.01  # one that moves less often than so much in a second stands still [1]
_OFTEN = 0.1  # one that moves as often as that may have moved twice between two seconds that tell the same [1]

FLOWS = 6.0
"""A meter that reads more than so many standard deviations of its absolute noise says that gas flows."""


@uncounted
def _counted(s: Scratch, values: np.ndarray, first: int) -> tuple[int, int, int, int]:
    """How many of three valves are open as told, were not told, are not seen, and are open as before."""
    told_open, untold, unseen, supposed = 0, 0, 0, 0
    for v in range(first, first + 3):
        is_open = 1 if s.valve[v] != 0.0 else 0
        if not np.isnan(values[_VALVES + v]):
            told_open += is_open
            continue
        untold += 1
        if s.unseen[v] != 0.0:
            unseen += 1
        else:
            supposed += is_open
    return told_open, untold, unseen, supposed


@uncounted
def _say(s: Scratch, values: np.ndarray, first: int, unseen_ones: bool, is_open: float) -> None:
    """What is known after all of the valves that nobody told, or of those alone that are not seen."""
    for v in range(first, first + 3):
        if np.isnan(values[_VALVES + v]) and (s.unseen[v] != 0.0 or not unseen_ones):
            s.valve[v], s.unseen[v] = is_open, 0.0


@uncounted
def _suppose(s: Scratch, first: int) -> None:
    """Where gas flows through one of several valves that are not seen it is the likeliest; that it is stays unseen."""
    likeliest = first
    for v in range(first, first + 3):
        if s.unseen[v] > s.unseen[likeliest]:
            likeliest = v
    s.valve[likeliest] = 1.0


@uncounted
def _settle(
    s: Scratch, values: np.ndarray, first: int, meter: float, noise: float, nothing: float, count: int, hidden: bool,
    lasts: bool,
) -> None:  # fmt: skip
    """Where nobody told some of three valves, what the others and the flow meter say of them, if they say so clearly.

    No more than `count` are open at once. A flow that no other valve lets through goes through the one that nobody
    told, whatever it was before: a valve may be open for a single second. `hidden`: where the meter is silent too,
    what may have flowed is not seen; `lasts`: it flowed a second before and a second later, and so does it in between.
    `nothing` [g/s]: a reading up to which nothing flows.
    """
    told_open, untold, unseen, supposed = _counted(s, values, first)
    if untold == 0:
        return
    if told_open >= count > 0 or meter <= nothing:
        _say(s, values, first, False, 0.0)
        return
    silent = hidden and np.isnan(meter)
    if told_open + supposed > 0 or not (silent or meter > 0.0):
        return
    sure = meter > FLOWS * noise
    if unseen == 1 and not silent:
        _say(s, values, first, True, 1.0)
    elif unseen > 0 and (sure or (silent and lasts)):
        _suppose(s, first)
    elif untold == 1 and sure:
        _say(s, values, first, False, 1.0)
    elif silent or (unseen == 0 and sure):
        for v in range(first, first + 3):
            s.unseen[v] = 1.0 if np.isnan(values[_VALVES + v]) else s.unseen[v]


@uncounted
def _note_share(s: Scratch, values: np.ndarray) -> None:
    """Note what the meter reads of an open inlet, where all of them were told."""
    told_open, untold, _, _ = _counted(s, values, 0)
    if untold == 0 and told_open > 0 and values[_FLOW_C] > 0.0:
        s.share[0] = values[_FLOW_C] / told_open


@uncounted
def _count_inlets(s: Scratch, values: np.ndarray) -> None:
    """How many inlets are open at once, by what the meter read of one before; where it says so of all that are untold.

    A compressor gives nearly the same to every bank.
    """
    told_open, untold, _, _ = _counted(s, values, 0)
    meter = values[_FLOW_C]
    if np.isnan(meter) or meter <= 0.0 or untold == 0 or s.share[0] <= 0.0:
        return
    open_ones = np.round(meter / s.share[0])
    if abs(meter / s.share[0] - open_ones) <= _CLOSE and open_ones - told_open in (0.0, float(untold)):
        _say(s, values, 0, False, 1.0 if open_ones > told_open else 0.0)


@uncounted
def _doubt_inlets(s: Scratch, values: np.ndarray, compressors: int, flowed: bool, lasts: bool) -> None:
    """What may have flowed in through what nobody told in a second in which the meter is silent too is not seen.

    Through an inlet that moves often, or any where what let gas through was just told to be closed (`flowed`). Where
    it flows a second later as well (`lasts`), it does in between.
    """
    told_open, untold, unseen, supposed = _counted(s, values, 0)
    if not np.isnan(values[_FLOW_C]) or untold == 0 or told_open >= compressors:
        return
    for v in range(len(VALVES) // 2):
        if np.isnan(values[_VALVES + v]) and s.unseen[v] == 0.0:
            likely = 1.0 if flowed and told_open == 0 and s.valve[v] == 0.0 else s.moving[v]
            s.unseen[v] = np.sqrt(likely) if likely >= _RESTLESS else 0.0
    if lasts and unseen > 0 and told_open + supposed == 0:
        _suppose(s, 0)


@uncounted
def _is_told_open(values: np.ndarray, first: int) -> bool:
    """Whether one of three valves is told to be open."""
    told = (values[_VALVES + first] >= 0.5, values[_VALVES + first + 1] >= 0.5, values[_VALVES + first + 2] >= 0.5)
    return bool(told[0] or told[1] or told[2])


@uncounted
def _moved_twice(moving: float) -> float:
    """The root of how likely a valve that is as it was a second before and is so a second later was not in between."""
    if moving < _OFTEN:
        return 0.0
    return float(moving / np.hypot(moving, 1.0 - moving))


@uncounted
def read_valves(
    s: Scratch, values: np.ndarray, noise: np.ndarray, coming: np.ndarray, connected: bool, compressors: int
) -> int:
    """The command of a second: as told, as the meters say, or as before.

    Of a valve that seldom moves the next second tells as well, if it says the same as the one before.
    """
    flowed = (s.valve[0] + s.valve[1] + s.valve[2] > 0.0, s.valve[3] + s.valve[4] + s.valve[5] > 0.0)
    lasts = (flowed[0] and _is_told_open(coming, 0), flowed[1] and _is_told_open(coming, 3))
    for v in range(len(VALVES)):
        told = values[_VALVES + v]
        then = coming[_VALVES + v]
        if not np.isnan(told):
            is_open = 1.0 if told >= 0.5 else 0.0
            s.moving[v] += (abs(is_open - s.valve[v]) - s.moving[v]) / _USUAL
            s.valve[v], s.unseen[v] = is_open, 0.0
        else:
            same = not np.isnan(then) and (then >= 0.5) == (s.valve[v] != 0.0)
            s.unseen[v] = _moved_twice(s.moving[v]) if same else 1.0
    _note_share(s, values)
    _settle(s, values, 0, values[_FLOW_C], noise[_FLOW_C], _NOTHING * s.share[0], compressors, False, lasts[0])
    if compressors > 1:
        _count_inlets(s, values)
    _doubt_inlets(s, values, compressors, flowed[0], lasts[0])
    _settle(s, values, 3, values[_FLOW_D] if connected else 0.0, noise[_FLOW_D], 0.0, 1, True, lasts[1])
    command = 0
    for v in range(len(VALVES)):
        command |= (1 if s.valve[v] != 0.0 else 0) << v
    return command
