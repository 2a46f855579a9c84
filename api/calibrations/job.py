"""Calibrations as jobs: the measured seconds travel with the job, so that nothing else decides what it finds."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from api.jobs.progress import report
from api.jobs.work import JobType, Spec, encoded_rows, single_chunk, whole_spec
from api.store.records import ChunkResult

if TYPE_CHECKING:
    from station import Station
    from station.estimation.calibration import Calibration

_SHOWN = ("twin", "from_s", "to_s", "version")

NAME_MAX = 52
"""Characters of a station's name that the name of a calibrated one begins with."""


def _summary(spec: Spec) -> dict[str, Any]:
    shown = {name: spec[name] for name in _SHOWN}
    return {**shown, "station": spec["station"]["name"], "start": spec["record"]["start"]}


def _compute(task: dict[str, Any]) -> ChunkResult:
    """The verdict on the station, its parameters and, where it is accepted, the calibrated one."""
    from api.calibrations.record import decoded_frames  # kernels, which take long to import
    from station import Station
    from station.estimation.calibration import calibrate

    known = Station.model_validate(task["station"])
    frames = decoded_frames(task["record"])
    found = calibrate(frames, known, report)
    whose = f"{len(frames)} s of twin {task['twin']} from second {task['from_s']} on"
    by = f"hrs-twin {task['version']} on {task['asked']} from {whose}"
    return ChunkResult(encoded_rows([row_of(found, known, by)]), 1)


def row_of(found: Calibration, known: Station, by: str) -> dict[str, Any]:
    """What a calibration found, as JSON carries it; `by` is what the calibrated station's source says of it."""
    station = calibrated_station(found, known, by)
    return {
        "verdict": "refused" if station is None else "accepted",
        "refused": found.refused,
        "parameters": {name: asdict(each) for name, each in found.parameters.items()},
        "unknown": [name for name, each in found.parameters.items() if not each.known],
        "channels": {name: asdict(fit) for name, fit in found.fits.items()},
        "station": None if station is None else station.model_dump(mode="json", exclude_none=True),
    }


def calibrated_station(found: Calibration, known: Station, by: str) -> Station | None:
    """The station that a calibration found, whose source says where it comes from; None where the model is refused."""
    if found.refused or found.station is None:
        return None
    unknown = ", ".join(name for name, each in found.parameters.items() if not each.known) or "none"
    before = known.source.partition("Calibrated by ")[0].strip()
    source = f"{before} Calibrated by {by}; not known: {unknown}.".strip()
    name = known.name if known.name.endswith("-calibrated") else f"{known.name[:NAME_MAX]}-calibrated"
    return found.station.model_copy(update={"name": name, "source": source, "calibrated": True})


CALIBRATION = JobType(_summary, single_chunk, whole_spec, _compute)
