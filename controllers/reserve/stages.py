"""Fills under the reserve rule, one buffer at a time, enclosed for whole cells of its states.

Under that rule buffers feel each other only through the vehicle: through the second in which one hands it on and the
density its gas then has. So low's states are followed alone and leave, for each second, the densities at which the
vehicle can have been handed on then; from these medium's states are followed, and from what they leave, high's. Next
pressure of the buffer and next density rise with both, whatever the temperature, and next density falls with the
tank's volume: so lower ends with the largest tank lead to lower ends, upper ends with the smallest to upper ends, and
intervals of seconds with intervals of densities lose no more than the cells are wide.
"""

from __future__ import annotations

import numpy as np

from controllers.reserve.enclosures import (
    COARSE,
    COOLER,
    FLOW,
    HEAT,
    LATE,
    PROVED,
    SLACK,
    STEP,
    WARMER,
    EnclosureTables,
    FillEnclosure,
    ProofProblem,
    bars_of,
    connected,
    dispensed,
    either,
    empty,
    note_end,
    note_span,
    piece_of,
    pieces_of,
    place_of,
    rested,
    staying,
)
from controllers.reserve.rule import AGAIN, FIRST, WAIT, due
from controllers.reserve.tank import NO, OUTWARD, YES, Law, Tank, law_of, least_ratio, start_tank, step_tank
from station.compiled import inlined, kernel
from station.geometry import HIGH, KELVIN, LOW, MEDIUM
from station.limits import vehicle_temperature_margin
from station.plants.thesis import PlantConstants, vehicle_temperature


@kernel
def vehicle_course(task: ProofProblem, plant: PlantConstants, course: np.ndarray) -> int:
    """Temperature of a vehicle that is filled from its connection on, and when the limit closes the outlet."""
    temperature = task.temperature
    for second in range(task.within + 2):
        margin = vehicle_temperature_margin(temperature, plant, 1.0)
        if abs(margin) < SLACK:
            return HEAT
        course[second, 0], course[second, 1] = temperature, 1.0 if margin < 0.0 else 0.0
        temperature = vehicle_temperature(temperature, 0.0 if margin < 0.0 else 1.0, plant, 1.0)
    return PROVED


@kernel
def follow(
    span: FillEnclosure,
    since: int,
    law: Law,
    handed: np.ndarray,
    ends: np.ndarray,
    idle: np.ndarray,
    tables: EnclosureTables,
    task: ProofProblem,
    plant: PlantConstants,
) -> int:
    """Low's or medium's stage from second `since` on, until everybody has been handed on or has left."""
    place = 0 if law.buffer == LOW else 1
    for second in range(since, task.within + 1):
        bars = bars_of(tables.vehicle[second, 0])
        rise = bars * (1.0 - OUTWARD), bars * (1.0 + OUTWARD)
        if second > since and span.most * rise[1] >= task.finish - SLACK:
            tables.left[second, place] = 1.0
            note_end(idle, second, span.low, span.high, span.cold, span.warm)
            span = connected(span, task.finish, rise)
        if empty(span):
            return PROVED
        if span.low - span.most * rise[1] < task.gap + SLACK:
            least = max(span.least, (span.low - task.gap - SLACK) / rise[1])
            note_span(handed, second, least, span.most)
            high = min(span.high, span.most * rise[1] + task.gap + SLACK)
            note_end(ends, second, span.low, high, span.cold, span.warm)
        span = staying(span, task.gap, rise)
        if empty(span):
            return PROVED
        if plant.outlet_coefficient * (span.high - span.least * rise[0]) > plant.limits.dispenser_flow_max - SLACK:
            return FLOW
        span = rested(span, plant) if tables.vehicle[second, 1] else dispensed(span, rise, task.volumes, law, plant)
    return LATE


