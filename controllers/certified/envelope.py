"""One fill and what follows it under the reserve rule, enclosed for a whole cell of states at once.

Every quantity is a bound in the grams delivered so far, X: the buffer that dispenses has lost X less what those before
it gave, and the vehicle has gained X, so that the pressure gap is a falling function of X in every stage. X then has a
least course: the next X rises with X (`Station.check_tank` keeps a second's flow below the pressure difference), so the
least X a second on is the least over the stages that are possible, each begun at the least X it can be begun with. No
branch is followed: which second a stage ends in need not be known.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from controllers.certified.tank import OUTWARD, Tank
from station.compiled import kernel
from station.plant import KELVIN, PlantConstants

HIGH, MEDIUM, LOW = 0, 1, 2

# What became of a cell.
SERVED, STUCK, FLOW, HEAT, LATE, UNRECOVERED = range(6)
OUTCOMES = (
    "served", "high could come too close to the vehicle", "the flow limit could close high or medium or low",
    "the vehicle could become too warm", "not finished within T", "not back in the box s after it was connected",
)  # fmt: skip

# Rows of a cell: pressure and temperature of each buffer, low and high end; pressure of the vehicle.
CELL = 14

# Columns of a result.
OUTCOME, FILL, GAP, LEAST_P, LEAST_T, MOST_P, MOST_T = 0, 1, 2, 3, 6, 9, 12
RESULT = 15


class Task(NamedTuple):
    """What is to be proved, of which vehicle, and the settings of the rule."""

    start: float  # mass of the vehicle that connects [g]
    temperature: float  # its temperature [deg C]
    volume: float  # [m3]
    finish: float  # pressure at which it leaves [bar]
    within: int  # T [s]
    spacing: int  # s [s]
    gap: float  # at which low and medium hand it on [bar]
    stop: float  # pressure of a full buffer [bar]
    slot: int  # turn of a buffer while nobody is connected [s]
    aim: float  # pressure of high up to which its filling is counted during a fill [bar]
    back: tuple[float, float, float]  # pressures that the buffers must be back at [bar]


class Course(NamedTuple):
    """Bounds on X and on the X at which medium's and high's stages began [g]; inf and 0 where none can have begun."""

    least: float
    most: float
    medium_from: float
    medium_to: float
    high_from: float
    high_to: float
    low_over: bool  # low's stage is over for certain
    medium_over: bool


class Gaps(NamedTuple):
    """Pressure gaps of a second [bar]."""

    closest: float  # least of high, where high may dispense
    widest: float  # greatest of all


@kernel
def _gap(pressure: float, taken: float, drop: float, x: float, rise: float, start: float) -> float:
    """Gap [bar] at X = x of a buffer that would stand at `pressure` with the `taken` grams it has given."""
    return pressure - taken * drop - (start + x) * rise


@kernel
def _end(pressure: float, offset: float, drop: float, rise: float, start: float, gap: float) -> float:
    """The X at which the gap of a buffer that began at X = offset has fallen to `gap`."""
    return (pressure + offset * drop - start * rise - gap) / (drop + rise)


@kernel
def _low_stage(
    course: Course, low: Tank, density: float, rise: float, task: Task, flow: float
) -> tuple[Course, float, float, float]:
    """Course with medium's beginning; least and greatest X a second on of those in low's stage; the widest gap."""
    least, most = course.least, course.most
    steep, flat = density * (low.warm + KELVIN), density * (low.cold + KELVIN)
    if course.low_over:
        return course, np.inf, most, 0.0
    ends_from = max(_end(low.low, 0.0, steep, rise, task.start, task.gap), 0.0)
    ends_to = _end(low.high, 0.0, flat, rise, task.start, task.gap)
    medium_from, medium_to = course.medium_from, course.medium_to
    if most >= ends_from:
        medium_from = min(medium_from, max(ends_from, least))
    over = least > ends_to
    next_least, next_most, widest = np.inf, most, 0.0
    if not over:
        widest = _gap(low.high, least, flat, least, rise, task.start)
        next_least = least + flow * max(task.gap, _gap(low.low, least, steep, least, rise, task.start))
        top = min(most, ends_to)
        leaves = top + flow * max(_gap(low.high, top, flat, top, rise, task.start), 0.0)
        medium_to, next_most = max(medium_to, leaves), max(most, leaves)
    after = Course(least, most, medium_from, medium_to, course.high_from, course.high_to, over, course.medium_over)
    return after, next_least, next_most, widest


@kernel
def _medium_stage(
    course: Course, medium: Tank, density: float, rise: float, task: Task, flow: float
) -> tuple[Course, float, float, float]:
    """The same of medium's stage, and high's beginning."""
    if course.medium_from == np.inf or course.medium_over:
        return course, np.inf, course.most, 0.0
    begins, most = course.medium_from, course.most
    steep, flat = density * (medium.warm + KELVIN), density * (medium.cold + KELVIN)
    first = max(course.least, begins)
    ends_from = max(_end(medium.low, begins, steep, rise, task.start, task.gap), first)
    ends_to = _end(medium.high, course.medium_to, flat, rise, task.start, task.gap)
    next_least = first + flow * max(task.gap, _gap(medium.low, first - begins, steep, first, rise, task.start))
    widest = _gap(medium.high, 0.0, flat, first, rise, task.start)
    high_from, high_to, next_most = course.high_from, course.high_to, most
    leaves = course.medium_to
    if ends_to > 0.0:
        top = min(most, ends_to)
        taken = max(top - course.medium_to, 0.0)
        leaves = max(leaves, top + flow * max(_gap(medium.high, taken, flat, top, rise, task.start), 0.0))
        next_most = max(most, leaves)
    if most >= ends_from:
        high_from = min(high_from, ends_from)
    over = course.low_over and course.least > ends_to
    if over:
        next_least = np.inf
    after = Course(course.least, most, begins, course.medium_to, high_from, max(high_to, leaves), course.low_over, over)
    return after, next_least, next_most, widest


@kernel
def _high_stage(
    course: Course, high: Tank, density: float, rise: float, task: Task, flow: float
) -> tuple[float, float, Gaps]:
    """Least and greatest X a second on of those in high's stage; its closest gap and the widest."""
    if course.high_from == np.inf:
        return np.inf, course.most, Gaps(np.inf, 0.0)
    begins, most = course.high_from, course.most
    steep, flat = density * (high.warm + KELVIN), density * (high.cold + KELVIN)
    first = max(course.least, begins)
    last = max(most, first)
    closest = _gap(high.low, last - begins, steep, last, rise, task.start)
    next_least = first + flow * _gap(high.low, first - begins, steep, first, rise, task.start)
    widest = _gap(high.high, 0.0, flat, first, rise, task.start)
    taken = max(most - course.high_to, 0.0)
    next_most = most + flow * max(_gap(high.high, taken, flat, most, rise, task.start), 0.0)
    return next_least, next_most, Gaps(closest, widest)


