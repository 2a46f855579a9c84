"""Twins as requests order and change them, and answers show them."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, TypeAdapter, WithJsonSchema

from api.http.pagination import Next
from api.http.problems import in_json
from api.http.strict import Body
from api.jobs.schemas import ControllerSpec
from api.scenarios.schemas import ScenarioInput, Seed, ShippedScenario
from station import Scenario
from station.live import AtEnd
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


ALIVE = (TwinStateName.RUNNING, TwinStateName.PAUSED)


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


class TwinRequest(_TwinFields):
    """A live twin to start, with its whole scenario; stored with the twin."""

    scenario: ShippedScenario


class TwinOrder(_TwinFields):
    """A live twin to start."""

    scenario: ScenarioInput

    def at(self, scenario: Scenario) -> TwinRequest:
        """The twin with the scenario that was meant."""
        return TwinRequest.model_construct(**{**dict(self), "scenario": scenario})


CHANGEABLE = {"controller", "speed", "paused", "certificate"}
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


class TwinState(BaseModel):
    """A twin and where it stands."""

    id: Id
    state: Annotated[TwinStateName, Field(description="What it does", examples=["running"])]
    scenario: Annotated[str, Field(description="Name of its scenario", examples=["S1"])]
    station: Annotated[str, Field(description="Name of its station", examples=["thesis-fit"])]
    controller: ControllerSpec
    service: Annotated[
        Literal["certified", "uncertified"],
        Field(description="Whether a verified certificate of service belongs to it", examples=["uncertified"]),
    ]
    speed: Speed
    at_end: Annotated[AtEnd, Field(description="What it does when its vehicles are served", examples=["repeat"])]
    replication: Annotated[int, Field(ge=0, description="First replication", examples=[0])]
    seed: Seed
    epoch: Annotated[int, Field(ge=0, description="Counts its starts: a restart of the service adds one", examples=[1])]
    samples: Annotated[
        int, Field(ge=0, description="Seconds simulated", json_schema_extra={"unit": "samples"}, examples=[3600])
    ]
    events: Annotated[int, Field(ge=0, description="Events told", json_schema_extra={"unit": "events"}, examples=[42])]
    created: Annotated[str, Field(description="Started (UTC, ISO 8601)", examples=["2026-11-21T09:00:00.250000Z"])]
    values: Annotated[
        dict[str, float | None] | None,
        Field(
            description="Its newest sample by column; null before the first. Units as in /history",
            examples=[{"time": 3599.0, "pressure_high": 812.3, "outlet_high": 1, "vehicle": 3, "queue_length": 1}],
        ),
    ]
    ticks_late: Annotated[
        int,
        Field(
            ge=0,
            description="Ticks over 0.1 s late in this epoch",
            json_schema_extra={"unit": "ticks"},
            examples=[0],
        ),
    ]
    lateness_max_s: Annotated[
        float,
        Field(ge=0, description="Latest tick of this epoch", json_schema_extra={"unit": "s"}, examples=[0.003]),
    ]


class TwinPage(BaseModel):
    """Twins, the oldest first."""

    items: Annotated[list[TwinState], Field(description="Twins", examples=[[]])]
    next: Next
    complete: Annotated[
        bool,
        Field(description="False while the database does not answer: these are the twins in memory", examples=[True]),
    ] = True


class TwinEvent(BaseModel):
    """Something that happened to a twin."""

    version: Annotated[int, Field(ge=1, description="Of this document", examples=[1])]
    twin: Id
    epoch: Annotated[int, Field(ge=1, description="Start of the twin it belongs to", examples=[1])]
    seq: Annotated[int, Field(ge=0, description="Number among the twin's events", examples=[7])]
    sent: Annotated[
        float, Field(ge=0, description="Unix time", json_schema_extra={"unit": "s"}, examples=[1795252800.25])
    ]
    time: Annotated[float, Field(ge=0, description="Simulated", json_schema_extra={"unit": "s"}, examples=[250.0])]
    kind: Annotated[str, Field(description="What happened", examples=["fill_start"])]
    details: Annotated[
        dict[str, Any], Field(description="Figures of it", examples=[{"vehicle": 1, "pressure_bar": 137.3}])
    ]


class EventPage(BaseModel):
    """Events in order."""

    items: Annotated[list[TwinEvent], Field(description="Events", examples=[[]])]
    after: Annotated[int, Field(ge=-1, description="Number of the last; as `after` it goes on behind", examples=[7])]
    next: Next


class PauseCommand(Body):
    """Stand still."""

    command: Literal["pause"]


class ContinueCommand(Body):
    """Run again."""

    command: Literal["continue"]


class StopCommand(Body):
    """End for good."""

    command: Literal["stop"]


class SpeedCommand(Body):
    """Run at another speed."""

    command: Literal["speed"]
    speed: Speed


class ControllerCommand(Body):
    """Let another controller decide."""

    command: Literal["controller"]
    controller: ControllerSpec


class VehicleCommand(VehicleRequest):
    """Let a vehicle arrive."""

    command: Literal["vehicle"]

    def figures(self) -> dict[str, float]:
        """As the run takes them."""
        return {name: value for name, value in super().figures().items() if name != "command"}


Command = PauseCommand | ContinueCommand | StopCommand | SpeedCommand | ControllerCommand | VehicleCommand

COMMAND: TypeAdapter[Command] = TypeAdapter(Annotated[Command, Field(discriminator="command")])
"""The commands that may be sent to a twin's key `command`."""
