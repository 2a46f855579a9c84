"""What a calibration of a twin is made of, and the station that a twin may be moved to."""

from __future__ import annotations

import time
from collections.abc import Sequence
from importlib.metadata import version
from typing import Any

import numpy as np

from api.calibrations.record import encoded_seconds
from api.calibrations.schemas import CalibrationRequest
from api.http.problems import conflict
from api.http.timeseries import Selection
from api.jobs.work import Spec
from api.moments import written
from api.settings import Settings
from api.store.jobs import JobRepository
from api.store.records import JobKind, JobState
from api.twins.minutes import RESOLUTION
from api.twins.queries import TwinQueries
from station import InputError, Station
from station.estimation.calibration import SHORTEST
from station.estimation.filter import model_of
from station.sensor_names import SENSORS

_COLUMNS = ("source_time", RESOLUTION, *(f"measured_{name}" for name in SENSORS))

_NAMING = ("name", "about", "source", "calibrated", "unknown_buffers", "volume_deviations_percent")
"""Fields of a station that say what it is, not what it does."""


def calibration_spec(twins: TwinQueries, request: CalibrationRequest, settings: Settings) -> Spec:
    """A job that calibrates the station of a measured twin from what it was measured.

    Raises
    ------
    InputError
        if there is no such twin, its station's plant is not followed, or the stretch is too short, too long or not
        kept whole.
    ProblemError
        409 where the twin measures nothing.
    """
    if not twins.known(request.twin):
        raise InputError("request", [("twin", f"no twin is called {request.twin!r}")])
    tags = twins.tags(request.twin)
    station = twins.scenario(request.twin).station
    model_of(station)  # refuses a plant that is not followed
    first, last = _stretch(twins, request, settings)
    columns = twins.columns(request.twin, Selection(_COLUMNS, float(first), float(last)))
    kept = np.flatnonzero(columns[RESOLUTION] == 1.0)
    _check_length(last - first + 1 if request.from_s is not None else len(kept), settings)
    if not len(kept) or (request.from_s is not None and len(kept) <= last - first):
        begin = int(columns["time"][kept[0]]) if len(kept) else last + 1
        message = f"must be kept whole: of second {first} minutes are left, or nothing, up to second {begin}"
        raise InputError("request", [("from_s", message)])
    values = np.column_stack([columns[f"measured_{name}"][kept] for name in SENSORS])
    return {
        "twin": request.twin, "from_s": int(columns["time"][kept[0]]), "to_s": last,
        "station": station.model_dump(mode="json"), "version": version("hrs-twin"),
        "asked": written(time.time(), "seconds"),
        "record": encoded_seconds(float(columns["source_time"][kept[0]]), values, tags),
    }  # fmt: skip


def _stretch(twins: TwinQueries, request: CalibrationRequest, settings: Settings) -> tuple[int, int]:
    """First and last second; what is not said is the newest, at most as long as the settings allow, by right clocks."""
    newest = twins.samples(request.twin) - 1
    last = newest if request.to_s is None else request.to_s
    if last > newest:
        raise InputError("request", [("to_s", f"must be at most {newest}, the newest second; given {last}")])
    first = request.from_s
    if first is None:
        first = max(twins.clocks_seq(request.twin), last + 1 - int(settings.calibration_max_s))
    if first > last:
        raise InputError("request", [("from_s", f"must not lie behind second {last}; given {first}")])
    return first, last


def _check_length(seconds: int, settings: Settings) -> None:
    longest = int(settings.calibration_max_s)
    if not SHORTEST <= seconds <= longest:
        limits = f"must be {SHORTEST} to {longest} seconds with to_s (setting calibration_max_s)"
        raise InputError("request", [("from_s", f"{limits}; given {seconds}")])


def accepted_station(jobs: JobRepository, calibration_id: str) -> tuple[Station, Sequence[str]]:
    """The station that a calibration found, and the parameters that it looked for.

    Raises
    ------
    InputError
        if there is no such calibration.
    ProblemError
        409 where it has not succeeded, or the model was refused.
    """
    found = jobs.get_with_result(calibration_id)
    if found is None or found[0].kind is not JobKind.CALIBRATION:
        raise InputError("request", [("calibration", f"no calibration is called {calibration_id!r:.60}")])
    job, rows = found
    if job.state is not JobState.SUCCEEDED or not rows:
        raise conflict(f"calibration {job.id!r} is {job.state}: it has no station")
    if rows[0]["station"] is None:
        why = "; ".join(rows[0]["refused"])
        raise conflict(f"calibration {job.id!r} refused the model, and has no station: {why:.500}")
    return Station.model_validate(rows[0]["station"]), list(rows[0]["parameters"])


def check_shape(known: Station, calibrated: Station, parameters: Sequence[str]) -> None:
    """Refuse a station that differs from the one a twin follows in more than parameters that calibrations find.

    Raises
    ------
    ProblemError
        409 which names the fields.
    """
    free = {*parameters, *_NAMING}
    one, other = _leaves(known.model_dump(mode="json")), _leaves(calibrated.model_dump(mode="json"))
    differing = sorted(
        name
        for name in one.keys() | other.keys()
        if not free & {name, name.partition(".")[0]}
        and not name.endswith(".initial_pressure_bar")
        and one.get(name) != other.get(name)
    )
    if differing:
        raise conflict(f"the calibrated station is another than the twin's: {', '.join(differing[:5])} differ")


def _leaves(document: dict[str, Any], before: str = "") -> dict[str, Any]:
    """Figures by the path of their fields."""
    found: dict[str, Any] = {}
    for name, value in document.items():
        if isinstance(value, dict):
            found |= _leaves(value, f"{before}{name}.")
        else:
            found[before + name] = value
    return found
