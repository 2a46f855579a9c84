"""Twins as requests order and change them; `state_schemas` has them as answers show them."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from typing import Annotated, Any, Literal, Self

from pydantic import (
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationInfo,
    WithJsonSchema,
    field_validator,
    model_validator,
)

from api.http.pagination import FAR
from api.http.problems import in_json
from api.http.strict import Body
from api.jobs.schemas import ControllerSpec
from api.scenarios.schemas import ScenarioInput, Seed, ShippedScenario
from api.twins.messages import measured_layout
from api.twins.shadow_schemas import ShadowRequest
from station import Scenario, Station
from station.batches import tag_places
from station.faults.kinds import Fault, Faults
from station.live import AtEnd
from station.measurement import TagMap
from station.quantities import Pressure, Temperature, Volume
from station.whole import WHOLE

MAX = "max"
"""As fast as possible."""

SPEED_MAX = 1_000.0
"""Faster than this a twin waits for its own steps."""

_Fastest = Annotated[Literal["max"], WithJsonSchema({"type": "string", "enum": ["max"], "title": "Fastest"})]
# `const`, which pydantic would write, makes generators of clients refuse numbers.


def _speed(given: Any) -> Any:
    """One message, instead of one for a number and one for `max`."""
    number = isinstance(given, int | float) and not isinstance(given, bool)
    if given != MAX and not (number and 1 <= given <= SPEED_MAX):
        raise ValueError(f"must be 1 to {SPEED_MAX:g} [s/s], or {in_json(MAX)}; given {in_json(given):.50}")
    return given


Speed = Annotated[
    Annotated[float, Field(ge=1, le=SPEED_MAX, json_schema_extra={"unit": "s/s"})] | _Fastest,
    BeforeValidator(_speed),
    Field(description="Simulated seconds a second, or max: as fast as possible", examples=[1, 60, "max"]),
]

Id = Annotated[
    str,
    Field(pattern=r"^[a-z0-9](?:[a-z0-9-]{0,30}[a-z0-9])?$", description="Name in keys and paths", examples=["demo"]),
]


class TwinStateName(StrEnum):
    """The state of a twin."""

    RUNNING = "running"
    PAUSED = "paused"
    FINISHED = "finished"  # its scenario is over
    STOPPED = "stopped"  # somebody stopped it
    FAILED = "failed"  # the service's log says why


class Source(StrEnum):
    """Where a twin's seconds come from."""

    SIMULATED = "simulated"
    MEASURED = "measured"  # sent to /v1/twins/{id}/measurements
    REPLAY = "replay"  # those that another twin told


ALIVE = (TwinStateName.RUNNING, TwinStateName.PAUSED)


_SIMULATION = ("controller", "speed", "at_end", "replication", "seed", "paused", "certificate", "allow_uncertified")
"""Fields that say how a twin is simulated."""

_PACE = ("speed", "paused")
"""Those of them that a replay has, too."""

_STRETCH = ("from_s", "to_s")
"""Fields that say what a replay plays of another twin."""

_OF_THE_OTHER = ("at_end", "replication", "seed", "certificate", "allow_uncertified")
"""Fields of a simulation that a twin which begins with the state of another has from that one, or not at all."""

Second = Annotated[int, Field(ge=0, le=FAR, json_schema_extra={"unit": "s"}), WHOLE]


def with_faults(scenario: Scenario, more: Sequence[Fault]) -> Scenario:
    """A scenario with more faults.

    Raises
    ------
    ValidationError
        if these are faults that its plant cannot have, or its scenario none.
    """
    if not more:
        return scenario
    return of_faults(scenario, [*scenario.faults, *more])


def of_faults(scenario: Scenario, faults: Sequence[Fault]) -> Scenario:
    """A scenario with these faults in place of its own.

    Raises
    ------
    ValidationError
        if these are faults that its plant cannot have, or its scenario none.
    """
    known = scenario.model_dump(mode="json")
    return Scenario.model_validate({**known, "faults": [fault.model_dump(mode="json") for fault in faults]})


