"""A memory of a station's valves, and which of them stick. Kernels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from station.compiled import inlined
from station.geometry import BUFFERS, VALVES
from station.sensor_names import ANALOG

SEAT = 2 * len(VALVES)
METER = SEAT + 4 * len(BUFFERS)
KNOWN = METER + 3 * 2
FINE = KNOWN + 2
WORKS = FINE + 2
AGREED = WORKS + len(VALVES)
STUCK = AGREED + len(BUFFERS)
"""Columns of a judged second: of each valve 1 where it is stuck open, -1 closed, else 0; of each the seconds since it
was where it is found, else NaN. From SEAT on, of each outlet: the seconds since it is not tight where that is found, 1
where it lasts and LETS_OTHER where it is found to let more or less through than before, what it seems to let through
and the standard deviation of that [g/s]; NaN elsewhere. From METER on, of both flow meters: what is known of it, by how
much it is off [g/s] or drifts [g/s/h], the seconds since it is where that is found, else NaN. From KNOWN on, of both:
SEEN_RIGHT where it is right, or was seen in this second by how much it is off, and SEEN_OTHER where that is other than
was thought. From FINE on, of both: the seconds since it did not drift yet, where that is found, else NaN. From WORKS
on, of each valve that is found to be stuck: the seconds since it was last seen to do what it was told, inf where it
never was; NaN elsewhere. From AGREED on, of each outlet that is found to let more or less through: the seconds since
the last visit began in which it did not yet; NaN elsewhere."""

SEEN_RIGHT, SEEN_OTHER, LETS_OTHER = 1.0, 2.0, 2.0

SWITCHES = 10.0
"""From one valve to the next in so long [s]."""

MANY, WITHIN, DISTRUSTED = 3.0, 3600.0, 86_400.0
"""If more seem to stick than so many within so long, a clock or a tag is wrong: for so long none is looked for [s]."""

UNTOLD = 12
"""Seconds for which the valves of a side count as untold once one is found stuck: what flowed before is not known, and
buffers begin anew by their readings."""

CLEAR = 6.0
"""A pressure that changed by so many standard deviations did so surely."""

ROOM = 30.0
"""Through an open outlet gas flows if the vehicle is so far below its buffer [bar]."""

AVERAGED = 300.0
"""Seconds of which the mean is what a side usually gives, and second differences how a pressure spreads."""

READINGS = 3
"""Pressures that are averaged at either end of a stretch."""

RESTS, LIKELY, LONGEST_REST = 10.0, 3.0, 60.0
"""A pressure that has read one value for longer [s], and so many times as long as it did before, up to so long [s], may
be stuck: that it does not move says nothing."""

WARMTH, USUAL = 5.0, 298.15
"""Readings of a thermometer that are averaged [1], and the temperature of `EstimationModel.grams_of` [K]."""

PROVED = 3.0
"""Seconds in which a valve that was stuck must work to be right again [s]."""

EDGES = 15
"""Seconds at either end of a side's rest in which its meter may read a flow: lines empty, and a clock may be off."""

FIRST_VALVE, METERS = len(ANALOG), ANALOG.index("flow_compressor")
"""Places of the valves and of the two flow meters among SENSORS."""

BANKS = len(BUFFERS)


