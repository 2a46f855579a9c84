"""A cell of states followed from the connection of a vehicle until the buffers are back: what the proof is made of."""

from __future__ import annotations

import numpy as np

from controllers.certified.envelope import HIGH, LOW, MEDIUM, Course, Gaps, Task, advance, connected
from controllers.certified.tank import (
    MAYBE,
    NO,
    OUTWARD,
    YES,
    Law,
    Tank,
    dissolved,
    law_of,
    start_tank,
    step_tank,
    worse,
)
from station.compiled import kernel
from station.limits import vehicle_temperature_margin
from station.plant import KELVIN, SPECIFIC_GAS, PlantConstants, vehicle_temperature

# What became of a cell.
SERVED, STUCK, FLOW, HEAT, LATE, BACK = range(6)
OUTCOMES = (
    "served",
    "high could come closer to the vehicle than an outlet admits",
    "an outlet could be closed by the flow limit",
    "the vehicle could become too warm",
    "a fill could last longer than T",
    "a buffer could be below its start pressure when the next vehicle connects",
)

CELL = 12
"""Figures of a cell: least pressure, greatest, least temperature, greatest, of high, then medium, then low."""

# Columns of a result: outcome, fill time [s], closest gap of high [bar], then least pressures and temperatures.
OUTCOME, FILL, GAP, PRESSURE, TEMPERATURE = 0, 1, 2, 3, 6
RESULT = 9

SETTLE = 1200
"""Seconds after s within which a buffer must be back for good."""


@kernel
def _fill_laws(cell: np.ndarray, task: Task, plant: PlantConstants) -> tuple[Law, Law, Law]:
    """The constants of each buffer while a vehicle is connected and two of them take turns."""
    turns = (float(task.slot), float(task.slot))
    return (
        law_of(HIGH, 0.97 * cell[0], task.aim, task.stop, cell[3], turns, plant),
        law_of(MEDIUM, 0.97 * cell[4], task.aim, task.stop, cell[7], turns, plant),
        law_of(LOW, 0.97 * cell[8], task.aim, task.stop, cell[11], turns, plant),
    )


@kernel
def _left(tank: Tank, least: float, most: float, law: Law) -> Tank:
    """A buffer that has given `least` to `most` grams."""
    steep, flat = law.density * (tank.warm + KELVIN), law.density * (tank.cold + KELVIN)
    low = max(tank.low - max(most, 0.0) * steep, 0.0) * (1.0 - OUTWARD)
    high = max(tank.high - max(least, 0.0) * flat, low) * (1.0 + OUTWARD)
    return start_tank(low, high, tank.cold, tank.warm, law)


@kernel
def _afterwards(
    after: Tank, begun: bool, leaving: bool, left: Tank, asked: int, law: Law, plant: PlantConstants
) -> Tank:
    """Bounds a second on of a buffer that has done its stage: of those that had, and those that leave it now."""
    if leaving:
        after = worse(after, left) if begun else left
    after = step_tank(after, asked, NO, law, plant)
    return dissolved(after, law) if asked == MAYBE else after


@kernel
def _hindered(gaps: Gaps, temperature: float, plant: PlantConstants) -> int:
    """What could keep the outlet closed in a second, or LATE where nothing can."""
    if gaps.closest < plant.outlet_gap_min + 1e-9:
        return STUCK
    if plant.outlet_coefficient * gaps.widest > plant.dispenser_flow_max - 1e-9:
        return FLOW
    if vehicle_temperature_margin(temperature, plant, 1.0) < 1e-9:
        return HEAT
    return LATE


@kernel
def fill(
    cell: np.ndarray, phase: int, task: Task, plant: PlantConstants, result: np.ndarray
) -> tuple[Tank, Tank, Tank]:
    """The buffers when the last vehicle of the cell has left; fills outcome, fill time and gap of `result`.

    Turns began `phase` seconds before the vehicle connected. In even turns the compressor is asked for high, until high
    dispenses, and then for medium; in odd turns for medium while low dispenses, and then for low.
    """
    laws = _fill_laws(cell, task, plant)
    density = (laws[0].density, laws[1].density, laws[2].density)
    high = start_tank(cell[0], cell[1], cell[2], cell[3], laws[HIGH])
    medium = start_tank(cell[4], cell[5], cell[6], cell[7], laws[MEDIUM])
    low = start_tank(cell[8], cell[9], cell[10], cell[11], laws[LOW])
    medium_after, low_after, medium_left, low_left = medium, low, False, False
    course = Course(0.0, 0.0, np.inf, 0.0, np.inf, 0.0, False, False)
    temperature, given = task.temperature, 0.0
    result[OUTCOME], result[FILL], result[GAP] = LATE, task.within, np.inf
    for second in range(task.within + 1):
        rise = (temperature + KELVIN) * (SPECIFIC_GAS / task.volume)
        done = task.finish / rise - task.start
        if course.least >= done + OUTWARD * task.start:
            result[OUTCOME], result[FILL] = SERVED, second
            break
        low_before, medium_before = course.low_over, course.medium_over
        course, gaps = advance(
            connected(course, done + OUTWARD * task.start), (high, medium, low), density, rise, task, plant
        )
        given = max(given, course.most)
        result[GAP] = min(result[GAP], gaps.closest)
        result[OUTCOME] = _hindered(gaps, temperature, plant)
        if result[OUTCOME] != LATE:
            result[FILL] = second
            break
        even = (second + phase) // task.slot % 2 == 0
        some_gone = course.most >= done  # perhaps nobody is connected any more, and turns are others
        in_medium, in_high = course.medium_from < np.inf, course.high_from < np.inf
        # A vehicle may also leave the station from low's or medium's stage; that ends the stage as well.
        if in_medium or some_gone:
            most = max(course.medium_to, given) if some_gone else course.medium_to
            left = _left(low, min(course.medium_from, course.least), most, laws[LOW])
            asked = MAYBE if some_gone else (NO if even else YES)
            low_after = _afterwards(low_after, low_left, not low_before, left, asked, laws[LOW], plant)
            low_left = True
        if in_high or some_gone:
            most = max(course.high_to, given) if some_gone else course.high_to
            least = max(min(course.high_from, course.least) - course.medium_to, 0.0)
            left = _left(medium, least, most - min(course.medium_from, most), laws[MEDIUM])
            asked = MAYBE if some_gone else (YES if even else NO)
            medium_after = _afterwards(medium_after, medium_left, not medium_before, left, asked, laws[MEDIUM], plant)
            medium_left = True
        if some_gone:
            high = dissolved(step_tank(high, MAYBE, MAYBE if in_high else NO, laws[HIGH], plant), laws[HIGH])
        else:
            asked = (MAYBE if in_high else YES) if even else NO
            high = step_tank(high, asked, MAYBE if in_high else NO, laws[HIGH], plant)
        medium = step_tank(
            medium,
            NO if even or course.low_over else (MAYBE if in_medium else YES),
            NO if not in_medium else (YES if course.low_over and not in_high else MAYBE),
            laws[MEDIUM],
            plant,
        )
        low = step_tank(low, NO, MAYBE if in_medium else YES, laws[LOW], plant)
        temperature = vehicle_temperature(temperature, 1.0, plant, 1.0)
    return _left(high, 0.0, given - course.high_from, laws[HIGH]), medium_after, low_after


