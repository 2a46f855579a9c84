"""Whether a twin may call itself certified: its certificate is checked once, before it starts."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

from api.http.problems import in_json
from api.twins.schemas import TwinRequest
from controllers.registry import controllers
from controllers.slot import parse
from station import InputError, Station

log = logging.getLogger(__name__)


Belongs = Callable[[dict[str, Any], str, Station], tuple[str, str] | None]
"""Why a certificate is not one of a controller at a station: the field, and what is wrong; None where it is."""


def check_here(document: dict[str, Any], controller: str, station: Station) -> tuple[str, str] | None:
    """`Belongs` in this process, without limits."""
    from controllers.certified.service import RefusedError, check_belongs

    try:
        check_belongs(document, controller, station)
    except RefusedError as error:
        return error.field, error.reason
    return None


def with_certificate_checked(request: TwinRequest, belongs: Belongs = check_here) -> TwinRequest:
    """The request with what is kept of a certificate that holds: its hash. Takes seconds where there is one.

    A scenario in which the claim cannot hold (readings with errors, vehicles that report nothing, seconds undecided
    by anybody) is not covered. Arrivals are not looked at: whether they come s apart is what the claim supposes.

    Raises
    ------
    InputError
        naming the field that is wrong, unless the request allows what is not certified.
    """
    if request.certificate is None:
        return request
    refused = _uncovered(request) or belongs(request.certificate, request.controller, request.scenario.station)
    if refused is not None:
        field = ".".join(part for part in ("certificate", refused[0]) if part)
        if not request.allow_uncertified:
            raise InputError("request", [(field, refused[1])])
        log.warning("a twin starts uncertified: %s: %s", field, refused[1])
        return request.model_copy(update={"certificate": None})
    return request.model_copy(update={"certificate": {"sha256": request.certificate["sha256"]}})


def _uncovered(request: TwinRequest) -> tuple[str, str] | None:
    """Why certificates of service say nothing of a scenario."""
    scenario = request.scenario
    if parse(request.controller)[0] not in controllers():
        return "controller", f"must be installed here; given {in_json(request.controller)}"
    if scenario.disturbance is not None:
        return "scenario.disturbance", "the certificate is about exact readings and the exact plant"
    if scenario.plant_faults:
        return "scenario.faults", "the certificate is about a plant without faults"
    if scenario.idle_period_s != 1:
        return "scenario.idle_period_s", f"must be 1; given {scenario.idle_period_s}"
    if not scenario.communication:
        return "scenario.communication", "the certificate is about vehicles that report; given false"
    return None
