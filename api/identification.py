"""The control model of a station: two forms fitted to days of its plant, or to a measured one, and judged on others."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from controllers import create_from
from station import InputError, simulate
from station.control_model import ControlModel
from station.estimation.calibration import HELD_OUT as LAST_PART
from station.estimation.identification import Form, identify
from station.estimation.interface import Followed
from station.estimation.prediction import (
    BUFFER_HORIZONS,
    VEHICLE_HORIZONS,
    Day,
    PredictionErrors,
    day_of,
    day_of_followed,
    prediction_errors,
)
from station.frames import Frames
from station.parameters import Station
from station.plants.interface import REFERENCE_TEMPERATURE, plant_named
from station.plants.real_gas.registration import REAL_GAS
from station.scenario import Scenario, parse_scenario

HELD_OUT = 2
"""Days on which predictions are judged, of each controller, beside those that the model is fitted to."""

CONTROLLERS = ("logic", "minlp3")
"""Who runs the station on these days: one that takes a bank after another and fills soon, and one that lets all give
at once and fills late. A model that is fitted to the first alone predicts the days of others worse."""

HOURLY_WEIGHTS = (1, 1, 1, 1, 1, 2, 3, 4, 4, 3, 2, 2, 2, 2, 2, 3, 4, 4, 3, 2, 1, 1, 1, 1)
"""Demand of a day, with two peaks."""

LOAD = 0.33
"""Share of a day in which the compressor restores what vehicles take."""

VOLUMES = (0.87, 1.12)
"""Least and greatest tank, by the usual one's."""


class Identified(NamedTuple):
    """A form, its model, and how far its predictions lie from days that it was not fitted to."""

    name: str
    model: ControlModel
    errors: PredictionErrors


def day_at(station: Station) -> Scenario:
    """A day of mixed tanks at a station, as many as keep its compressor busy for LOAD of it."""
    usual = station.vehicle
    low, high = (share * usual.volume_m3 for share in VOLUMES)
    return parse_scenario(
        {
            "name": "identification", "station": station.model_dump(),
            "arrivals": {
                "kind": "profile", "count": _vehicles(station), "hourly_weights": list(HOURLY_WEIGHTS),
                "fleet": [{"name": "mixed", "share": 1, "volume_m3": [low, high]}],
            },
        }
    )  # fmt: skip


def _vehicles(station: Station) -> int:
    """How many usual vehicles a day the compressor can serve in LOAD of it, from the bank of the highest pressure."""
    plant, usual = plant_named(station.plant), station.vehicle
    taken = float(
        plant.held(usual.finish_pressure_bar, usual.temperature_max_c, usual.volume_m3)
        - plant.held(usual.start_pressure_bar, usual.start_temperature_c, usual.volume_m3)
    )
    tank = station.buffers.high
    full = float(plant.held(tank.initial_pressure_bar, REFERENCE_TEMPERATURE, tank.volume_m3))
    seconds = plant.restoring_time(
        0, full - min(taken, 0.5 * full), full, plant.constants_of(station, communication=True)
    )
    seconds *= max(1.0, taken / (0.5 * full))
    return max(2, round(LOAD * 86_400 * station.compressor.count / seconds))


def identify_station(station: Station, days: int, seed: int) -> list[Identified]:
    """The forms of a control model of a station, fitted to `days` of each controller, judged on HELD_OUT others.

    The last one is the one to plan with. The first is the model the station has now.

    Raises
    ------
    InputError
        if nothing is filled in the days.
    """
    scenario = day_at(station)
    drawn = range(1, days + HELD_OUT + 1)
    told = [
        [day_of(simulate(scenario, create_from(each), replication=day, seed=seed)) for day in drawn]
        for each in CONTROLLERS
    ]
    return _identified(station, [day for each in told for day in each[:days]], [each[days:] for each in told])


