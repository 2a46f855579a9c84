"""Commands as documents: what may be sent to a twin's key `command`."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, TypeAdapter

from api.http.strict import Body
from api.jobs.schemas import ControllerSpec
from api.twins.alarm_schemas import AlarmActionField
from api.twins.schemas import Speed, VehicleRequest
from station.alarm_rules import NAME_MAX


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


class AlarmCommand(Body):
    """Do something with an alarm."""

    command: Literal["alarm"]
    alarm: Annotated[str, Field(max_length=NAME_MAX, description="Its name", examples=["wait_long"])]
    do: AlarmActionField


Command = (
    PauseCommand | ContinueCommand | StopCommand | SpeedCommand | ControllerCommand | VehicleCommand | AlarmCommand
)

COMMAND: TypeAdapter[Command] = TypeAdapter(Annotated[Command, Field(discriminator="command")])
"""The commands that may be sent to a twin's key `command`."""
