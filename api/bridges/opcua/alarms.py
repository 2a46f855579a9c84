"""Alarms of a twin as events of OPC UA's AlarmConditionType (OPC 10000-9), from the twin and from the server."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from asyncua import Node, Server, ua
from asyncua.server.event_generator import EventGenerator

from station.alarm_rules import Priority
from station.alarms.states import AlarmState

SEVERITIES = {Priority.HIGH: 900, Priority.MEDIUM: 600, Priority.LOW: 300, Priority.ADVISORY: 100}
"""Severity, from 1 to 1000, of an alarm of each priority."""

_ACTIVE = (AlarmState.UNACKNOWLEDGED, AlarmState.ACKNOWLEDGED, AlarmState.SUPPRESSED)
"""States in which the condition of an alarm holds."""

_UNACKNOWLEDGED = (AlarmState.UNACKNOWLEDGED, AlarmState.RETURNED)

_ASIDE = (AlarmState.SHELVED, AlarmState.OUT_OF_SERVICE)
"""States that say nothing of the condition."""

_WORDS = {
    "EnabledState": ("Enabled", "Disabled"),
    "ActiveState": ("Active", "Inactive"),
    "AckedState": ("Acknowledged", "Unacknowledged"),
    "SuppressedState": ("Suppressed", "Unsuppressed"),
    "OutOfServiceState": ("Out of Service", "In Service"),
}
"""States of two values, with the words that OPC 10000-9 has for them."""


class AlarmEvents:
    """Tells the changes of a twin's alarms as events.

    Parameters
    ----------
    server
        That tells them.
    twin
        The twin's node.
    """

    def __init__(self, server: Server, twin: Node) -> None:
        self._server, self._twin = server, twin
        self._generators: dict[str, list[EventGenerator]] = {}
        self._active: set[str] = set()

    async def tell(self, alarm: dict[str, Any], moment: datetime) -> None:
        """Tell where an alarm stands, as an event of a twin or `GET /v1/twins/{id}/alarms` has it."""
        name = alarm.get("alarm") or alarm["name"]
        state = AlarmState(alarm["state"])
        if state not in _ASIDE:
            (self._active.add if state in _ACTIVE else self._active.discard)(name)
        for generator in await self._generators_of(name):
            self._fill(generator.event, alarm, state, is_active=name in self._active)
            await generator.trigger(moment, _message(alarm, state))

    async def _generators_of(self, name: str) -> list[EventGenerator]:
        """Those of an alarm: a subscription to the twin hears one, and one to the server the other."""
        if name not in self._generators:
            condition = ua.NodeId(f"{self._twin.nodeid.Identifier}.alarms.{name}", self._twin.nodeid.NamespaceIndex)
            made = []
            for emitter in (self._twin.nodeid, ua.NodeId(ua.ObjectIds.Server)):
                generator = EventGenerator(self._server.iserver.isession)
                is_first = not self._generators
                await generator.init(ua.ObjectIds.AlarmConditionType, emitter, add_generates_event=is_first)
                event = generator.event
                event.SourceNode, event.SourceName = self._twin.nodeid, self._twin.nodeid.Identifier
                event.NodeId, event.ConditionName, event.BranchId = condition, name, ua.NodeId()
                event.ConditionClassId = ua.NodeId(ua.ObjectIds.ProcessConditionClassType)
                event.ConditionClassName = ua.LocalizedText("Process")
                event.Quality = ua.StatusCode()
                made.append(generator)
            self._generators[name] = made
        return self._generators[name]

    def _fill(self, event: Any, alarm: dict[str, Any], state: AlarmState, *, is_active: bool) -> None:
        event.Severity = SEVERITIES[Priority(alarm["priority"])]
        event.Retain = state is not AlarmState.NORMAL
        event.SuppressedOrShelved = state in {AlarmState.SUPPRESSED, *_ASIDE}
        event.Comment = ua.LocalizedText(alarm.get("reason") or "")
        event.ClientUserId = alarm.get("by") or ""
        holds = {
            "EnabledState": True,
            "ActiveState": is_active,
            "AckedState": state not in _UNACKNOWLEDGED,
            "SuppressedState": state is AlarmState.SUPPRESSED,
            "OutOfServiceState": state is AlarmState.OUT_OF_SERVICE,
        }
        for name, held in holds.items():
            setattr(event, name, ua.LocalizedText(_WORDS[name][0 if held else 1]))
            setattr(event, f"{name}/Id", held)


def _message(alarm: dict[str, Any], state: AlarmState) -> str:
    """What is wrong, and how far it has come."""
    return f"{alarm['title']} ({str(state).replace('_', ' ')})"
