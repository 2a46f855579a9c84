"""The proof that the reserve rule finishes every vehicle and is ready for the next: grids of cells, stage by stage."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from controllers.certified.box import Seen, widened
from controllers.certified.recovery import KELVINS, highest_of, kelvin_of, prove_recovery
from controllers.certified.spans import BINS, COLDEST, OUTCOMES, PROVED, Tables, Task
from controllers.certified.stages import prove_again, prove_high, prove_low, prove_medium, vehicle_course
from controllers.reserve import GAP, OPEN, SLOT, STOP, Reserve
from station.parameters import PRESSURE_MAX, Station
from station.plant import BUFFERS, HIGH, KELVIN, LOW, MEDIUM, gas_mass

GRIDS = ((8.0, 1.0), (4.0, 0.5))
"""Widths of cells that are tried one after the other [bar], [K]."""

ROUNDS = 8
"""How often the states are widened to where fills take the buffers."""

MARGIN = 3.0
"""And by how much more each time [bar]: small steps would go on, for what is wider leads wider."""

Progress = Callable[[str], None] | None


@dataclass(frozen=True)
class States:
    """Sets of states of each buffer that fills lead back into: a least pressure at each temperature, and a greatest."""

    floors: np.ndarray  # (3, KELVINS) [bar], from COLDEST deg C on, a kelvin each; inf where there is no state
    tops: np.ndarray  # (3,) pressures once no colder than the surroundings [bar]

    def cells(self, buffer: int, grid: tuple[float, float]) -> np.ndarray:
        """A buffer's states cut into cells no wider than `grid` (n, 4): least and greatest pressure, temperature."""
        cells = []
        for place in np.flatnonzero(np.isfinite(self.floors[buffer])):
            pressures = _cut(float(self.floors[buffer, place]), float(self.tops[buffer]), grid[0])
            cells += [
                (*pressure, *temperature)
                for temperature in _cut(COLDEST + int(place), COLDEST + int(place) + 1.0, grid[1])
                for pressure in pressures
            ]
        return np.array(cells)

    def holds(self, other: States) -> bool:
        """Whether all states of another are among these."""
        return bool((other.floors >= self.floors).all() and (other.tops <= self.tops).all())

    def wider(self, other: States) -> States:
        """These and the other's, and MARGIN more where the other's lie outside."""
        floors = np.where(other.floors < self.floors, other.floors - MARGIN, self.floors)
        return States(floors, np.where(other.tops > self.tops, other.tops + MARGIN, self.tops))

    def with_states(self, other: States | None) -> States:
        """These and another's."""
        if other is None:
            return self
        return States(np.minimum(self.floors, other.floors), np.maximum(self.tops, other.tops))

    def as_document(self) -> dict[str, Any]:
        """As JSON holds it: for each buffer the least pressure of each kelvin, and the greatest pressure."""
        return {
            name: {
                "top_bar": float(self.tops[buffer]),
                "floor": [
                    [COLDEST + int(place), float(self.floors[buffer, place])]
                    for place in np.flatnonzero(np.isfinite(self.floors[buffer]))
                ],
            }
            for buffer, name in enumerate(BUFFERS)
        }

    @classmethod
    def of_document(cls, given: dict[str, Any]) -> States:
        """What `as_document` wrote; ValueError for pressures that no station has, and where a buffer has no states."""
        floors = np.full((3, KELVINS), np.inf)
        for buffer, name in enumerate(BUFFERS):
            if not given[name]["floor"]:
                raise ValueError(f"{name}.floor must not be empty")
            for temperature, pressure in given[name]["floor"]:
                floors[buffer, round(float(temperature) - COLDEST)] = pressure
        tops = np.array([given[name]["top_bar"] for name in BUFFERS], dtype=np.float64)
        told = np.append(floors[floors != np.inf], tops)
        if not np.all((told >= 0) & (told <= PRESSURE_MAX)):
            raise ValueError(f"pressures of states must lie within 0 to {PRESSURE_MAX:g} bar")
        return cls(floors, tops)


def _cut(low: float, high: float, width: float) -> list[tuple[float, float]]:
    ends = np.linspace(low, high, max(int(np.ceil((high - low) / width)), 1) + 1)
    ends[0], ends[-1] = low, high
    return list(zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True))


@dataclass(frozen=True)
class Enclosure:
    """What is proved of sets of states, and what fails if not all of it."""

    states: States
    grid: tuple[float, float]
    cells: int
    open: str
    longest: int | None  # no fill lasts longer [s]
    back: States  # what fills lead to, s and more after a vehicle connected
    tables: Tables

    @property
    def complete(self) -> bool:
        """Whether every vehicle is finished within T, and fills lead back into the states."""
        return self.open == ""

    def as_document(self) -> dict[str, Any]:
        """Figures as JSON holds them, and of a proof that is complete when each buffer can hand the vehicle on."""
        done = self.complete
        return {
            "method": "stages of a fill one by one, intervals in double arithmetic rounded outward by 1e-11 a second",
            "complete": done, "open": self.open, "cell_bar": self.grid[0], "cell_k": self.grid[1], "cells": self.cells,
            "longest_fill_s": self.longest if done else None,
            "states": self.states.as_document() if done else None,
            "low_hands_on": _rows(self.tables.to_medium) if done else [],
            "medium_hands_on": _rows(self.tables.to_high) if done else [],
        }  # fmt: skip


def _rows(table: np.ndarray) -> list[list[float]]:
    """Second, least and greatest mass of a table's intervals."""
    return [[second, *map(float, row)] for second, row in enumerate(table) if row[0] <= row[1]]


