"""The fitted stations with their arrival shapes, and the tables each of them gives."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np

from api.comparisons.service import compare
from api.comparisons.thesis import SIGN_COLUMNS, TABLES, Cells, cells_of
from station import Scenario, load_scenario, load_station, parse_scenario
from station.geometry import KELVIN

FITS = ("thesis-fit", "thesis-fit-cascade", "thesis-fit-a", "thesis-fit-b")
CONTROLLERS = ("logic", "minlp1", "minlp2", "minlp3")

_BUFFERS = ("high", "medium", "low")

PARAMETERS: Mapping[str, Sequence[str]] = {
    **{f"V_{name[0].upper()}": (f"buffers.{name}.volume_m3",) for name in _BUFFERS},
    **{f"p0_{name[0].upper()}": (f"buffers.{name}.initial_pressure_bar",) for name in _BUFFERS},
    "p_com": ("compressor.pressure_bar",),
    "c_f_in": ("compressor.inlet_coefficient_g_per_s_bar",),
    "c_f_out": ("dispenser.outlet_coefficient_g_per_s_bar",),
    "c_T_in": tuple(f"buffers.{name}.inlet_heating_k_per_s" for name in _BUFFERS),
    "c_T_out": tuple(f"buffers.{name}.outlet_cooling_k_per_s" for name in _BUFFERS),
    "c_TV": ("vehicle.heating_k_per_s",),
    "c_Tn": ("thermal.heat_exchange_per_s",),
    "V_V": ("vehicle.volume_m3",),
    "p0_V": ("vehicle.start_pressure_bar",),
    "p_finish": ("vehicle.finish_pressure_bar",),
    "x_pmax": ("controllers.minlp.target_pressure_bar",),
    "c_e": ("controllers.minlp.compressor_weight_bar2", "controllers.minlp.precooler_weight_bar2"),
    **{f"stop_{name[0].upper()}": (f"controllers.logic.stop_pressure_bar.{name}",) for name in _BUFFERS},
    "hysteresis": ("controllers.logic.hysteresis_bar",),
    "cascade_gap": ("controllers.logic.cascade_gap_bar",),
    "T_bmax": ("thermal.buffer_temperature_max_c",),
    "cut_S2": (),
    "cut_S4": (),
}
"""The 26 fitted numbers and where they stand; one that stands in several places moves as one."""


@cache
def shapes() -> dict[str, Any]:
    """What data/fitted_shapes.toml says, by station."""
    return tomllib.loads((files("benchmarks") / "data" / "fitted_shapes.toml").read_text())


def shipped(preset: str) -> list[Scenario]:
    """S1-S4 as they ship, at a fitted station."""
    station = load_station(preset)
    return [load_scenario(name).on(station) for name in TABLES]


def own_shapes(preset: str) -> list[Scenario]:
    """S1-S4 at a fitted station, S2 and S4 with the shapes fitted together with it."""
    own = shapes().get(preset, {})
    return [_with_arrivals(scenario, own.get(scenario.name, {})) for scenario in shipped(preset)]


def unclamped() -> list[Scenario]:
    """`own_shapes` of thesis-fit-b with its medium buffer at the fitted pressure, above the compressor's.

    No station file admits that, so the check of the station is passed by.
    """
    pressure = shapes()["thesis-fit-b"]["unclamped_medium_pressure_bar"]
    found = []
    for scenario in own_shapes("thesis-fit-b"):
        station = scenario.station
        medium = station.buffers.medium.model_copy(update={"initial_pressure_bar": pressure})
        buffers = station.buffers.model_copy(update={"medium": medium})
        found.append(scenario.model_copy(update={"station": station.model_copy(update={"buffers": buffers})}))
    return found


def _with_arrivals(scenario: Scenario, changes: Mapping[str, float]) -> Scenario:
    if not changes:
        return scenario
    document = scenario.model_dump()
    document["arrivals"].update(changes)
    del document["time_limit_s"]  # that of these arrivals is filled in
    return parse_scenario(document, scenario.name)


def perturbed(size: float, random: np.random.Generator) -> list[Scenario]:
    """S1-S4 at thesis-fit with each fitted number times 1 + u, u uniform in [-size, size].

    A temperature is scaled as an absolute one.
    """
    factors = dict(zip(PARAMETERS, 1.0 + size * random.uniform(-1.0, 1.0, len(PARAMETERS)), strict=True))
    station = load_station("thesis-fit").model_dump()
    for name, places in PARAMETERS.items():
        for place in places:
            *groups, last = place.split(".")
            group = station
            for step in groups:
                group = group[step]
            offset = KELVIN if name == "T_bmax" else 0.0
            group[last] = (group[last] + offset) * factors[name] - offset
    found = []
    for name in TABLES:
        document = load_scenario(name).model_dump()
        if f"cut_{name}" in factors:
            document["arrivals"]["truncation"] *= factors[f"cut_{name}"]
        found.append(parse_scenario({**document, "station": station}, name))
    return found


def figures(scenarios: Sequence[Scenario]) -> Cells:
    """t_total, t_comp and t_dis [s] of the four controllers on replication 0, with t_avg beside them."""
    results = compare(scenarios, CONTROLLERS)
    cells = dict(cells_of(results))
    for result in results:
        cells[result.scenario, result.controller, "t_avg"] = result.metrics.t_avg
    if len(cells) != len(scenarios) * len(CONTROLLERS) * (len(SIGN_COLUMNS) + 1):
        raise AssertionError("a figure is missing")
    return cells