@inlined
def warming(vehicle: tuple[float, float], plant: PlantConstants) -> tuple[float, float]:
    """Bounds on the temperature of a vehicle a second on, of which only the temperature limit may close the outlet.

    The limit closes it from one temperature on: what is colder warms, what is warmer cools.
    """
    # margin(T) = margin(0) - (1 - c) T is affine: its root is the warmest T that is filled.
    root = vehicle_temperature_margin(0.0, plant, 1.0) / (1.0 - plant.heat_exchange)
    first, last = root - SLACK, root + SLACK
    coldest = vehicle_temperature(vehicle[0], 0.0 if vehicle[0] > first else 1.0, plant, 1.0)
    if vehicle[0] <= first < vehicle[1]:
        coldest = min(coldest, vehicle_temperature(first, 0.0, plant, 1.0))
    warmest = vehicle_temperature(vehicle[1], 1.0 if vehicle[1] <= last else 0.0, plant, 1.0)
    if vehicle[0] <= last < vehicle[1]:
        warmest = max(warmest, vehicle_temperature(last, 1.0, plant, 1.0))
    return coldest - OUTWARD * KELVIN, warmest + OUTWARD * KELVIN


@kernel
def _note_closed(
    span: FillEnclosure,
    least: float,
    drop: float,
    vehicle: tuple[float, float],
    rise: tuple[float, float],
    second: int,
    tables: EnclosureTables,
    plant: PlantConstants,
) -> None:
    """High has come too close in this second: what it and the vehicle, of `least` density or more, can then be."""
    gap = plant.limits.outlet_gap_min
    row = tables.closed[second, place_of(span.cold, plant.limits.vehicle_temperature_max - vehicle[1])]
    row[0] = min(row[0], max(span.least, (span.low - gap - SLACK) / rise[1], least))
    row[1] = max(row[1], span.most)
    row[2] = min(row[2], max(span.low - span.most * rise[1], gap - drop - SLACK))
    row[3], row[4] = min(row[3], span.cold), max(row[4], span.warm)
    row[5], row[6] = min(row[5], vehicle[0]), max(row[6], vehicle[1])


@kernel
def finale(
    span: FillEnclosure,
    since: int,
    vehicle: tuple[float, float],
    law: Law,
    tables: EnclosureTables,
    task: ProofProblem,
    plant: PlantConstants,
) -> int:
    """High's stage from second `since` on, until everybody has left or high has come too close to them."""
    drop = task.opens
    gap = plant.limits.outlet_gap_min
    least_gain = plant.outlet_coefficient * (gap - SLACK) / task.volumes[1] * (1.0 - OUTWARD)
    phi = least_gain / plant.vehicle_heating * (1.0 - OUTWARD) if plant.vehicle_heating > 0.0 else 0.0
    heat = (
        span.least - phi * vehicle[1]
    )  # least density - phi T, which rises whether or not the limit closes the outlet
    both = span.low / (law.density * (span.warm + KELVIN)) + task.volumes[1] * span.least
    for second in range(since, task.within + 1):
        rise = bars_of(vehicle[0]) * (1.0 - OUTWARD), bars_of(vehicle[1]) * (1.0 + OUTWARD)
        if second > since and span.most * rise[1] >= task.finish - SLACK:
            tables.left[second, 2] = 1.0
            note_end(tables.high_idle, second, span.low, span.high, span.cold, span.warm)
            span = connected(span, task.finish, rise)
        if empty(span):
            return PROVED
        if span.low - span.most * rise[1] < gap + SLACK:
            held = law.density * (span.cold + KELVIN)
            least = (both * (1.0 - 1e-9) * held - gap - SLACK) / (rise[1] + task.volumes[1] * held)
            _note_closed(span, least, drop, vehicle, rise, second, tables, plant)
        span = staying(span, gap, rise)
        if empty(span):
            return PROVED
        if plant.outlet_coefficient * (span.high - span.least * rise[0]) > plant.limits.dispenser_flow_max - SLACK:
            return FLOW
        opened = vehicle_temperature_margin(vehicle[1], plant, 1.0) > SLACK
        shut = vehicle_temperature_margin(vehicle[0], plant, 1.0) < -SLACK
        after = dispensed(span, rise, task.volumes, law, plant)
        coldest, warmed = warming(vehicle, plant)
        # The gap falls by what flows, by cooling, and by the vehicle's warming.
        drop = gap * plant.outlet_coefficient * (law.density * (span.warm + KELVIN) + bars_of(warmed) / task.volumes[0])
        cooling = plant.outlet_cooling[law.buffer]
        drop += span.high * max(1.0 - least_ratio(span.cold, span.warm, cooling, plant), 0.0)
        drop += span.most * (bars_of(warmed) * (1.0 + OUTWARD) - rise[0])
        if shut:
            after = rested(span, plant)
        elif not opened:
            after = either(after, rested(span, plant))
        heat += phi * plant.heat_exchange * (vehicle[0] - plant.ambient_temperature)
        heat -= OUTWARD * (abs(heat) + phi * KELVIN)
        span = FillEnclosure(
            after.low, after.high, after.cold, after.warm, max(after.least, heat + phi * coldest), after.most
        )
        vehicle = coldest, warmed
        heat = max(heat, span.least - phi * warmed)
    return LATE