def task_of(rule: Reserve, station: Station, within: int, spacing: int) -> Task:
    """What is to be proved of a station's usual vehicle under the reserve rule."""
    rule.start(station)
    settings, vehicle = rule.compiled().settings, station.vehicle
    gap = max(float(settings[GAP]), station.dispenser.outlet_gap_min_bar)
    high, medium, low = map(float, settings[STOP : STOP + 3])
    return Task(
        float(gas_mass(vehicle.start_pressure_bar, vehicle.start_temperature_c, vehicle.volume_m3)),
        vehicle.start_temperature_c, vehicle.volume_m3, vehicle.finish_pressure_bar, within, spacing, gap,
        max(float(settings[OPEN]), gap), (high, medium, low), int(settings[SLOT]),
    )  # fmt: skip


def states_seen(station: Station, seen: Seen, stop: tuple[float, float, float]) -> States:
    """The box of the claim as sets, up to where filling takes pressures."""
    plant = station.constants()
    low, high = widened(seen, station)
    floors = np.full((3, KELVINS), np.inf)
    for buffer in range(3):
        floors[buffer, kelvin_of(low[3 + buffer]) : kelvin_of(high[3 + buffer]) + 1] = low[buffer]
    warm = plant.buffer_temperature_max
    ambient = plant.ambient_temperature
    tops = [
        max(
            float(high[buffer]) * ((ambient + KELVIN) / (min(float(low[3 + buffer]), ambient) + KELVIN)),
            highest_of(buffer, warm, stop[buffer], plant),
        )
        for buffer in range(3)
    ]
    return States(floors, np.array(tops) * (1.0 + 1e-9))


def enclose(
    rule: Reserve, station: Station, seen: Seen, progress: Progress = None, *, within: int, ready: States | None = None
) -> Enclosure:
    """Widen the states to where fills lead and try finer and finer cells, until they are proved.

    `within`: no fill is to take longer [s]; `ready`: states that are to be proved beside the box.
    """
    task = task_of(rule, station, within, seen.spacing)
    for grid in GRIDS:
        states = states_seen(station, seen, task.stop).with_states(ready)
        for number in range(ROUNDS):
            if progress:
                progress(f"round {number + 1}, cells of {grid[0]:g} bar and {grid[1]:g} K")
            found = prove(states, grid, task, station)
            if found.open != OUTSIDE:
                break
            states = states.wider(found.back)
        if found.complete:
            return found
    return found


def recheck(
    rule: Reserve, station: Station, seen: Seen, states: States, grid: tuple[float, float], progress: Progress = None,
    *, within: int, ready: States | None = None,
) -> Enclosure:  # fmt: skip
    """Prove given states anew with cells of a given size; none is taken at its word."""
    if min(grid) < min(map(min, GRIDS)):
        raise ValueError(f"cells must be no smaller than {GRIDS[-1]}; given {grid}")
    task = task_of(rule, station, within, seen.spacing)
    if progress:
        progress(f"cells of {grid[0]:g} bar and {grid[1]:g} K")
    found = prove(states, grid, task, station)
    if not states.holds(states_seen(station, seen, task.stop).with_states(ready)):
        return replace(found, open="the states do not hold the box")
    return found


OUTSIDE = "fills lead out of the states"


def _tables(within: int) -> Tables:
    rows = within + 2

    def ends() -> np.ndarray:
        return np.tile(np.array([np.inf, -np.inf, np.inf, -np.inf]), (rows, BINS, 1))

    def spans(count: int) -> np.ndarray:
        return np.tile(np.array([np.inf, -np.inf]), (count, 1))

    closed = np.tile(np.array([np.inf, -np.inf, np.inf, np.inf, -np.inf, np.inf, -np.inf]), (rows, BINS, 1))
    return Tables(
        np.zeros((rows, 2)), spans(rows), spans(rows), ends(), ends(), ends(), ends(), np.zeros((rows, 3)),
        spans(rows), closed, spans(2),
    )  # fmt: skip


def prove(states: States, grid: tuple[float, float], task: Task, station: Station) -> Enclosure:
    """Follow every cell of given states; what that proves."""
    plant, tables = station.constants(), _tables(task.within)
    cells = [states.cells(buffer, grid) for buffer in range(3)]
    floors, tops = np.full((3, KELVINS), np.inf), np.zeros(3)
    reason = "T is not below s" if task.within >= task.spacing else ""
    outcome = vehicle_course(task, plant, tables.vehicle)
    if not reason and outcome != PROVED:
        reason = OUTCOMES[outcome]
    for buffer, stage in ((LOW, prove_low), (MEDIUM, prove_medium), (HIGH, prove_high)):
        if not reason:
            outcome, row = stage(cells[buffer], tables, task, plant)
            if outcome != PROVED:
                reason = _where(outcome, BUFFERS[buffer], cells[buffer][row])
    if not reason:
        outcome = prove_again(tables, task, plant)
        reason = "" if outcome == PROVED else f"{OUTCOMES[outcome]}, after high has come too close"
    if not reason:
        outcome = prove_recovery(states.tops, tables, task, plant, floors, tops)
        reason = "" if outcome == PROVED else OUTCOMES[outcome]
    back = States(floors, tops)
    if not reason and not states.holds(back):
        reason = OUTSIDE
    left = np.flatnonzero(tables.left.any(1))
    return Enclosure(states, grid, sum(map(len, cells)), reason, int(left.max()) if len(left) else None, back, tables)


def _where(outcome: int, buffer: str, cell: np.ndarray) -> str:
    low, high, cold, warm = cell
    return f"{OUTCOMES[outcome]}: {buffer} at {low:.1f}-{high:.1f} bar, {cold:.1f} to {warm:.1f} degC"
