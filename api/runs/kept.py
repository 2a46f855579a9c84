"""Stored records as answers: series and vehicles of a run, alone or of a comparison."""

from __future__ import annotations

from http import HTTPStatus

from starlette.responses import Response

from api.http.etags import ConditionalGet
from api.http.problems import ProblemError
from api.http.timeseries import MEDIA, Format, Selection, response, selected
from api.packing import Kept, plant_of, units_of, unpacked, vehicles_of, whole
from api.store.records import Job
from station.columns import VEHICLE_COLUMNS
from station.metrics import state_of_charge
from station.plants.interface import plant_named


def check_kept(job: Job, wanted: Kept, default: Kept) -> None:
    """Raise a problem unless the job keeps what is wanted of its records; `default` where it does not say."""
    kept = Kept(job.summary.get("record", default))
    if kept not in (wanted, Kept.FULL):
        detail = f"{job.kind} {job.id!r} was submitted with record = {kept}"
        raise ProblemError(HTTPStatus.NOT_FOUND, "not-kept", "Not kept", detail)


def series_answer(content: bytes, conditional: ConditionalGet, chosen: Selection, form: Format) -> Response:
    """The columns of a stored record, or what the query selects of them."""
    if form is Format.PARQUET and chosen == Selection():
        return Response(whole(content), media_type=MEDIA[form], headers=conditional.headers)
    units = units_of(content)
    known = set(chosen.columns) <= units.keys()
    table = selected(unpacked(content, ("time", *chosen.columns) if chosen.columns and known else ()), chosen)
    return conditional.tagged(response(table, units, form))


def vehicles_answer(content: bytes, conditional: ConditionalGet, form: Format) -> Response:
    """The vehicles of a stored record."""
    vehicles = vehicles_of(content)
    plant = plant_of(content)
    units = {**VEHICLE_COLUMNS, **plant_named(plant).figures, "state_of_charge": "1"}
    charge = {"state_of_charge": state_of_charge(vehicles, plant)}
    return conditional.tagged(response({**vehicles, **charge}, units, form))
