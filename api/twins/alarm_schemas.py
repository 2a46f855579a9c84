"""Alarms of twins as answers show them, and what may be done with them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field, RootModel, TypeAdapter

from api.http.strict import Body
from api.twins.schemas import Id
from station.alarm_rules import Priority
from station.alarms.figures import AlarmFigures
from station.alarms.states import Alarm, AlarmState
from station.alarms.system import SHELVE_MAX_S, AlarmSystem, Transition

_S: dict[str, Any] = {"unit": "s"}

_Second = Annotated[float, Field(ge=0, json_schema_extra=_S)]

_VALUE_MAX = 1e12
"""A signal beyond this has no value that JSON could show."""

_Value = Annotated[float, Field(ge=-_VALUE_MAX, le=_VALUE_MAX)]

Reason = Annotated[str, Field(min_length=1, max_length=200, description="Why", examples=["sensor is being replaced"])]


class Acknowledge(Body):
    """Say that an alarm has been seen."""

    action: Literal["acknowledge"]
    raised_s: Annotated[
        float | None,
        Field(
            ge=0, description="When the condition began that was seen: refused where it has begun again since",
            json_schema_extra=_S, examples=[None],
        ),
    ] = None  # fmt: skip

    def apply(self, alarms: AlarmSystem, name: str, by: str) -> Sequence[Transition]:
        """The changes of state that it makes."""
        return alarms.acknowledge(name, by, self.raised_s)


class Shelve(Body):
    """Put an alarm aside for a time."""

    action: Literal["shelve"]
    for_s: Annotated[
        float, Field(gt=0, le=SHELVE_MAX_S, description="For how long", json_schema_extra=_S, examples=[3600.0])
    ]
    reason: Reason

    def apply(self, alarms: AlarmSystem, name: str, by: str) -> Sequence[Transition]:
        """The changes of state that it makes."""
        return alarms.shelve(name, self.for_s, by, self.reason)


class Unshelve(Body):
    """Take an alarm back before its time."""

    action: Literal["unshelve"]

    def apply(self, alarms: AlarmSystem, name: str, by: str) -> Sequence[Transition]:
        """The changes of state that it makes."""
        return alarms.unshelve(name, by)


class TakeOut(Body):
    """Take an alarm out of service until somebody puts it back."""

    action: Literal["out_of_service"]
    reason: Reason

    def apply(self, alarms: AlarmSystem, name: str, by: str) -> Sequence[Transition]:
        """The changes of state that it makes."""
        return alarms.take_out(name, by, self.reason)


class PutBack(Body):
    """Put an alarm back into service."""

    action: Literal["in_service"]

    def apply(self, alarms: AlarmSystem, name: str, by: str) -> Sequence[Transition]:
        """The changes of state that it makes."""
        return alarms.put_back(name, by)


AlarmAction = Acknowledge | Shelve | Unshelve | TakeOut | PutBack

AlarmActionField = Annotated[AlarmAction, Field(discriminator="action")]


class AlarmOrder(RootModel[AlarmActionField]):
    """What to do with an alarm."""


ALARM_ACTION: TypeAdapter[AlarmAction] = TypeAdapter(AlarmActionField)
"""What may be done with an alarm."""


def _time(about: str) -> Any:
    """A time that may not be there yet."""
    return Field(description=about, json_schema_extra=_S, examples=[None])


class TwinAlarm(BaseModel):
    """An alarm of a twin."""

    name: Annotated[str, Field(description="By which it is acknowledged", examples=["wait_long"])]
    title: Annotated[str, Field(description="What is wrong, in a line", examples=["A vehicle has waited long"])]
    priority: Annotated[Priority, Field(description="How soon somebody must act", examples=["low"])]
    state: Annotated[AlarmState, Field(description="By ISA-18.2", examples=["unacknowledged"])]
    active: Annotated[bool, Field(description="Whether its condition holds, delays counted", examples=[True])]
    signal: Annotated[str, Field(description="What is watched", examples=["wait"])]
    side: Annotated[
        Literal["above", "below"], Field(description="Of the limit on which it is said", examples=["above"])
    ]
    limit: Annotated[float, Field(ge=-1e9, le=1e9, description="In `unit`", examples=[1800.0])]
    value: Annotated[
        _Value | None, Field(description="Of the signal when its condition began or ended last", examples=[1801.0])
    ]
    unit: Annotated[str, Field(description="Of limit and value", examples=["s"])]
    raised_s: Annotated[_Second | None, _time("When its condition began last")]
    ended_s: Annotated[_Second | None, _time("When it ended last; null while it holds")]
    shelved_until_s: Annotated[_Second | None, _time("Until when it is put aside")]
    by: Annotated[
        str | None, Field(description="Who did the last thing with it: the name of a key", examples=["operator"])
    ]
    reason: Annotated[str | None, Field(description="Why", examples=[None])]
    consequence: Annotated[str, Field(description="What happens if nobody acts", examples=["Customers drive on."])]
    action: Annotated[str, Field(description="What is to be done", examples=["Ask what another controller would do."])]
    suppressed_by: Annotated[
        list[str], Field(description="Alarms of which it is a consequence", examples=[["gas_short"]])
    ]

    @classmethod
    def of(cls, alarm: Alarm) -> TwinAlarm:
        """An alarm as answers show it."""
        rule = alarm.rule
        return cls(
            **{name: getattr(rule, name) for name in _OF_RULE},
            state=alarm.state,
            active=alarm.active,
            side="above" if rule.above is not None else "below",
            value=alarm.value if alarm.raised is not None and abs(alarm.value) <= _VALUE_MAX else None,
            raised_s=alarm.raised,
            ended_s=alarm.ended,
            shelved_until_s=alarm.shelved_until,
            by=alarm.by or None,
            reason=alarm.reason or None,
        )


_OF_RULE = ("name", "title", "priority", "signal", "limit", "unit", "consequence", "action", "suppressed_by")


class FrequentAlarm(BaseModel):
    """An alarm that comes often."""

    name: Annotated[str, Field(description="Its name", examples=["wait_long"])]
    begun: Annotated[int, Field(ge=0, description="How often it began", examples=[3])]


class AlarmSystemFigures(BaseModel):
    """How often the alarm system speaks: of the last day of the twin, or since it began."""

    duration_s: Annotated[
        float, Field(ge=0, description="So long they are of", json_schema_extra=_S, examples=[86400.0])
    ]
    begun: Annotated[int, Field(ge=0, description="Alarms announced", examples=[12])]
    per_hour: Annotated[float, Field(ge=0, json_schema_extra={"unit": "1/h"}, description="Of them", examples=[0.5])]
    most_in_ten_minutes: Annotated[int, Field(ge=0, description="The most within ten minutes", examples=[3])]
    flooded: Annotated[bool, Field(description="Whether these were more than ten", examples=[False])]
    announced: Annotated[int, Field(ge=0, description="Alarms shown now", examples=[1])]
    unacknowledged: Annotated[int, Field(ge=0, description="Of which nobody has acknowledged", examples=[1])]
    acknowledged_in_s: Annotated[_Second | None, _time("Median time from a begin to its acknowledgement")]
    standing: Annotated[list[str], Field(description="Alarms that have held for a day", examples=[[]])]
    chattering: Annotated[list[str], Field(description="That began three times within a minute", examples=[[]])]
    frequent: Annotated[list[FrequentAlarm], Field(description="That came most", examples=[[]])]

    @classmethod
    def of(cls, figures: AlarmFigures) -> AlarmSystemFigures:
        """Figures as answers show them."""
        return cls(
            duration_s=figures.duration,
            acknowledged_in_s=figures.acknowledged_in,
            frequent=[FrequentAlarm(name=name, begun=count) for name, count in figures.frequent],
            standing=list(figures.standing),
            chattering=list(figures.chattering),
            **{name: getattr(figures, name) for name in _OF_FIGURES},
        )


_OF_FIGURES = ("begun", "per_hour", "most_in_ten_minutes", "flooded", "announced", "unacknowledged")


class TwinAlarms(BaseModel):
    """The alarms of a twin, the most urgent first, and how often they come."""

    twin: Id
    items: Annotated[list[TwinAlarm], Field(description="Alarms", examples=[[]])]
    figures: Annotated[
        AlarmSystemFigures | None,
        Field(description="How often they come; null of a replay, and of a twin that has ended", examples=[None]),
    ]
