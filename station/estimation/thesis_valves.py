"""Valves of the thesis's plant in its filter: as told, or as flow meters say."""

from __future__ import annotations

import numpy as np

from station.compiled import inlined
from station.estimation.thesis_states import Scratch
from station.sensor_names import ANALOG

_VALVES = len(ANALOG)
_CLEAR = 8.0  # standard deviations between two readings of flow that tell whether a valve is open
_USUAL = 30.0  # how often a valve moves is told by so many of the seconds that tell it


@inlined
def _is_open(s: Scratch, v: int) -> bool:
    """Whether a valve was told to be open."""
    return s.unseen[v] == 0.0 and s.valve[v] != 0.0


@inlined
def _bar(s: Scratch, most: tuple[int, int], flowed: tuple[bool, bool]) -> None:
    """What was told to be open keeps closed what nobody told, Eqs (7.17)-(7.19).

    `most` inlets and outlets are open at once. Where gas flowed on a side, and what let it through was told to be
    closed, it may flow through what nobody told.
    """
    for side in range(2):
        first, count = 3 * side, 0
        for v in range(first, first + 3):
            count += 1 if _is_open(s, v) else 0
        for v in range(first, first + 3):
            if s.unseen[v] == 0.0:
                continue
            if count >= most[side] or _is_open(s, (v + 3) % 6):
                s.valve[v], s.unseen[v] = 0.0, 0.0
            elif count == 0 and flowed[side] and s.valve[v] == 0.0:
                s.moved[v] = 1.0


@inlined
def read_valves(s: Scratch, values: np.ndarray, coming: np.ndarray, inlets_max: int) -> None:
    """Valves as told; of one that nobody told, how likely it is not as it was before.

    Where the next second says what the second before said, it would have changed twice. No more than `inlets_max`
    inlets are open at once.
    """
    inlets, outlets = s.valve[0] + s.valve[1] + s.valve[2], s.valve[3] + s.valve[4] + s.valve[5]
    for v in range(6):
        told, then = values[_VALVES + v], coming[_VALVES + v]
        s.unseen[v] = 1.0 if np.isnan(told) else 0.0
        if np.isnan(told):
            same = not np.isnan(then) and (then >= 0.5) == (s.valve[v] != 0.0)
            s.moved[v] = s.moving[v] if same else 1.0
        else:
            is_open = 1.0 if told >= 0.5 else 0.0
            s.moving[v] += (abs(is_open - s.valve[v]) - s.moving[v]) / _USUAL
            s.valve[v] = is_open
    _bar(s, (inlets_max, 1), (inlets > 0.0, outlets > 0.0))


@inlined
def _possible(s: Scratch, first: int, opened: int) -> bool:
    """Whether what was told of three valves allows these to be open."""
    for v in range(3):
        if s.unseen[first + v] == 0.0 and (opened >> v & 1 != 0) != (s.valve[first + v] != 0.0):
            return False
    return True


@inlined
def infer(s: Scratch, first: int, read: float, noise: float, relative: float) -> None:
    """Take of three valves that nobody told what the flow meter read says of them, if it says so clearly."""
    if s.unseen[first] + s.unseen[first + 1] + s.unseen[first + 2] == 0.0 or np.isnan(read):
        return
    best, second, chosen, spread = np.inf, np.inf, 0, noise
    for opened in range(8):
        if _possible(s, first, opened):
            flow = 0.0
            for v in range(3):
                flow += s.flow[first + v] * (opened >> v & 1)
            off = abs(read - flow)
            if off < best:
                best, second, chosen, spread = off, best, opened, np.sqrt(noise**2 + (relative * flow) ** 2)
            elif off < second:
                second = off
    if second - best >= _CLEAR * spread:
        for v in range(3):
            s.valve[first + v], s.unseen[first + v] = float(chosen >> v & 1), 0.0
