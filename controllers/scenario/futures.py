"""Futures: what the gaps and start pressures seen so far leave open, drawn from a generator that counts.

Gaps between arrivals are exponential with an unknown rate. After n gaps of the sum s, one of them the gap believed
before any is seen, and w seconds since the last arrival, the rate has the law Gamma(n, s + w), and the next arrival
is later than x with the chance ((s + w) / (s + w + x))^n.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from station.compiled import inlined, kernel
from station.controller import Observation

GAPS = 32
"""Gaps remembered: the last ones."""

PRESSURES = 16
"""Start pressures remembered: the last ones."""

BELIEF_SIZE = 3 + GAPS + 1 + PRESSURES
"""Entries of memory `watch` uses: arrivals seen, vehicles connected, whether it has begun; their times; pressures."""

_SEEN, _CONNECTED, _BEGUN, _TIMES = 0, 1, 2, 3
_PRESSURES = _TIMES + GAPS + 1

_ADD, _ONE, _TWO = 0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB


class Belief(NamedTuple):
    """Uncertain parts of the future: the law of the rate of arrivals, and where start pressures come from."""

    gaps: float  # shape of the rate's law
    seconds: float  # its scale is one by this [s]
    announced: int  # vehicles that have said when they come
    usual: float  # start pressure [bar]
    spread: float  # half-width of it [bar]
    seen: np.ndarray  # start pressures seen [bar]


class Futures(NamedTuple):
    """Some futures: when vehicles come and with which pressures; row by row."""

    due: np.ndarray  # (S, n) from now, in order [s]
    pressure: np.ndarray  # (S, m) of those connected next [bar]


@kernel
def watch(observation: Observation, memory: np.ndarray) -> None:
    """Note the arrivals and the start pressures this second shows; `memory` (BELIEF_SIZE,) belongs to this module."""
    if memory[_BEGUN] == 0.0:
        memory[_CONNECTED], memory[_BEGUN] = -1.0, 1.0
    if observation.vehicle < 0:
        return
    arrived = observation.vehicle + 1.0 + observation.queue_length
    while memory[_SEEN] < arrived:
        memory[_TIMES + int(memory[_SEEN]) % (GAPS + 1)] = observation.time
        memory[_SEEN] += 1.0
    if observation.vehicle > memory[_CONNECTED]:
        memory[_CONNECTED] = observation.vehicle
        memory[_PRESSURES + observation.vehicle % PRESSURES] = observation.vehicle_pressure


@kernel
def belief_of(observation: Observation, first_gap: float, usual: float, spread: float, memory: np.ndarray) -> Belief:
    """Posterior after all that was observed.

    `first_gap` [s] counts as one gap, a start `spread` around `usual` [bar] as one of those seen.
    """
    seen = int(memory[_SEEN])
    gaps = min(max(seen - 1, 0), GAPS)
    seconds, since = 0.0, observation.time
    if seen > 0:
        last = memory[_TIMES + (seen - 1) % (GAPS + 1)]
        seconds = last - memory[_TIMES + (seen - 1 - gaps) % (GAPS + 1)]
        since = observation.time - last
    announced = 0
    for time in observation.announced:
        announced += 1 if time < np.inf else 0
    starts = memory[_PRESSURES : _PRESSURES + min(int(memory[_CONNECTED]) + 1, PRESSURES)]
    return Belief(gaps + 1.0, first_gap + seconds + since, announced, usual, spread, starts)


@inlined
def uniform(key: int, place: int) -> float:
    """Number `place` of the sequence of a key, in (0, 1): splitmix64 (doi:10.1145/2660193.2660195)."""
    mixed = np.uint64(key) + np.uint64(place + 1) * np.uint64(_ADD)
    mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(_ONE)
    mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(_TWO)
    mixed ^= mixed >> np.uint64(31)
    return (np.float64(mixed >> np.uint64(11)) + 0.5) * 2.0**-53


@kernel
def quantile(level: float, belief: Belief) -> float:
    """In how many seconds the next arrival not announced has come with this chance [s]."""
    return belief.seconds * ((1.0 - level) ** (-1.0 / belief.gaps) - 1.0)


@kernel
def announced_of(observation: Observation, due: np.ndarray) -> float:
    """Write when announced vehicles come into the beginning of `due` [s]; gives the time of the last, or 0."""
    last, place = 0.0, 0
    for time in observation.announced:
        if time < np.inf and place < due.size:
            last = max(0.0, time - observation.time)
            due[place] = last
            place += 1
    return last


@kernel
def branch_of(observation: Observation, belief: Belief, level: float, due: np.ndarray) -> None:
    """Write into `due` (n,) the announced arrivals, the next at a quantile, and more a mean gap apart [s]."""
    last = announced_of(observation, due) + quantile(level, belief)
    for place in range(belief.announced, due.size):
        due[place] = last
        last += belief.seconds / belief.gaps


@kernel
def draw(
    observation: Observation, belief: Belief, count: int, arrivals: int, starts: int, key: int, place: int
) -> tuple[Futures, int]:
    """`count` independent futures and the next place in the sequence of `key`, from `place` on."""
    due, pressure = np.empty((count, arrivals)), np.empty((count, starts))
    for future in range(count):
        last = announced_of(observation, due[future])
        rate = 0.0
        for _ in range(int(belief.gaps)):
            rate -= math.log(uniform(key, place))
            place += 1
        for later in range(belief.announced, arrivals):
            last -= math.log(uniform(key, place)) * belief.seconds / rate
            due[future, later] = last
            place += 1
        for vehicle in range(starts):
            chosen = int(uniform(key, place) * (belief.seen.size + 1))
            level = 2.0 * uniform(key, place + 1) - 1.0
            place += 2
            start = belief.usual + belief.spread * level
            pressure[future, vehicle] = belief.seen[chosen] if chosen < belief.seen.size else start
    return Futures(due, pressure), place