@kernel
def back_law(buffer: int, back: float, warm: float, task: Task, plant: PlantConstants) -> Law:
    """The law of a buffer in turns whose aim, less what it may fall back, is `back` [bar]."""
    turns = (float(task.slot), 2.0 * task.slot)
    share = law_of(buffer, 0.0, 1.0, task.stop, warm, turns, plant).slack
    return law_of(buffer, 0.0, back / (1.0 - share) * (1.0 + 1e-9), task.stop, warm, turns, plant)


@kernel
def recover(
    buffer: int, tank: Tank, since: int, phase: int, back: float, task: Task, plant: PlantConstants
) -> tuple[float, float]:
    """Least pressure [bar] and temperature [deg C] of a buffer from s on, for ever; 0 bar where it is not back.

    Nobody has been connected since second `since`, and turns began `phase` seconds before the vehicle connected.
    """
    law = back_law(buffer, back, tank.warm, task, plant)
    if law.aim > task.stop:
        return 0.0, tank.cold
    tank = start_tank(tank.low, np.inf, tank.cold, tank.warm, law)
    least, coldest = np.inf, np.inf
    quiet = 0
    for second in range(since, task.spacing + SETTLE):
        if second >= task.spacing:
            least = min(least, tank.low)
            coldest = min(coldest, tank.cold)
            if tank.low < back:
                return tank.low, tank.cold
            # Once y suffices at the least temperature that turns hold, it does for ever: y does not fall any more.
            held = min(tank.lean, law.falls_to)
            kept = (tank.heat + law.phi * held) * law.density * (held + KELVIN)
            quiet = quiet + 1 if held >= plant.ambient_temperature and kept >= back * (1.0 + 1e-9) else 0
            if quiet > 3 * task.slot:
                return least, min(coldest, plant.ambient_temperature)
        own = ((second + phase) // task.slot) % 3 == buffer
        tank = step_tank(tank, YES if own else MAYBE, NO, law, plant)
    return 0.0, tank.cold


@kernel
def prove(cell: np.ndarray, task: Task, plant: PlantConstants, result: np.ndarray) -> None:
    """Everything about one cell, whatever second of the turns the vehicle connects in, into `result` (RESULT,)."""
    high, medium, low = fill(cell, 0, task, plant, result)
    worst = result.copy()
    for phase in range(1, 2 * task.slot):
        if result[OUTCOME] != SERVED:
            break
        other = fill(cell, phase, task, plant, result)
        high, medium, low = worse(high, other[HIGH]), worse(medium, other[MEDIUM]), worse(low, other[LOW])
        worst[FILL], worst[GAP] = max(worst[FILL], result[FILL]), min(worst[GAP], result[GAP])
    result[FILL:] = worst[FILL:]
    result[PRESSURE:] = np.nan
    if result[OUTCOME] != SERVED:
        return
    since = int(result[FILL])
    result[PRESSURE:] = np.inf
    for buffer in range(3):
        tank = high if buffer == HIGH else (medium if buffer == MEDIUM else low)
        for phase in range(3 * task.slot):
            least, coldest = recover(buffer, tank, since, phase, task.back[buffer], task, plant)
            result[PRESSURE + buffer] = min(result[PRESSURE + buffer], least)
            result[TEMPERATURE + buffer] = min(result[TEMPERATURE + buffer], coldest)
        if result[PRESSURE + buffer] < task.back[buffer]:
            result[OUTCOME] = BACK


@kernel
def prove_all(cells: np.ndarray, task: Task, plant: PlantConstants, results: np.ndarray) -> None:
    """`prove` for each of `cells` (n, CELL), into `results` (n, RESULT)."""
    for row in range(cells.shape[0]):
        prove(cells[row], task, plant, results[row])