@kernel
def await_high(
    tank: Tank, least: float, most: float, since: int, again: bool, vehicle: tuple[float, float], law: Law,
    first: int, tables: EnclosureTables, task: ProofProblem, plant: PlantConstants,
) -> int:  # fmt: skip
    """A wait for high from second `since` on, and what follows; `again`: after it has come too close.

    `first`: the second in which medium handed the vehicle on, -1 where that does not matter.
    """
    for second in range(since, task.within + 1):
        rise = bars_of(vehicle[0]) * (1.0 - OUTWARD), bars_of(vehicle[1]) * (1.0 + OUTWARD)
        if not (again and second == since):
            full = tank.high >= task.stop[HIGH] - SLACK
            if full or tank.high - least * rise[0] >= task.opens - SLACK:
                low = max(tank.low, min(least * rise[0] + task.opens - SLACK, task.stop[HIGH] - SLACK))
                top = most if full else min(most, (tank.high - task.opens + SLACK) / rise[0])
                span = FillEnclosure(low, tank.high, tank.cold, tank.warm, least, top)
                if first >= 0:
                    note_span(tables.opened, first, second, second)
                outcome = PROVED if empty(span) else finale(span, second, vehicle, law, tables, task, plant)
                if outcome != PROVED:
                    return outcome
            if tank.low >= task.stop[HIGH] + SLACK or tank.low - most * rise[1] >= task.opens + SLACK:
                return PROVED
            least = max(least, (tank.low - task.opens - SLACK) / rise[1])  # the vehicle of those that still wait
            if least > most:
                return PROVED
        note_span(tables.waits, 1 if again else 0, second, second + 1)
        own = due(second, AGAIN if again else WAIT, task.slot) == HIGH
        tank = step_tank(tank, YES if own else NO, law, plant)
        vehicle = (
            vehicle_temperature(vehicle[0], 0.0, plant, 1.0) - OUTWARD * KELVIN,
            vehicle_temperature(vehicle[1], 0.0, plant, 1.0) + OUTWARD * KELVIN,
        )
        if most * bars_of(vehicle[1]) >= task.finish - SLACK:  # one that warms may leave while it waits
            tables.left[min(second + 1, task.within), 2] = 1.0
            note_end(tables.high_idle, second + 1, tank.low, tank.high, tank.cold, tank.warm)
    return LATE


@kernel
def prove_low(cells: np.ndarray, tables: EnclosureTables, task: ProofProblem, plant: PlantConstants) -> tuple[int, int]:
    """Low's stage from every cell (n, 4) of its states; the outcome, and the first cell that is not proved."""
    for row in range(len(cells)):
        cell = cells[row]
        law = law_of(LOW, task.stop[LOW], cell[3], (1.0, 1.0), plant)
        least, most = task.starts
        pieces = pieces_of(least, most, bars_of(task.temperature))
        for piece in range(pieces):
            begin, end = piece_of(least, most, piece, pieces)
            span = FillEnclosure(cell[0], cell[1], cell[2], cell[3], begin * (1.0 - OUTWARD), end * (1.0 + OUTWARD))
            outcome = follow(span, 0, law, tables.to_medium, tables.low_ends, tables.low_ends, tables, task, plant)
            if outcome != PROVED:
                return outcome, row
    return PROVED, -1