class ValveMemory(NamedTuple):
    """Memory of the valves; all float64. Sides: compressors and dispenser."""

    told: np.ndarray  # (6,) as last told
    heard: np.ndarray  # (6,) seconds since then
    vehicle: np.ndarray  # (1,) the vehicle as last told; -1: none
    pressure: np.ndarray  # (4,) as last read [bar]
    fresh: np.ndarray  # (4,) 1: read in this second, and not only told again
    rest: np.ndarray  # (3, 2) of a buffer: seconds since it read another pressure, and most before, see `may_rest`
    smooth: np.ndarray  # (3,) of the buffers, the mean of the last few readings [bar]
    kelvin: np.ndarray  # (3,) and of their thermometers [K]; NaN where none was read
    rough: np.ndarray  # (3, 3) of a buffer: its last two readings, and the variance that they seem to have [bar2]
    again: np.ndarray  # (2, 3) of a meter: its last reading, how often in a row, and how often a flow at most was
    since: np.ndarray  # (1,) seconds since the command or the vehicle changed, but for an inlet that goes to and fro
    inlet: np.ndarray  # (2,) the inlet meanwhile open alone, -1: none, -2: several; seconds since inlets changed
    flow: np.ndarray  # (2, 2) of a side: sum of its readings in the stretch, and how many
    first: np.ndarray  # (3, 3) of a buffer: sum of its first readings in the stretch, how many, sum at USUAL
    last: np.ndarray  # (3, 2 READINGS + 1) its last readings, how many there were, and they at USUAL
    usual: np.ndarray  # (2, 2) what a side gives while it gives [g/s], and from how many readings
    filled: np.ndarray  # (3,) the largest pressure at which a buffer was seen to be filled [bar]
    gave: np.ndarray  # (2, 2) of a side: seconds since it last gave, and through which valve
    silent: np.ndarray  # (6,) seconds in which a valve, alone told open, has given nothing since it last gave
    beside: np.ndarray  # (6,) of them those in which another of its side had given just before
    start: np.ndarray  # (6,) the pressure of its buffer when that began [bar]
    still: np.ndarray  # (6,) 1: it has not moved since, as it would have if gas had flowed
    giving: np.ndarray  # (6,) seconds in which it has given since it opened
    after: np.ndarray  # (6,) 1 + v: it opened just after v was silent; 0: it did not
    closed: np.ndarray  # (2, 2) of a side: the valve that was last open alone, and seconds since then
    position: np.ndarray  # (6,) 1: stuck open, -1: closed
    works: np.ndarray  # (6, 2) seconds since a valve was last seen to be open as it is told, and closed; inf: never
    moved: np.ndarray  # (6,) seconds in a row in which a stuck one seems to work
    untold: np.ndarray  # (2,) seconds for which a side's valves count as untold
    doubt: np.ndarray  # (2,) how many were found lately, and for how long none is to be found [s]
    shut: np.ndarray  # (3,) seconds for which both valves of a buffer are told to be closed
    stretch: np.ndarray  # (3, 7) of closed buffers, see `station.estimation.valves.seats`: kind of the stretch, its
    # seconds and readings; sums of times, masses, squares of times, products
    heavy: np.ndarray  # (3, 4) its last two masses in the stretch [g], the variance that they seem to have [g2]; the
    # thermometer's last reading [K]
    pooled: np.ndarray  # (3, 2, 2) of both kinds, of stretches that ended: squares of times [s2], products [g s]
    newest: np.ndarray  # (3, 2, 2) the same of the newest visit, and behind it
    ring: np.ndarray  # (3, EDGES) of both flow meters the last readings [g/s]; the place of the oldest
    meter: np.ndarray  # (2, 15) of `station.estimation.valves.meters`: what is known of a meter, how much it is off at
    # rest [g/s] and the variance of that, readings of it; seconds at rest, since the last such reading, since it was
    # right; how much it was off when that was seen, the seconds since then; how much more it is off a second [g/s2];
    # the last such reading, and the last of all [g/s]; readings in a row that were less than nothing, 1 where
    # the last one was other than those before; short rests in which it read nothing while it was right
    fed: np.ndarray  # (4,) while the dispenser's meter reads no flow: the vehicle's pressure when that began [bar], the
    # seconds since then (-inf: it read one in this visit), those in which it was filled meanwhile, 1 once that is sure
    turn: np.ndarray  # (4,) the outlet last open alone, -1: none; what the meter read [g/s], and seconds since then; by
    # how much more flowed before this turn than pressures make it, NaN: nobody knows
    turns: np.ndarray  # (3, 3) of an outlet: how many turns say that it is stuck open, seconds since the first, and
    # how many in a row do not
    earlier: np.ndarray  # (3, 2) and before it, without a vehicle
    seat: np.ndarray  # (3, 7) 1: an outlet is not tight; seconds since it seems so; 1: the newest visit is judged;
    # seconds since that began; what it lets through and the variance of that, once that is known [g/s], else NaN and 0;
    # seconds since the last visit began in which it did


