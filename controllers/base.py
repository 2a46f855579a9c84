"""Common parts of our controllers: settings from preset and options, logic as fallback, the compiled decision."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field, ValidationError

from controllers.registry import FALLBACK
from controllers.slot import create
from station.controller import CompiledController, Decision, Observation
from station.entry_points import EntryPoint
from station.errors import InputError, StationError
from station.kernels import ask
from station.parameters import Station
from station.quantities import Part


class Settings(Part):
    """Base of a controller's settings: frozen, unknown names are errors."""

    liveness_s: Annotated[
        Annotated[float, Field(ge=0, le=86_400, allow_inf_nan=False, json_schema_extra={"unit": "s"})] | None,
        Field(
            description="Logic stands in where a vehicle could be given gas and was given none for so long; 0: never; "
            "left out: as the station's `slot` says"
        ),
    ] = None


class BaseController:
    """Base of our controllers: settings from the station's preset and the caller's options, logic as fallback.

    A subclass sets `name`, `about` and `obeys_hold`, and either `compiled` (ours) or `decide` (a plug-in).
    """

    name: str = ""
    about: str = ""
    obeys_hold: bool = True
    settings_type: ClassVar[type[Settings]] = Settings
    settings_key: ClassVar[str] = ""
    """Entry of the station's `controllers` with settings that others may share; that of the own name goes over it."""

    def __init__(self, **options: Any) -> None:
        self._options = options
        self.check_options(options)
        self.station: Station

    @classmethod
    def check_options(cls, options: dict[str, Any]) -> None:
        """Raise InputError for an option that is unknown or out of its limits."""
        try:
            cls.settings_type.model_validate(options)
        except ValidationError as error:
            found = InputError.of(f"controller {cls.name}", error)
            wrong = [
                problem
                for problem, item in zip(found.problems, error.errors(), strict=True)
                if item["type"] != "missing"
            ]
            if wrong:
                raise InputError(found.source, wrong) from None

    def settings_for(self, station: Station) -> Any:
        """The station's settings for this controller, those of its own name over shared ones, and the caller's options.

        Raises
        ------
        InputError
            naming each wrong or missing setting.
        """
        tables = station.controllers
        given = {**tables.get(self.settings_key, {}), **tables.get(self.name, {}), **self._options}
        try:
            return self.settings_type.model_validate(given)
        except ValidationError as error:
            wrong = {item["loc"][0] for item in error.errors() if item["loc"]}
            place = self.name if wrong & set(tables.get(self.name, {})) else self.settings_key
            raise InputError.of(f"station {station.name}, controllers.{place}", error) from None

    @property
    def fallback(self) -> Any:
        """Controller that decides where the shield closes a valve or a deadline passes: logic."""
        return create(FALLBACK)

    @property
    def liveness_s(self) -> float | None:
        """For how long a vehicle may be given nothing before logic stands in [s]; None: as the station says."""
        found: float | None = self.settings_for(self.station).liveness_s
        return found

    def start(self, station: Station) -> None:
        """Prepare for a run on `station`; raises InputError where its settings do not fit."""
        self.station = station
        self.settings_for(station)


class CompiledBase(BaseController):
    """Base of controllers that run in the compiled loop; `decide` asks the same compiled code."""

    _ready: CompiledController | None = None

    @property
    def bounded_time(self) -> bool:
        """Whether a decision is sure to come within some 50 ms, so that live use needs no deadline to enforce it."""
        return True

    def compiled(self) -> CompiledController | None:
        """This controller for the compiled loop, with fresh memory."""
        raise NotImplementedError(f"{type(self).__name__} must define compiled()")

    def start(self, station: Station) -> None:
        """Prepare for a run on `station`."""
        super().start(station)
        self._ready = self.compiled()
        self._ask = EntryPoint(ask)

    @property
    def memory(self) -> np.ndarray | None:
        """State of this controller between decisions (float64); None where a solver decides."""
        return None if self._ready is None else self._ready.memory

    @memory.setter
    def memory(self, memory: np.ndarray) -> None:
        """Go on with what another process remembered."""
        if self._ready is None or self._ready.memory.shape != memory.shape:
            raise StationError(f"controller {self.name!r}: this is not its memory")
        self._ready.memory[:] = memory

    def decide(self, observation: Observation) -> Decision:
        """The command for this second."""
        if self._ready is None:
            raise StationError(f"controller {self.name!r} must be started on a station before it decides")
        return self._ask(self._ready, observation)
