"""Gauges of live twins for Prometheus: their alarms, and how old their data are; at most so many series a twin."""

from __future__ import annotations

from collections.abc import Iterator

from api.metrics import Gauge
from api.twins.live import LiveTwin
from api.twins.queries import TwinQueries
from station.alarm_rules import Priority
from station.alarms.states import AlarmState

ALARMS_SHOWN = 20
"""Alarms of a twin that are named, the most urgent first; more than ten within ten minutes are a flood already."""

_STATES = [state for state in AlarmState if state is not AlarmState.NORMAL]


INFO = ("twin", "source", "state", "scenario", "station", "controller")
"""Labels of what a twin is."""


def _labels(twin: LiveTwin) -> tuple[str, ...]:
    request = twin.request
    names = request.scenario.name, request.followed_station.name
    return twin.id, str(request.source), str(twin.state), *names, request.controller


def twin_gauges(twins: TwinQueries) -> Iterator[Gauge]:
    """Gauges of the twins that live here."""
    about: dict[tuple[str, ...], float] = {}
    counts: dict[tuple[str, str, str], float] = {}
    announced: dict[tuple[str, str, str, str], float] = {}
    ages: dict[tuple[str, str], float] = {}
    for twin in [found for twin_id in twins.ids() if (found := twins.live(twin_id)) is not None]:
        about[_labels(twin)] = 1
        if (age := twin.data_age) is not None:
            ages[twin.id, str(twin.request.source)] = age
        if twin.alarms is None:
            continue
        counts |= {(twin.id, str(priority), str(state)): 0 for priority in Priority for state in _STATES}
        for alarm in twin.alarms.alarms.values():
            if (state := alarm.state) is not AlarmState.NORMAL:
                counts[twin.id, str(alarm.rule.priority), str(state)] += 1
        for alarm in twin.alarms.announced[:ALARMS_SHOWN]:
            announced[twin.id, alarm.rule.name, str(alarm.rule.priority), str(alarm.state)] = 1
    yield Gauge("hrs_twin_info", "Live twins and what they are", about, INFO)
    yield Gauge(
        "hrs_twin_data_age_seconds", "Since a twin's newest second, or measurements came last", ages, ("twin", "source")
    )
    yield Gauge("hrs_twin_alarms", "Alarms that are not normal", counts, ("twin", "priority", "state"))
    yield Gauge(
        "hrs_twin_alarm_announced", f"Announced alarms of a twin, the {ALARMS_SHOWN} most urgent", announced,
        ("twin", "alarm", "priority", "state"),
    )  # fmt: skip