class _TwinFields(Body):
    """The fields of an order of a live twin, but for its scenario."""

    model_config = ConfigDict(frozen=True)

    id: Annotated[Id | None, Field(description="Name in keys and paths; made if left out", examples=["demo"])] = None
    controller: Annotated[
        str,
        Field(
            min_length=1,
            max_length=200,
            description="Name, options behind colons; `remote` asks whoever answers the twin's key `decide`",
            examples=["minlp1:horizon=2"],
        ),
    ] = "logic"
    speed: Speed = 1.0
    at_end: Annotated[
        AtEnd,
        Field(
            description="When the vehicles are served: stop; idle, where some may be added; repeat with the next "
            "replication's",
            examples=["repeat"],
            strict=False,
        ),
    ] = AtEnd.IDLE
    replication: Annotated[
        int, Field(ge=0, le=1_000_000, description="First replication; 0 is the pattern", examples=[0]), WHOLE
    ] = 0
    seed: Seed = 0
    paused: Annotated[bool, Field(description="Whether it stands still", examples=[False])] = False
    certificate: Annotated[
        dict[str, Any] | None,
        Field(
            description="A certificate of service, as `hrs certify --controller` writes it. One that does not belong "
            "to the controller and the station, certifies nothing or fails verification is refused",
            examples=[None],
        ),
    ] = None
    allow_uncertified: Annotated[
        bool, Field(description="Start in spite of a certificate that is refused, as uncertified", examples=[False])
    ] = False
    source: Annotated[
        Source,
        Field(
            description="Where its seconds come from: simulated; measured at a station like the scenario's, and "
            "followed; or a replay of those that another twin told",
            examples=["simulated"],
            strict=False,
        ),
    ] = Source.SIMULATED
    tags: Annotated[
        TagMap | None, Field(description="What the tags of measurements are; a measured twin needs it", examples=[None])
    ] = None

    of: Annotated[
        Id | None,
        Field(
            description="Twin that a replay plays; of a simulated one, the twin with whose state it begins",
            examples=[None],
        ),
    ] = None
    at_s: Annotated[
        Second | None,
        Field(
            description="Second at which a simulated twin begins with the state of the twin `of`; left out: now",
            examples=[None],
        ),
    ] = None
    from_s: Annotated[
        Second | None,
        Field(description="First second that a replay plays; left out: the first that is kept whole", examples=[None]),
    ] = None
    to_s: Annotated[
        Second | None,
        Field(description="Last second that a replay plays; left out: the newest when it starts", examples=[None]),
    ] = None

    @model_validator(mode="after")
    def _of_its_source(self) -> Self:
        defaults = type(self).model_fields
        unwanted = {
            Source.SIMULATED: ("tags", *_STRETCH, *(("at_s",) if self.of is None else ())),
            Source.MEASURED: (*_SIMULATION, "of", "at_s", *_STRETCH),
            Source.REPLAY: ("tags", "at_s", *(name for name in _SIMULATION if name not in _PACE)),
        }[self.source]
        if given := [name for name in unwanted if getattr(self, name) != defaults[name].default]:
            why = (
                "of is left out"
                if given == ["at_s"] and self.source is Source.SIMULATED
                else f"source is {self.source}"
            )
            raise ValueError(f"{', '.join(given)} must be left out where {why}")
        if self.source is Source.MEASURED:
            if self.tags is None:
                raise ValueError("tags must be given where source is measured")
            tag_places(self.tags)
        if self.source is Source.REPLAY and self.of is None:
            raise ValueError("of must be given where source is replay")
        return self


class ComingVehicle(Body):
    """A vehicle that was added by hand to the twin with whose state another began: it comes to that one, too."""

    at_s: float
    figures: dict[str, float]


