"""GET /v1/controllers: what can sit in the slot."""

from __future__ import annotations

from fastapi import APIRouter

from api.controllers.schemas import ControllerSummary
from api.controllers.service import about, options_schema
from api.problems import not_found
from controllers import controllers

router = APIRouter(prefix="/v1/controllers", tags=["controllers"])


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


def _summary(name: str) -> ControllerSummary:
    return ControllerSummary(name=name, about=about(name), options=options_schema(name))
