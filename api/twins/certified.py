"""Whether a twin may call itself certified: its certificate is checked once, before it starts."""

from __future__ import annotations

import logging

from api.twins.schemas import TwinRequest
from controllers.registry import controllers
from controllers.slot import parse
from station import InputError

log = logging.getLogger(__name__)


def with_certificate_checked(request: TwinRequest) -> TwinRequest:
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
    from controllers.certified.service import RefusedError, check_belongs

    try:
        _check_covered(request)
        check_belongs(request.certificate, request.controller, request.scenario.station)
    except RefusedError as error:
        if not request.allow_uncertified:
            field = ".".join(part for part in ("certificate", error.field) if part)
            raise InputError("request", [(field, error.reason)]) from None
        log.warning("a twin starts uncertified: %s", error)
        return request.model_copy(update={"certificate": None})
    return request.model_copy(update={"certificate": {"sha256": request.certificate["sha256"]}})


def _check_covered(request: TwinRequest) -> None:
    """Raise RefusedError for a scenario of which certificates of service say nothing."""
    from controllers.certified.service import RefusedError

    scenario = request.scenario
    if parse(request.controller)[0] not in controllers():
        raise RefusedError("controller", f"must be installed here; given {request.controller!r}")
    if scenario.disturbance is not None:
        raise RefusedError("scenario.disturbance", "the certificate is about exact readings and the exact plant")
    if scenario.idle_period_s != 1:
        raise RefusedError("scenario.idle_period_s", f"must be 1; given {scenario.idle_period_s}")
    if not scenario.communication:
        raise RefusedError("scenario.communication", "the certificate is about vehicles that report; given false")
