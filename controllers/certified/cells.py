"""The box of a claim cut into cells until each is proved: the search, and the check of what it left behind."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from controllers.certified.box import Seen, widened
from controllers.certified.envelope import Task
from controllers.certified.fill import CELL, FILL, GAP, OUTCOME, OUTCOMES, RESULT, SERVED, TEMPERATURE, prove_all
from controllers.certified.tank import settled_of
from controllers.reserve import GAP as GAP_SETTING
from controllers.reserve import SLOT, STOP, Reserve
from station.parameters import Station
from station.plant import KELVIN, SPECIFIC_GAS, gas_mass

CELLS = 4000
"""Most cells looked at in a round; some 20 s."""

ROUNDS = 3
"""How often the box's least temperatures are lowered to where fills take the buffers."""

BATCH = 256

_SCALE = np.array([40.0, 4.0, 8.0, 4.0, 8.0, 4.0])
"""Widths that matter alike [bar], [K]: a cell is cut where it is widest by these."""

_SHARE = 0.995
"""Of the pressure of a full buffer: up to here the filling of high and medium is counted during a fill."""

Progress = Callable[[str], None] | None


@dataclass(frozen=True)
class Box:
    """The states of a claim; pressures [bar] and temperatures [deg C] of high, medium, low."""

    low: tuple[float, ...]
    high: tuple[float, ...]
    cold: tuple[float, ...]
    warm: tuple[float, ...]

    def cell(self) -> np.ndarray:
        """The box as one cell (CELL,)."""
        return np.array([(self.low[b], self.high[b], self.cold[b], self.warm[b]) for b in range(3)]).reshape(CELL)

    def as_document(self) -> dict[str, Any]:
        """As JSON holds it."""
        return {
            "pressure_low_bar": list(self.low), "pressure_high_bar": list(self.high),
            "temperature_low_c": list(self.cold), "temperature_high_c": list(self.warm),
        }  # fmt: skip


@dataclass(frozen=True)
class Enclosure:
    """What the cells prove."""

    box: Box
    cells: np.ndarray  # (n, CELL), those proved
    results: np.ndarray  # (n, RESULT)
    share: float  # of the box's volume
    first_open: str  # why one of the others is not proved

    @property
    def complete(self) -> bool:
        """Whether every state of the box is in a cell that is proved, and fills lead back into the box."""
        back = np.array(self.box.cold)
        return self.first_open == "" and bool((self.results[:, TEMPERATURE:] >= back).all())

    def as_document(self) -> dict[str, Any]:
        """Figures as JSON holds them, and the cells of a proof that is complete."""
        return {
            "method": "interval enclosure of the closed loop, double arithmetic rounded outward by 1e-11 a second",
            "complete": self.complete, "share": round(self.share, 9), "open": self.first_open,
            "longest_fill_s": int(self.results[:, FILL].max()) if len(self.results) else None,
            "closest_gap_bar": float(self.results[:, GAP].min()) if len(self.results) else None,
            "cells": self.cells.tolist() if self.complete else [],
            "fills_s": self.results[:, FILL].astype(int).tolist() if self.complete else [],
        }  # fmt: skip


def task_of(rule: Reserve, station: Station, seen: Seen, low: tuple[float, ...]) -> Task:
    """What is to be proved of a station's usual vehicle under the reserve rule."""
    rule.start(station)
    settings, vehicle = rule.compiled().settings, station.vehicle
    stop = float(settings[STOP])
    return Task(
        float(gas_mass(vehicle.start_pressure_bar, vehicle.start_temperature_c, vehicle.volume_m3)),
        vehicle.start_temperature_c, vehicle.volume_m3, vehicle.finish_pressure_bar, seen.within, seen.spacing,
        max(float(settings[GAP_SETTING]), station.dispenser.outlet_gap_min_bar), stop, int(settings[SLOT]),
        _SHARE * stop, (low[0], low[1], low[2]),
    )  # fmt: skip


def box_of(station: Station, seen: Seen, stop: float, cold: np.ndarray) -> Box:
    """The smallest box that holds what was seen, 5 % more, and is closed upwards under the rule.

    A buffer is filled only below `stop`, so it rises above it by one second's filling at most, and a cold one by what
    the surroundings warm it; filling heats it to where it settles, or to its limit.
    """
    plant = station.constants()
    low, high = widened(seen, station)
    warm = [min(plant.buffer_temperature_max, max(high[3 + buffer], settled_of(buffer, plant))) for buffer in range(3)]
    top = []
    for buffer in range(3):
        hottest = warm[buffer] + KELVIN
        grams = plant.inlet_coefficient * max(plant.compressor_pressure - stop, 0.0)
        rise = grams * SPECIFIC_GAS / plant.buffer_volume[buffer] * hottest
        rise += stop * plant.inlet_heating[buffer] / (cold[buffer] + KELVIN)
        warmed = max(1.0, (plant.ambient_temperature + KELVIN) / (cold[buffer] + KELVIN))
        top.append(float(max(high[buffer], stop + rise) * warmed * (1.0 + 1e-9)))
    return Box(tuple(map(float, low[:3])), tuple(top), tuple(map(float, cold)), tuple(map(float, warm)))


