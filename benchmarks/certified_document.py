"""The generated parts of docs/certified.md: margins, what they cost, half-widths of estimates and predictions."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from itertools import product

import numpy as np

from benchmarks.documents import recompute, table
from controllers import create
from controllers.certified import Box, Estimate, Estimator, group_of, predict
from controllers.certified.estimation import TANKS
from station import Scenario, load_scenario, load_station, parse_scenario, presets, simulate
from station.controller import Observation
from station.margins import certify, covered_limits
from station.plants.thesis import THESIS, gas_mass, gas_pressure
from station.readings import observations
from station.record import Record
from station.uncertainty import Uncertainty

DOCUMENT = "certified.md"

PRESETS = [name for name in presets() if load_station(name).plant == THESIS.name]
"""Stations of the plant for which margins are proved."""

SEEDS = 4
"""Disturbed runs a figure is the median of."""

HORIZONS = (1, 10, 30, 60, 120)
"""Seconds ahead of the table of predictions."""


def disturbed(preset: str, scenario: str = "S1", **changes: object) -> Scenario:
    """A shipped scenario with the default uncertainty, sensors and plant as given (default: uniform)."""
    base = load_scenario(scenario).on(load_station(preset)).model_dump()
    communication = changes.pop("communication", True)
    return parse_scenario({**base, "communication": communication, "disturbance": changes})


def margins_part() -> str:
    """The margins of every preset under the default uncertainty."""
    rows = []
    for preset in PRESETS:
        station = load_station(preset)
        proof = certify(station, Uncertainty())
        m = proof.margins
        figures = (m[limit.name] for limit in covered_limits(station.constants()))
        rows.append([preset, *(f"{figure:.3f}" for figure in figures), str(proof.check())])
    heads = ["station", "(7.11) [g/s]", "(7.12) [bar]", "(7.13) [K]", "(7.15) [K]", "(7.16) [bar]", "p_com [bar]",
             "corners proved"]  # fmt: skip
    return table(heads, rows)


def cost_part() -> str:
    """Waits of S1 with and without disturbance; medians over seeds with plant and sensors at their corners."""
    rows = []
    for preset, name in product(PRESETS, ("logic", "minlp1")):
        plain = simulate(load_scenario("S1").on(load_station(preset)), create(name)).metrics()
        cells = [preset, name, f"{plain.t_total:.0f}"]
        for communication in (True, False):
            found = [
                simulate(
                    disturbed(preset, sensors="corner", plant="corner", seed=seed, communication=communication),
                    create(name),
                ).metrics()
                for seed in range(SEEDS)
            ]
            left = max(one.vehicles_not_finished for one in found)
            cells += [f"{np.median([one.t_total for one in found]):.0f}", f"{left:.0f}"]
        rows.append(cells)
    heads = ["station", "controller", "exact: t_total [s]", "disturbed: t_total [s]", "unserved",
             "and no communication: t_total [s]", "unserved"]  # fmt: skip
    return table(heads, rows, left=2)


def _estimates(record: Record) -> tuple[list[Estimate], list[Observation], Estimator]:
    estimator, seen = Estimator(record.scenario.known_station), list(observations(record))
    return [estimator.update(one) for one in seen], seen, estimator


def estimates_part() -> str:
    """Certified half-widths beside the reading's error, and what one run met."""
    rows = []
    for preset in PRESETS:
        station = load_station(preset)
        scenario = disturbed(preset, sensors="uniform", plant="corner")
        record = simulate(scenario, create("minlp1"))
        found, seen, estimator = _estimates(record)
        for tank, name in enumerate(TANKS):
            group = estimator.group(tank, station.vehicle.volume_m3)
            unit, smooth = group.unit[0], estimator.observer(tank, station.vehicle.volume_m3).half_widths[0]
            tight = group.observer(smooth=False).half_widths[0]
            true = record[f"mass_{name}"]
            mass = np.array([one.mass[tank] for one in found])
            half = np.array([one.high[tank] - one.low[tank] for one in found]) / 2
            told = _told(seen, tank, estimator, station.vehicle.volume_m3)
            raw, met = (np.sqrt(np.nanmean((value - true) ** 2)) for value in (told, mass))
            bar = unit * gas_pressure(1.0, 25.0, (*estimator.plant.buffer_volume, station.vehicle.volume_m3)[tank])
            rows.append([preset, name, f"{unit:.0f}", f"{bar:.1f}", f"{tight:.3f}", f"{smooth:.3f}", f"{raw:.1f}",
                         f"{met:.1f}", f"{np.nanmedian(half):.1f}"])  # fmt: skip
    heads = [
        "station",
        "tank",
        "a reading's mass error [g]",
        "as pressure at 25 degC [bar]",
        "certified, smallest",
        "certified, smooth",
        "RMS of readings [g]",
        "RMS of estimates [g]",
        "the interval, median [g]",
    ]
    return table(heads, rows, left=2)


def _told(seen: Sequence[Observation], tank: int, estimator: Estimator, volume: float) -> np.ndarray:
    """The masses that readings alone tell [g]."""
    if tank < 3:
        size = estimator.plant.buffer_volume[tank]
        return np.array([gas_mass(one.pressure[tank], one.temperature[tank], size) for one in seen])
    return np.array([gas_mass(one.vehicle_pressure, one.vehicle_temperature, volume) for one in seen])


def whole_part() -> str:
    """The four tanks as one system with every command."""
    rows = []
    for preset in PRESETS:
        station = load_station(preset)
        plant = station.constants()
        group = group_of(plant, Uncertainty(), (0, 1, 2, 3), Box.of(station), station.vehicle.volume_m3)
        observer = group.observer()
        verdict = observer.certificate.verdict
        rows.append([preset, str(len(group.modes)), *(f"{item:.2f}" for item in observer.half_widths),
                     str(verdict.inequalities)])  # fmt: skip
    return table(["station", "modes", *TANKS, "inequalities proved"], rows)


def predictions_part() -> str:
    """Half-widths of predicted pressures of S1 under minlp1, from estimates at every tenth second."""
    record = simulate(disturbed("thesis-fit", plant="corner"), create("minlp1"))
    found, seen, estimator = _estimates(record)
    widths: dict[int, list[list[float]]] = {horizon: [] for horizon in HORIZONS}
    for start in range(10, len(record) - 1, 10):
        vehicle = seen[start].vehicle
        stop = next((row for row in range(start, len(record)) if seen[row].vehicle != vehicle), len(record)) - 1
        applied = [one.previous for one in seen[start + 1 : stop + 1]][: max(HORIZONS)]
        tubes = predict(found[start].tanks, applied, estimator.known(seen[start]))
        for horizon in HORIZONS:
            if vehicle >= 0 and len(tubes) >= horizon:
                ends = Estimate((), (), (), (), tubes[horizon - 1]).pressure
                widths[horizon].append([(high - low) / 2 for low, high in ends])
    rows = [[str(h), str(len(w)), *(f"{x:.2f}" for x in np.median(w, axis=0))] for h, w in widths.items() if w]
    return table(["seconds ahead", "predictions", *(f"{tank} [bar]" for tank in TANKS)], rows)


def parts() -> dict[str, Callable[[], str]]:
    """Every generated part of the document."""
    return {
        "margins": margins_part, "cost": cost_part, "estimates": estimates_part, "whole station": whole_part,
        "predictions": predictions_part,
    }  # fmt: skip


if __name__ == "__main__":
    recompute(DOCUMENT, parts(), sys.argv[1:])