class TwinRequest(_TwinFields):
    """A live twin to start, with its whole scenario; stored with the twin."""

    scenario: ShippedScenario
    station: Annotated[
        Station | None, Field(description="Station that a measured twin was moved to; null: its scenario's")
    ] = None
    calibration: Annotated[str | None, Field(description="Calibration that found it")] = None
    station_seq: Annotated[
        int, Field(ge=0, description="First second of what is estimated now: with it, by clocks put right")
    ] = 0
    clocks_seq: Annotated[int, Field(ge=0, description="First second whose readings are by clocks put right")] = 0
    drills: Faults = Field([], description="Faults put into its station since it started", examples=[[]])
    shadow: Annotated[ShadowRequest | None, Field(description="Who is held against the controller that acts")] = None
    coming: list[ComingVehicle] = Field([], description="Vehicles added later to the twin it began as")
    plays: Annotated[str | None, Field(description="Layout of the samples that a replay plays")] = None

    @property
    def followed_station(self) -> Station:
        """The station that a measured twin follows with."""
        return self.scenario.station if self.station is None else self.station

    @property
    def drilled(self) -> Scenario:
        """Its scenario, with the faults of its drills.

        Raises
        ------
        ValidationError
            if these are faults that its plant cannot have, or its scenario none.
        """
        return with_faults(self.scenario, self.drills)

    @property
    def layout(self) -> str:
        """The layout of its samples."""
        if self.plays is not None:
            return self.plays
        plant = self.scenario.station.plant
        return measured_layout(plant) if self.source is Source.MEASURED else plant


class TwinOrder(_TwinFields):
    """A live twin to start; one that plays another, or begins with its state, has the scenario of that one."""

    scenario: Annotated[
        ScenarioInput | None,
        Field(
            validate_default=True,
            description="Name of a scenario that ships with the service or is stored in it, or a whole one; left out "
            "where `of` is given",
            examples=["S1"],
        ),
    ] = None

    @field_validator("scenario")
    @classmethod
    def _of_a_source(cls, scenario: Scenario | str | None, info: ValidationInfo) -> Scenario | str | None:
        is_replay = info.data.get("source") is Source.REPLAY
        is_branch = info.data.get("source") is Source.SIMULATED and info.data.get("of") is not None
        if (is_replay or is_branch) and scenario is not None:
            raise ValueError(f"must be left out where {'source is replay' if is_replay else 'of is given'}")
        if not is_replay and not is_branch and scenario is None:
            raise ValueError("must be given: the name of a scenario, or a whole one")
        return scenario

    @model_validator(mode="after")
    def _as_the_other(self) -> Self:
        if self.source is Source.SIMULATED and self.of is not None:
            defaults = type(self).model_fields
            if given := [name for name in _OF_THE_OTHER if getattr(self, name) != defaults[name].default]:
                raise ValueError(f"{', '.join(given)} must be left out where of is given: that twin's hold")
        return self

    def at(self, scenario: Scenario) -> TwinRequest:
        """The twin with the scenario that was meant."""
        return TwinRequest.model_construct(**{**dict(self), "scenario": scenario})


CHANGEABLE = {
    "controller", "speed", "paused", "certificate", "station", "calibration", "station_seq", "clocks_seq", "drills",
    "shadow",
}  # fmt: skip
"""Fields that may differ from the request a twin was started with."""


class TwinChange(Body):
    """A change of a running twin."""

    speed: Annotated[
        Speed | None,
        Field(description="Simulated seconds a second, or max", json_schema_extra={"unit": "s/s"}, examples=[60]),
    ] = None
    controller: Annotated[
        ControllerSpec | None, Field(description="Who decides from the next second on", examples=["minlp1:horizon=2"])
    ] = None
    paused: Annotated[bool | None, Field(description="Stand still, or go on", examples=[True])] = None


class VehicleRequest(Body):
    """A vehicle that arrives now; what is left out is the station's usual vehicle's."""

    start_pressure_bar: Annotated[Pressure, Field(examples=[120.0])]
    start_temperature_c: Annotated[Temperature | None, Field(description="In its tank", examples=[25.0])] = None
    volume_m3: Annotated[Volume | None, Field(description="Of its tank", examples=[0.14])] = None
    finish_pressure_bar: Annotated[Pressure | None, Field(description="It leaves with this", examples=[690.0])] = None

    def figures(self) -> dict[str, float]:
        """As the run takes them."""
        given = self.model_dump(exclude_none=True)
        return {name.rsplit("_", 1)[0]: value for name, value in given.items()}