@kernel
def connected(course: Course, done: float) -> Course:
    """The course of those still connected: a vehicle that has gained `done` grams has left."""
    return Course(
        course.least, min(course.most, done), course.medium_from, course.medium_to, course.high_from, course.high_to,
        course.low_over, course.medium_over,
    )  # fmt: skip


@kernel
def advance(
    course: Course, tanks: tuple[Tank, Tank, Tank], density: tuple[float, float, float], rise: float, task: Task,
    plant: PlantConstants,
) -> tuple[Course, Gaps]:  # fmt: skip
    """The course a second on, with what the gaps were; `rise` is the vehicle's pressure by its mass [bar/g]."""
    flow = plant.outlet_coefficient
    course, low_least, low_most, low_gap = _low_stage(course, tanks[LOW], density[LOW], rise, task, flow)
    course, medium_least, medium_most, medium_gap = _medium_stage(
        course, tanks[MEDIUM], density[MEDIUM], rise, task, flow
    )
    high_least, high_most, gaps = _high_stage(course, tanks[HIGH], density[HIGH], rise, task, flow)
    least = min(low_least, medium_least, high_least) * (1.0 - OUTWARD)
    most = max(low_most, medium_most, high_most) * (1.0 + OUTWARD)
    after = Course(
        max(least, course.least), most, course.medium_from, course.medium_to, course.high_from, course.high_to,
        course.low_over, course.medium_over,
    )  # fmt: skip
    return after, Gaps(gaps.closest, max(low_gap, medium_gap, gaps.widest))