def identify_followed(station: Station, frames: Frames, followed: Followed) -> list[Identified]:
    """The same, fitted to a measured record as the filter followed it, and judged on its last quarter.

    Raises
    ------
    InputError
        if the record does not tell enough, or nothing is filled in it.
    """
    first = int(len(frames) * (1 - LAST_PART))
    try:
        day = day_of_followed(frames, followed, station.vehicle.volume_m3)
    except ValueError as error:
        raise InputError("identify", [("record", str(error))]) from None
    return _identified(station, [day.part(0, first)], [[day.part(first, len(frames))]])


def _identified(station: Station, fitted: Sequence[Day], judged: Sequence[Sequence[Day]]) -> list[Identified]:
    """Models fitted to some days and judged by the worst of several groups of others."""
    known = station.control_constants()
    found = [Identified("as it is", known, _worst(judged, known))]
    forms = [Form.THESIS, Form.REAL_GAS] if station.plant == REAL_GAS.name else [Form.THESIS]
    for form in forms:
        base = station.form_constants(real_gas=form == Form.REAL_GAS)
        try:
            model = identify(fitted, base, form)
        except ValueError as error:
            raise InputError("identify", [("days", str(error))]) from None
        found.append(Identified(form.value, model, _worst(judged, model)))
    return found


def _worst(judged: Sequence[Sequence[Day]], model: ControlModel) -> PredictionErrors:
    """The greatest errors of any group of days, NaN where none could be judged."""
    found = [prediction_errors(days, model) for days in judged]
    return PredictionErrors(
        *(
            tuple(float(np.fmax.reduce(errors)) for errors in zip(*groups, strict=True))
            for groups in zip(*found, strict=True)
        )
    )


def document(station: str, told: dict[str, Any], found: Sequence[Identified]) -> dict[str, Any]:
    """What was found, as JSON: figures with units in their names. `told` says what they were fitted to."""
    return {
        "station": station,
        **told,
        "horizons_s": {"buffers": list(BUFFER_HORIZONS), "vehicle": list(VEHICLE_HORIZONS)},
        "models": [
            {
                "form": each.name,
                "rms_bar": {"buffers": _known(each.errors.buffers), "vehicle": _known(each.errors.vehicle)},
                "figures": figures(each.model),
            }
            for each in found
        ],
    }  # fmt: skip


def _known(errors: Sequence[float]) -> list[float | None]:
    """Errors, None where no prediction could be judged."""
    return [error if math.isfinite(error) else None for error in errors]


def figures(model: ControlModel) -> dict[str, Any]:
    """The figures of a control model that are identified, as a station file names them."""
    return {
        "driving_pressure_bar": model.driving_pressure,
        "inlet_coefficient_g_per_s_bar": model.inlet_coefficient,
        "outlet_coefficient_g_per_s_bar": model.outlet_coefficient,
        "inlet_heating_k_per_s": list(model.inlet_heating),
        "outlet_cooling_k_per_s": list(model.outlet_cooling),
        "heat_exchange_per_s": model.heat_exchange,
        **(
            {"vehicle_heating_k_per_s": model.vehicle_heating}
            if model.delivered_temperature == 0.0
            else {
                "covolume_l_per_kg": model.covolume * 1e6,
                "delivered_k": model.delivered_temperature,
                "wall_conductance_g_per_s_m3": model.wall_conductance,
            }
        ),
    }


DIGITS = 5
"""Of a figure in a station file."""


def section(found: Identified) -> str:
    """The section `control_model` of a station file, with the errors on days held out."""
    lines = ["[control_model]"]
    lines += [f"{name} = {_toml(value)}" for name, value in figures(found.model).items()]
    lines += [
        f"buffer_errors_bar = {_toml(list(found.errors.buffers), 3)}",
        f"vehicle_errors_bar = {_toml(list(found.errors.vehicle), 3)}",
    ]
    return "\n".join(lines) + "\n"


def _toml(value: Any, digits: int = DIGITS) -> str:
    if isinstance(value, list):
        return f"[{', '.join(_toml(item, digits) for item in value)}]"
    text = f"{value:.{digits}g}"
    return text if any(mark in text for mark in ".e") else f"{text}.0"
