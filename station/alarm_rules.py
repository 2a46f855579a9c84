"""Rules of alarms as station files list them: what is watched, when it is said, and what is to be done then."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from enum import StrEnum
from functools import cache
from importlib.resources import files
from typing import Annotated, Any

from pydantic import AfterValidator, Field, model_validator

from station.alarm_signals import SIGNAL_TABLE
from station.quantities import Part, unique

TABLE = files("station") / "data" / "alarms" / "table.toml"
"""The rules of a station whose file has none."""

RULES_MAX = 200
"""Most alarms of a station, each member of a family counted."""

_EACH = "{each}"

NAME_MAX = 60
"""Letters of an alarm's name."""


class Priority(StrEnum):
    """How soon somebody must act; the order is that of the list."""

    HIGH = "high"
    MEDIUM = "medium"
    LOW = "low"
    ADVISORY = "advisory"


def _delay(about: str) -> Any:
    unit: dict[str, Any] = {"unit": "s"}
    return Field(ge=0, le=86_400, allow_inf_nan=False, description=about, json_schema_extra=unit, examples=[10.0])


def _limit(about: str) -> Any:
    return Field(ge=-1e9, le=1e9, allow_inf_nan=False, description=about, examples=[None])


def _text(most: int, about: str, example: str) -> Any:
    return Field(min_length=1, max_length=most, description=about, examples=[example])


_Name = Annotated[str, Field(pattern=r"^([a-z0-9_]|\{each\}){1,60}$")]

_Member = Annotated[str, Field(pattern=r"^[a-z0-9_]{1,60}$")]

PriorityField = Annotated[Priority, Field(strict=False, description="How soon somebody must act", examples=["medium"])]


_Names = Annotated[list[_Name], Field(max_length=RULES_MAX), AfterValidator(unique)]

_Members = Annotated[list[_Member], Field(max_length=RULES_MAX), AfterValidator(unique)]


class AlarmRule(Part):
    """An alarm, or a family of alarms: one for each name of `each`, put where a text says `{each}`."""

    name: Annotated[_Name, Field(description="By which it is acknowledged", examples=["wait_long"])]
    each: _Members = Field([], description="Members of a family; left out: the rule is one alarm", examples=[[]])
    title: Annotated[str, _text(120, "What is wrong, in a line", "A vehicle has waited for half an hour")]
    signal: Annotated[str, Field(description="What is watched", examples=["wait"])]
    above: Annotated[float | None, _limit("It is said while the signal lies above this, in the signal's unit")] = None
    below: Annotated[float | None, _limit("Or while it lies below this")] = None
    deadband: Annotated[
        float,
        Field(
            ge=0,
            le=1e9,
            allow_inf_nan=False,
            description="It ends when the signal is back by so much more",
            examples=[0.0],
        ),
    ] = 0.0
    on_delay_s: Annotated[float, _delay("It is said when that has lasted for so long")] = 0.0
    off_delay_s: Annotated[float, _delay("It ends when that has been over for so long")] = 0.0
    priority: PriorityField
    consequence: Annotated[str, _text(300, "What happens if nobody acts", "Customers drive on.")]
    action: Annotated[str, _text(300, "What is to be done", "Ask what another controller would do.")]
    suppressed_by: _Names = Field(
        [],
        description="Alarms of which this one is a consequence: it is not said while one of them lasts",
        examples=[["gas_short"]],
    )

    @model_validator(mode="after")
    def _consistent(self) -> AlarmRule:
        if (self.above is None) == (self.below is None):
            raise ValueError("either above or below must be given")
        if (_EACH in self.name) != bool(self.each):
            raise ValueError(f"name must hold {_EACH} where each is given, and must not where it is not")
        for rule in self.alarms:
            if len(rule.name) > NAME_MAX:
                raise ValueError(f"name must have at most {NAME_MAX} letters with its member; given {rule.name!r}")
            if rule.signal not in SIGNAL_TABLE:
                raise ValueError(f"signal must be one of docs/alarms.md; given {rule.signal!r}")
        return self

    @property
    def alarms(self) -> list[AlarmRule]:
        """Its members, as rules of one alarm each."""
        if not self.each:
            return [self]
        texts = ("name", "title", "signal", "consequence", "action")
        return [
            self.model_copy(
                update={
                    **{text: getattr(self, text).replace(_EACH, member) for text in texts},
                    "suppressed_by": [name.replace(_EACH, member) for name in self.suppressed_by],
                    "each": [],
                }
            )
            for member in self.each
        ]

    @property
    def unit(self) -> str:
        """The unit of its signal."""
        return SIGNAL_TABLE[self.signal].unit

    @property
    def limit(self) -> float:
        """The limit, above or below."""
        return self.above if self.above is not None else float(self.below or 0.0)


def check_rules(rules: Sequence[AlarmRule]) -> None:
    """Raise ValueError for rules that cannot stand beside one another, naming what is wrong."""
    members = [alarm for rule in rules for alarm in rule.alarms]
    if len(members) > RULES_MAX:
        raise ValueError(f"alarms must be at most {RULES_MAX}; given {len(members)}")
    names: set[str] = set()
    for alarm in members:
        if alarm.name in names:
            raise ValueError(f"alarms must have names of their own; {alarm.name!r} is there twice")
        names.add(alarm.name)
    for alarm in members:
        unknown = [name for name in alarm.suppressed_by if name not in names or name == alarm.name]
        if unknown:
            raise ValueError(f"alarm {alarm.name!r}: suppressed_by must name other alarms; given {unknown[0]!r}")


@cache
def default_rules() -> tuple[AlarmRule, ...]:
    """The rules of a station whose file has none."""
    given = tomllib.loads(TABLE.read_text(encoding="utf-8"))["alarms"]
    rules = tuple(AlarmRule.model_validate(rule) for rule in given)
    check_rules(rules)
    return rules


def alarms_of(rules: Sequence[AlarmRule] | None) -> tuple[AlarmRule, ...]:
    """The alarms of a station's rules, one by one; of None those of the table that ships."""
    return tuple(alarm for rule in (default_rules() if rules is None else rules) for alarm in rule.alarms)