@kernel
def prove_medium(
    cells: np.ndarray, tables: EnclosureTables, task: ProofProblem, plant: PlantConstants
) -> tuple[int, int]:
    """Medium's stage from every cell of its states, whenever low can hand the vehicle on."""
    turns = float(task.slot), float(task.slot)
    for row in range(len(cells)):
        cell = cells[row]
        law = law_of(MEDIUM, task.stop[MEDIUM], cell[3], turns, plant)
        tank = start_tank(cell[0], cell[1], cell[2], cell[3], law, plant)
        for second in range(task.within + 1):
            if tables.left[second, 0]:
                note_end(tables.medium_idle, second, tank.low, tank.high, tank.cold, tank.warm)
            least, most = tables.to_medium[second]
            pieces = 0 if least > most else pieces_of(least, most, bars_of(tables.vehicle[second, 0]))
            for piece in range(pieces):
                begin, end = piece_of(least, most, piece, pieces)
                span = FillEnclosure(tank.low, tank.high, tank.cold, tank.warm, begin, end)
                outcome = follow(
                    span, second, law, tables.to_high, tables.medium_ends, tables.medium_idle, tables, task, plant
                )
                if outcome != PROVED:
                    return outcome, row
            tank = step_tank(tank, YES if due(second, FIRST, task.slot) == MEDIUM else NO, law, plant)
    return PROVED, -1


@kernel
def prove_high(
    cells: np.ndarray, tables: EnclosureTables, task: ProofProblem, plant: PlantConstants
) -> tuple[int, int]:
    """High's stage from every cell of its states, whenever medium can hand the vehicle on, until it comes too close."""
    turns = float(task.slot), float(task.slot)
    for row in range(len(cells)):
        cell = cells[row]
        law = law_of(HIGH, task.stop[HIGH], cell[3], turns, plant)
        tank = start_tank(cell[0], cell[1], cell[2], cell[3], law, plant)
        for second in range(task.within + 1):
            if tables.left[second, 0] or tables.left[second, 1]:
                note_end(tables.high_idle, second, tank.low, tank.high, tank.cold, tank.warm)
            least, most = tables.to_high[second]
            vehicle = tables.vehicle[second, 0], tables.vehicle[second, 0]
            pieces = 0 if least > most else pieces_of(least, most, bars_of(vehicle[0]))
            for piece in range(pieces):
                begin, end = piece_of(least, most, piece, pieces)
                outcome = await_high(tank, begin, end, second, False, vehicle, law, second, tables, task, plant)
                if outcome != PROVED:
                    return outcome, row
            tank = step_tank(tank, YES if due(second, FIRST, task.slot) == HIGH else NO, law, plant)
    return PROVED, -1


@kernel
def _once_more(row: np.ndarray, second: int, tables: EnclosureTables, task: ProofProblem, plant: PlantConstants) -> int:
    """What follows one row of the closings: it is cut by density, by the buffer's temperature and by the vehicle's."""
    turns = float(task.slot), float(task.slot)
    warmths, coolings = max(int(np.ceil((row[4] - row[3]) / COARSE)), 1), max(int(np.ceil((row[6] - row[5]) / STEP)), 1)
    for cooling in range(coolings):
        vehicle = piece_of(row[5], row[6], cooling, coolings)
        rise = bars_of(vehicle[0]) * (1.0 - OUTWARD), bars_of(vehicle[1]) * (1.0 + OUTWARD)
        pieces = pieces_of(row[0], row[1], rise[1])
        for warmth in range(warmths):
            cold, warm = piece_of(row[3], row[4], warmth, warmths)
            law = law_of(HIGH, task.stop[HIGH], warm, turns, plant)
            for piece in range(pieces):
                begin, end = piece_of(row[0], row[1], piece, pieces)
                top = end * rise[1] + plant.limits.outlet_gap_min + SLACK
                tank = start_tank(begin * rise[0] + row[2], top, cold, warm, law, plant)
                outcome = await_high(tank, begin, end, second, True, vehicle, law, -1, tables, task, plant)
                if outcome != PROVED:
                    return outcome
    return PROVED


@kernel
def prove_again(tables: EnclosureTables, task: ProofProblem, plant: PlantConstants) -> int:
    """Enclosure after high has come too close: it is raised and opened again each time, until the vehicle has left."""
    for second in range(task.within + 1):
        for place in range(WARMER * COOLER):
            row = tables.closed[second, place]
            if row[0] <= row[1]:
                outcome = _once_more(row, second, tables, task, plant)
                if outcome != PROVED:
                    return outcome
    return PROVED