def none_found(seconds: int) -> np.ndarray:
    """Seconds in which no valve sticks, (seconds, STUCK)."""
    return np.hstack([np.zeros((seconds, len(VALVES))), np.full((seconds, STUCK - len(VALVES)), np.nan)])


def valves_of_nothing() -> ValveMemory:
    """Before the first second."""
    return ValveMemory(*(array.copy() for array in _NOTHING))


_NOTHING = ValveMemory(
    np.zeros(6), np.full(6, np.inf), np.full(1, -1.0), np.full(4, np.nan), np.zeros(4),
    np.zeros((3, 2)), np.full(3, np.nan), np.full(3, np.nan), np.array([[np.nan, np.nan, 0.0]] * 3),
    np.zeros((2, 3)), np.zeros(1), np.array([-1.0, np.inf]), np.zeros((2, 2)), np.zeros((3, 3)),
    np.zeros((3, 2 * READINGS + 1)), np.zeros((2, 2)), np.zeros(3),
    np.full((2, 2), np.inf), np.zeros(6), np.zeros(6), np.zeros(6), np.zeros(6), np.zeros(6), np.zeros(6),
    np.array([[-1.0, np.inf], [-1.0, np.inf]]), np.zeros(6), np.full((6, 2), np.inf), np.zeros(6), np.zeros(2),
    np.zeros(2), np.zeros(3), np.array([[-1.0, *(0.0 for _ in range(6))]] * 3),
    np.array([[np.nan, np.nan, 0.0, 0.0]] * 3), np.zeros((3, 2, 2)), np.zeros((3, 2, 2)),
    np.vstack([np.full((2, EDGES), np.nan), np.zeros((1, EDGES))]), np.zeros((2, 15)),
    np.array([np.nan, 0.0, 0.0, 0.0]), np.array([-1.0, 0.0, np.inf, np.nan]), np.zeros((3, 3)), np.zeros((3, 2)),
    np.array([[0.0, 0.0, 0.0, 0.0, np.nan, 0.0, 0.0]] * 3),
)  # fmt: skip


@inlined
def alone(m: ValveMemory, side: int) -> int:
    """The valve of a side that alone is open, or -1 where there is none or one of the three is not known."""
    found, count = -1, 0
    for v in range(BANKS * side, BANKS * (side + 1)):
        if m.heard[v] > SWITCHES:
            return -1
        if m.told[v] > 0.0:
            found, count = v, count + 1
    return found if count == 1 else -1


@inlined
def may_rest(m: ValveMemory, bank: int) -> bool:
    """Whether a buffer's pressure may be one that does not move, and not a sensor that is stuck."""
    return bool(m.rest[bank, 0] <= max(RESTS, LIKELY * m.rest[bank, 1]))


@inlined
def find_stuck(m: ValveMemory, valve: int, position: float, ago: float, judged: np.ndarray) -> None:
    """A valve is found to be stuck, if not too many were."""
    if m.doubt[1] > 0.0:
        return
    m.doubt[0] += 1.0
    if m.doubt[0] > MANY:
        m.doubt[0], m.doubt[1] = 0.0, DISTRUSTED
        m.position[:] = 0.0
        return
    m.position[valve], m.moved[valve] = position, 0.0
    m.untold[valve // BANKS] = UNTOLD
    judged[len(VALVES) + valve] = ago
    judged[WORKS + valve] = m.works[valve, 1 if position > 0.0 else 0]


@inlined
def works_again(m: ValveMemory, valve: int) -> None:
    """A valve that was stuck works again."""
    m.position[valve], m.silent[valve], m.beside[valve] = 0.0, 0.0, 0.0
    m.untold[valve // BANKS] = UNTOLD