def enclose(rule: Reserve, station: Station, seen: Seen, progress: Progress = None) -> Enclosure:
    """Cut and prove until the box is covered or CELLS cells were looked at."""
    low, _ = widened(seen, station)
    cold = _first_guess(station, seen, low[3:])
    task = task_of(rule, station, seen, tuple(map(float, low[:3])))
    for number in range(ROUNDS):
        found = _cut(box_of(station, seen, task.stop, cold), task, station, f"round {number + 1}", progress)
        if found.first_open or found.complete:
            return found
        cold = np.minimum(cold, found.results[:, TEMPERATURE:].min(0)) - 0.2
    return found


def _first_guess(station: Station, seen: Seen, low: np.ndarray) -> np.ndarray:
    """Least temperatures [deg C] with which the search begins: half a fill's cooling, warmed until s is over."""
    plant = station.constants()
    half = seen.worst_fill / 2
    left = np.exp(-plant.heat_exchange * max(seen.spacing - half, 0.0))
    return np.minimum(low, plant.ambient_temperature - np.array(plant.outlet_cooling) * half * left) - 0.2


def _halves(cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Each cell cut where it is widest."""
    widest = ((cells[:, 1::2] - cells[:, 0::2]) / _SCALE).argmax(1)
    rows = np.arange(len(cells))
    middle = (cells[rows, 2 * widest] + cells[rows, 2 * widest + 1]) / 2
    first, second = cells.copy(), cells.copy()
    first[rows, 2 * widest + 1] = middle
    second[rows, 2 * widest] = middle
    return first, second


def _proved(cells: np.ndarray, task: Task, station: Station) -> np.ndarray:
    results = np.empty((len(cells), RESULT))
    prove_all(cells, task, station.constants(), results)
    return results


def _volume(cells: np.ndarray) -> float:
    return float(np.prod(cells[:, 1::2] - cells[:, 0::2], axis=1).sum())


def _cut(box: Box, task: Task, station: Station, what: str, progress: Progress) -> Enclosure:
    todo = box.cell()[None]
    whole, looked_at, done = _volume(todo), 0, 0.0
    cells, results = [np.empty((0, CELL))], [np.empty((0, RESULT))]
    reason = "T is not below s" if task.within >= task.spacing else ""
    while len(todo) and looked_at < CELLS and not reason:
        batch, todo = todo[:BATCH], todo[BATCH:]
        found = _proved(batch, task, station)
        served = found[:, OUTCOME] == SERVED
        looked_at += len(batch)
        done += _volume(batch[served])
        cells.append(batch[served])
        results.append(found[served])
        todo = np.concatenate((todo, *_halves(batch[~served])))
        last = OUTCOMES[int(found[~served][0, OUTCOME])] if not served.all() else ""
        if progress:
            progress(f"{what}: {looked_at} cells, {done / whole:.1%} of the box proved")
    if len(todo) and not reason:
        reason = f"after {looked_at} cells: {last}"
    return Enclosure(box, np.concatenate(cells), np.concatenate(results), done / whole, reason)


def covers(cells: np.ndarray, box: Box) -> bool:
    """Whether cells are exactly what cutting the box leaves: together they hold every state of it."""
    left = {tuple(cell) for cell in cells.tolist()}
    if len(left) != len(cells):
        return False
    todo = [box.cell()]
    for _ in range(4 * len(cells) + 4):
        if not todo:
            return not left
        cell = todo.pop()
        if tuple(cell.tolist()) in left:
            left.remove(tuple(cell.tolist()))
            continue
        first, second = _halves(cell[None])
        todo += [first[0], second[0]]
    return False


def recheck(rule: Reserve, station: Station, seen: Seen, cold: np.ndarray, cells: np.ndarray) -> Enclosure:
    """Prove given cells anew, for a box with these least temperatures; none is taken at its word."""
    low, _ = widened(seen, station)
    task = task_of(rule, station, seen, tuple(map(float, low[:3])))
    box = box_of(station, seen, task.stop, cold)
    reason = ""
    if task.within >= task.spacing:
        reason = "T is not below s"
    elif (cold > low[3:]).any() or not covers(cells, box):
        reason = "the cells do not cover the box"
    results = _proved(cells, task, station)
    if not reason and (results[:, OUTCOME] != SERVED).any():
        reason = OUTCOMES[int(results[results[:, OUTCOME] != SERVED][0, OUTCOME])]
    served = results[:, OUTCOME] == SERVED
    share = _volume(cells[served]) / _volume(box.cell()[None])
    return Enclosure(box, cells[served], results[served], share, reason)
