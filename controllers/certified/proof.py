"""The proof that the reserve rule finishes every vehicle and is ready for the next: grids of cells, stage by stage."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from controllers.certified.box import OperatingBox, widened
from controllers.certified.claim import Claim
from controllers.reserve.controller import Reserve
from controllers.reserve.enclosures import (
    BINS,
    COLDEST,
    COOLER,
    OUTCOMES,
    PROVED,
    WARMER,
    EnclosureTables,
    ProofProblem,
)
from controllers.reserve.recovery import KELVINS, highest_of, kelvin_of, prove_recovery
from controllers.reserve.settings import GAP, OPEN, SLOT, STOP
from controllers.reserve.stages import prove_again, prove_high, prove_low, prove_medium, vehicle_course
from station.geometry import BUFFERS, HIGH, KELVIN, LOW, MEDIUM
from station.limits import check_covered
from station.parameters import Station
from station.plants.thesis import PlantConstants, refuse_others
from station.quantities import PRESSURE_MAX

KEPT = {
    "flow": "an outlet that it could close leaves a cell open (FLOW)",
    "gap": "low and medium hand on before it, high waits for it",
    "vehicle_temperature": "seconds in which it closes the outlet are followed; one too close to tell is open (HEAT)",
    "buffer_temperature": "the bounds of a buffer count seconds in which it may deny the compressor",
    "hold": "the rule is exempt from it",
    "compressor": "a buffer is full below the compressor's pressure",
}
"""How the proof accounts for each limit on the state that may keep a valve of the rule closed."""


class Grid(NamedTuple):
    """Widths of cells."""

    pressure: float  # [bar]
    temperature: float  # [K]
    volume: float  # of the vehicle, greatest by least

    def __str__(self) -> str:
        """As progress tells it."""
        return f"cells of {self.pressure:g} bar, {self.temperature:g} K and {self.volume:g}"


GRIDS = (Grid(8.0, 1.0, 1.08), Grid(4.0, 0.5, 1.04))
"""Widths that are tried one after the other."""

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
        """A proof as `as_document` wrote it; ValueError for pressures no station has, and a buffer without states."""
        floors = np.full((3, KELVINS), np.inf)
        for buffer, name in enumerate(BUFFERS):
            if not given[name]["floor"]:
                raise ValueError(f"{name}.floor must not be empty")
            for temperature, pressure in given[name]["floor"]:
                floors[buffer, round(float(temperature) - COLDEST)] = pressure
        tops = np.array([given[name]["top_bar"] for name in BUFFERS], dtype=np.float64)
        figures = np.append(floors[floors != np.inf], tops)
        if not np.all((figures >= 0) & (figures <= PRESSURE_MAX)):
            raise ValueError(f"pressures of states must lie within 0 to {PRESSURE_MAX:g} bar")
        return cls(floors, tops)


def _cut(low: float, high: float, width: float) -> list[tuple[float, float]]:
    ends = np.linspace(low, high, max(int(np.ceil((high - low) / width)), 1) + 1)
    ends[0], ends[-1] = low, high
    return list(zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True))


@dataclass(frozen=True)
class Enclosure:
    """Statements proved of sets of states, and what fails if not all of them are."""

    states: States
    grid: Grid
    cells: int
    vehicles: int  # cells of vehicles
    open: str
    longest: int | None  # no fill lasts longer [s]
    hands_on: tuple[np.ndarray, np.ndarray]  # (n, 2) densities at which low and medium hand vehicles on [g/m3]

    @property
    def complete(self) -> bool:
        """Whether every vehicle is finished within T, and fills lead back into the states."""
        return self.open == ""

    def as_document(self) -> dict[str, Any]:
        """Figures as JSON holds them, and of a proof that is complete when each buffer can hand vehicles on."""
        done = self.complete
        return {
            "method": "stages of a fill one by one, intervals in double arithmetic rounded outward by 1e-11 a second",
            "complete": done, "open": self.open, "cell_bar": self.grid.pressure, "cell_k": self.grid.temperature,
            "cell_volume": self.grid.volume, "cells": self.cells, "vehicle_cells": self.vehicles,
            "longest_fill_s": self.longest if done else None,
            "states": self.states.as_document() if done else None,
            "low_hands_on": _rows(self.hands_on[0]) if done else [],
            "medium_hands_on": _rows(self.hands_on[1]) if done else [],
        }  # fmt: skip


def _rows(table: np.ndarray) -> list[list[float]]:
    """Second, least and greatest density of a table's intervals."""
    return [[second, *map(float, row)] for second, row in enumerate(table) if row[0] <= row[1]]


def check_limits(plant: PlantConstants) -> None:
    """Check that the proof covers every limit that can bind at a station with these constants.

    Raises
    ------
    UncoveredLimitError
        naming the first it does not cover.
    """
    check_covered("proofs of service", KEPT, plant)


def tasks_of(rule: Reserve, station: Station, claim: Claim, grid: Grid) -> list[ProofProblem]:
    """Proof obligations under the reserve rule: a task for each cell of the vehicles' volumes."""
    refuse_others(station.plant, "proofs of service")
    check_limits(station.constants())
    rule.start(station)
    settings, vehicles = rule.compiled().settings, claim.vehicles
    gap = max(float(settings[GAP]), station.dispenser.outlet_gap_min_bar)
    high, medium, low = map(float, settings[STOP : STOP + 3])
    return [
        ProofProblem(
            vehicles.densities, vehicles.temperature, volumes, vehicles.finish, claim.within, claim.spacing, gap,
            max(float(settings[OPEN]), gap), (high, medium, low), int(settings[SLOT]),
        )
        for volumes in vehicles.cut(grid.volume)
    ]  # fmt: skip


