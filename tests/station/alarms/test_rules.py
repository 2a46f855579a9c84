"""Rules of alarms: the table that ships, families, and what is refused by name."""

from __future__ import annotations

from pathlib import Path

import pytest
from pydantic import ValidationError

from station import Station, load_station
from station.alarm_rules import AlarmRule, Priority, alarms_of, check_rules, default_rules
from station.alarm_signals import DETECTED, SIGNAL_TABLE, SIGNALS
from station.geometry import BUFFERS, TANKS
from station.sensor_names import DETECTABLE

RULE = {
    "name": "wait_long", "title": "A vehicle waits", "signal": "wait", "above": 60.0, "priority": "low",
    "consequence": "It drives on.", "action": "Look.",
}  # fmt: skip


def test_the_table_names_every_event_of_the_estimator_and_no_signal_twice():
    alarms = alarms_of(None)
    assert len({alarm.name for alarm in alarms}) == len(alarms) > 60
    watched = [alarm.signal for alarm in alarms]
    assert {DETECTED + name for name in DETECTABLE} <= set(watched)
    drift = [alarm for alarm in alarms if alarm.name.startswith("offset_")]
    assert {alarm.priority for alarm in drift} == {Priority.ADVISORY}
    assert sum(rule.priority is Priority.HIGH for rule in default_rules()) < len(default_rules()) / 2
    assert set(SIGNAL_TABLE) == set(SIGNALS)
    assert all(signal.unit and signal.about for signal in SIGNAL_TABLE.values())


def test_a_family_is_an_alarm_for_each_member():
    family = {
        **RULE, "name": "hot_{each}", "each": ["high", "low"], "signal": "temperature_{each}",
        "suppressed_by": ["frozen_{each}"],
    }  # fmt: skip
    high, low = AlarmRule.model_validate(family).alarms
    assert (high.name, high.signal, high.suppressed_by, high.unit) == (
        "hot_high", "temperature_high", ["frozen_high"], "degC",
    )  # fmt: skip
    assert (low.name, low.each) == ("hot_low", [])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"signal": "weight"}, "signal must be one of docs/alarms.md; given 'weight'"),
        ({"above": None}, "either above or below must be given"),
        ({"below": 3.0}, "either above or below must be given"),
        ({"each": ["a"]}, "name must hold {each}"),
        ({"name": "a_{each}"}, "name must hold {each}"),
        ({"priority": "urgent"}, "priority"),
        ({"above": float("nan")}, "above"),
        ({"on_delay_s": -1.0}, "on_delay_s"),
        ({"deadband": -1.0}, "deadband"),
        ({"name": "Wait long"}, "name"),
        ({"each": ["a", "a"], "name": "a_{each}"}, "each"),
        ({"each": ["a{each}"], "name": "a_{each}"}, "each"),
        ({"name": "a{b"}, "name"),
        ({"each": ["a" * 59], "name": "ab_{each}"}, "at most 60 letters"),
    ],
)
def test_what_is_wrong_is_named(change, said):
    with pytest.raises(ValidationError, match=said.replace("{", r"\{")):
        AlarmRule.model_validate({**RULE, **change})


@pytest.mark.parametrize(
    ("rules", "said"),
    [
        ([RULE, RULE], "'wait_long' is there twice"),
        ([{**RULE, "suppressed_by": ["wait_long"]}], "must name other alarms"),
        ([{**RULE, "suppressed_by": ["nothing"]}], "given 'nothing'"),
        ([{**RULE, "name": f"a{k}_{{each}}", "each": [f"m{i}" for i in range(100)]} for k in range(3)], "at most 200"),
    ],
)
def test_rules_stand_beside_one_another(rules, said):
    given = [AlarmRule.model_validate(rule) for rule in rules]
    with pytest.raises(ValueError, match=said):
        check_rules(given)
    document = load_station("thesis-fit").model_dump(mode="json")
    with pytest.raises(ValidationError, match=said):
        Station.model_validate({**document, "alarms": rules})


def test_a_station_without_a_table_says_nothing_of_it():
    document = load_station("thesis-fit").model_dump(mode="json")
    assert "alarms" not in document
    station = Station.model_validate({**document, "alarms": [RULE]})
    assert [alarm.name for alarm in alarms_of(station.alarms)] == ["wait_long"]
    assert Station.model_validate(station.model_dump(mode="json")) == station


def test_the_documentation_has_every_signal():
    text = (Path(__file__).parents[3] / "docs" / "alarms.md").read_text(encoding="utf-8")
    families = {
        "pressure_{tank}": TANKS, "temperature_{tank}": TANKS, "margin_temperature_{tank}": TANKS,
        "margin_pressure_{buffer}": BUFFERS, "time_to_temperature_{tank}": TANKS, "time_to_pressure_{buffer}": BUFFERS,
        "detected_{event}": DETECTABLE,
    }  # fmt: skip
    named = {name for name in SIGNALS if f"`{name}`" in text}
    for family, members in families.items():
        assert f"`{family}`" in text
        named |= {family.partition("{")[0] + member for member in members}
    assert named == set(SIGNALS)
