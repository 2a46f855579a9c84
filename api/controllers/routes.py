"""GET /v1/controllers: what can sit in the slot."""

from __future__ import annotations

from http import HTTPStatus
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Query

from api.controllers.certificates import DocumentKind, ServiceCertificates
from api.controllers.schemas import ControllerSummary, ServiceCertificateState, ServiceVerification
from api.controllers.service import about, options_schema
from api.http.authorization import requires
from api.http.dependencies import StoreRoomDep, provided
from api.http.problems import MEDIA_TYPE, not_found
from api.scopes import Scope
from controllers import controllers
from controllers.registry import is_ready
from station import Station, load_station, presets
from station.preset_files import DEFAULT_PRESET

router = APIRouter(prefix="/v1/controllers", tags=["controllers"])

Preset = Annotated[str, Query(max_length=64, description="A preset", examples=["thesis-fit"])]
Options = Annotated[str, Query(max_length=200, description="As behind a controller's name", examples=["gap_bar=200"])]

Of = Annotated[DocumentKind, Query(description="The document, or the check of it", examples=["certificate"])]

CertificatesDep = Annotated[ServiceCertificates, Depends(provided(ServiceCertificates))]

IN_THE_MAKING: dict[int | str, dict[str, Any]] = {
    HTTPStatus.SERVICE_UNAVAILABLE: {
        "description": "It is being made; `Retry-After` says when to ask again",
        "content": {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}},
    }
}


@router.get("")
def list_controllers() -> list[ControllerSummary]:
    """The controllers that are installed."""
    return [_summary(name) for name in controllers()]


@router.get("/{name}")
def get_controller(name: str) -> ControllerSummary:
    """One controller."""
    if name not in controllers():
        raise not_found("controller", name, list(controllers()))
    return _summary(name)


@router.get("/{name}/certificate", responses=IN_THE_MAKING)
def get_service_certificate(
    name: str, certificates: CertificatesDep, station: Preset = DEFAULT_PRESET, options: Options = ""
) -> dict[str, Any]:
    """The proof, or the test, of a controller's service at a station: the document `hrs verify` reads.

    404 until the POST has had it made.
    """
    return certificates.get("certificate", *_subject(name, station, options))


@router.post("/{name}/certificate", status_code=202)
@requires(Scope.RUN)
def begin_service_certificate(
    name: str, certificates: CertificatesDep, room: StoreRoomDep, station: Preset = DEFAULT_PRESET,
    options: Options = "", of: Of = "certificate",
) -> ServiceCertificateState:  # fmt: skip
    """Have that document, or the check of it, made; one that is there or being made stays as it is."""
    subject = _subject(name, station, options)
    room.check()
    certificates.begin(of, *subject)
    return _stands(certificates, of, subject)


@router.get("/{name}/certificate/state")
def get_service_certificate_state(
    name: str,
    certificates: CertificatesDep,
    station: Preset = DEFAULT_PRESET,
    options: Options = "",
    of: Of = "certificate",
) -> ServiceCertificateState:
    """How far that document, or the check of it, is; for a page that watches it being made."""
    return _stands(certificates, of, _subject(name, station, options))


def _stands(
    certificates: ServiceCertificates, of: DocumentKind, subject: tuple[str, Station]
) -> ServiceCertificateState:
    state, found = certificates.state(of, *subject)
    return ServiceCertificateState(state=state, verdict=found.get("verdict"), claim=found.get("claim"))


@router.get("/{name}/certificate/verification", responses=IN_THE_MAKING)
def get_service_verification(
    name: str, certificates: CertificatesDep, station: Preset = DEFAULT_PRESET, options: Options = ""
) -> ServiceVerification:
    """Whether that document holds: everything in it computed anew and every cell proved again.

    404 until the POST with `of=verification` has had it checked.
    """
    found = certificates.get("verification", *_subject(name, station, options))
    return ServiceVerification.model_validate(found)


def _subject(name: str, station: str, options: str) -> tuple[str, Station]:
    if name not in controllers():
        raise not_found("controller", name, list(controllers()))
    if station not in presets():
        raise not_found("station", station, presets())
    return ":".join(filter(None, (name, options))), load_station(station)


def _summary(name: str) -> ControllerSummary:
    if not is_ready(name):
        return ControllerSummary(name=name, about="", ready=False, options={})
    return ControllerSummary(name=name, about=about(name), ready=True, options=options_schema(name))