def states_seen(station: Station, seen: OperatingBox, stop: tuple[float, float, float]) -> States:
    """The box of the claim as sets, up to where filling takes pressures."""
    plant = station.constants()
    low, high = widened(seen, station)
    floors = np.full((3, KELVINS), np.inf)
    for buffer in range(3):
        floors[buffer, kelvin_of(low[3 + buffer]) : kelvin_of(high[3 + buffer]) + 1] = low[buffer]
    warm = plant.limits.buffer_temperature_max
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
    rule: Reserve, station: Station, seen: OperatingBox, claim: Claim, progress: Progress = None, *,
    ready: States | None = None,
) -> Enclosure:  # fmt: skip
    """Widen the states to where fills lead and try finer and finer cells, until they are proved.

    `ready`: states that are to be proved beside the box.
    """
    for grid in GRIDS:
        tasks = tasks_of(rule, station, claim, grid)
        states = states_seen(station, seen, tasks[0].stop).with_states(ready)
        parts: list[Part] = []
        rounds = 0
        while len(parts) < len(tasks) and not (parts and parts[-1].open):
            if progress:
                progress(f"round {rounds + 1}, {grid}, vehicles {len(parts) + 1} of {len(tasks)}")
            part = prove(states, grid, tasks[len(parts)], station)
            if part.open == OUTSIDE and rounds + 1 < ROUNDS:
                states, parts, rounds = states.wider(part.back), [], rounds + 1
            else:
                parts.append(part)
        found = _whole(states, grid, len(tasks), parts)
        if found.complete:
            return found
    return found


def recheck(
    rule: Reserve,
    station: Station,
    seen: OperatingBox,
    claim: Claim,
    states: States,
    grid: Grid,
    progress: Progress = None,
    *,
    ready: States | None = None,
) -> Enclosure:
    """Prove given states anew with cells of a given size; none is taken at its word."""
    if min(grid[:2]) < min(map(min, (known[:2] for known in GRIDS))) or grid.volume < GRIDS[-1].volume:
        raise ValueError(f"cells must be no smaller than {GRIDS[-1]}; given {grid}")
    tasks, parts = tasks_of(rule, station, claim, grid), []
    for number, task in enumerate(tasks):
        if progress:
            progress(f"{grid}, vehicles {number + 1} of {len(tasks)}")
        parts.append(prove(states, grid, task, station))
        if parts[-1].open:
            break
    found = _whole(states, grid, len(tasks), parts)
    if not states.holds(states_seen(station, seen, tasks[0].stop).with_states(ready)):
        return replace(found, open="the states do not hold the box")
    return found


OUTSIDE = "fills lead out of the states"


class Part(NamedTuple):
    """Statements proved of one cell of vehicles."""

    open: str  # why not, or nothing
    cells: int
    longest: int | None  # [s]
    back: States  # what fills lead to, s and more after a vehicle connected
    hands_on: tuple[np.ndarray, np.ndarray]  # as in Enclosure


def _whole(states: States, grid: Grid, count: int, parts: list[Part]) -> Enclosure:
    """What parts prove together; nothing of the whole unless there are `count`."""
    reason = next((part.open for part in parts if part.open), "")
    if not reason and len(parts) < count:
        raise RuntimeError("not all vehicles were followed")
    longest = [part.longest for part in parts if part.longest is not None]
    low, medium = (
        np.stack([np.min([table[:, 0] for table in tables], 0), np.max([table[:, 1] for table in tables], 0)], 1)
        for tables in zip(*(part.hands_on for part in parts), strict=True)
    )
    return Enclosure(
        states, grid, sum(part.cells for part in parts), count, reason, max(longest) if longest else None, (low, medium)
    )


def _tables(within: int) -> EnclosureTables:
    rows = within + 2

    def ends() -> np.ndarray:
        return np.tile(np.array([np.inf, -np.inf, np.inf, -np.inf]), (rows, BINS, 1))

    def spans(count: int) -> np.ndarray:
        return np.tile(np.array([np.inf, -np.inf]), (count, 1))

    closed = np.tile(np.array([np.inf, -np.inf, np.inf, np.inf, -np.inf, np.inf, -np.inf]), (rows, WARMER * COOLER, 1))
    return EnclosureTables(
        np.zeros((rows, 2)), spans(rows), spans(rows), ends(), ends(), ends(), ends(), np.zeros((rows, 3)),
        spans(rows), closed, spans(2),
    )  # fmt: skip


def prove(states: States, grid: Grid, task: ProofProblem, station: Station) -> Part:
    """Follow every cell of given states; what that proves."""
    plant, tables = station.constants(), _tables(task.within)
    cells = [states.cells(buffer, grid[:2]) for buffer in range(3)]
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
    longest = int(left.max()) if len(left) else None
    return Part(reason, sum(map(len, cells)), longest, back, (tables.to_medium, tables.to_high))


def _where(outcome: int, buffer: str, cell: np.ndarray) -> str:
    low, high, cold, warm = cell
    return f"{OUTCOMES[outcome]}: {buffer} at {low:.1f}-{high:.1f} bar, {cold:.1f} to {warm:.1f} degC"
