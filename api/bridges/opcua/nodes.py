"""The nodes of a twin: an object with a variable for each column, and one for its state."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

from asyncua import Node, Server, ua

from api.bridges.opcua.clock import TwinClock
from api.bridges.opcua.variables import Variable, properties_of

NAMESPACE = "urn:hrs-twin:twins"
"""Of every node of a twin; its index at our servers is 2."""

STATE = "state"
"""The variable that says what a twin does."""

WAITING = ua.StatusCode(ua.StatusCodes.BadWaitingForInitialData)
"""The status of a variable before the first sample."""

SILENT = ua.StatusCode(ua.StatusCodes.UncertainNoCommunicationLastUsableValue)
"""The status of variables while the service is away."""

ENDED = ua.StatusCode(ua.StatusCodes.UncertainLastUsableValue)
"""The status of variables of a twin that tells nothing more."""


class TwinNodes:
    """The nodes of one twin, and what they hold."""

    def __init__(self, server: Server, namespace: int, twin: str, units: Mapping[str, str]) -> None:
        self._server, self._namespace, self._twin = server, namespace, twin
        self.id = ua.NodeId(twin, namespace)
        self.variables = {self._id(name): Variable(name, unit) for name, unit in units.items()}
        self._held: dict[ua.NodeId, ua.DataValue] = {}  # of the newest sample

    def _id(self, name: str) -> ua.NodeId:
        return ua.NodeId(f"{self._twin}.{name}", self._namespace)

    async def make(self) -> Node:
        """Make them below Objects; the twin's own."""
        objects = self._server.get_objects_node()
        made = await objects.add_object(self.id, ua.QualifiedName(self._twin, self._namespace))
        for node_id, variable in self.variables.items():
            await self._make_variable(node_id, variable)
        state = await made.add_variable(
            self._id(STATE), ua.QualifiedName(STATE, self._namespace), None, ua.VariantType.String,
            ua.NodeId(ua.ObjectIds.String),
        )  # fmt: skip
        await self._write(state.nodeid, ua.DataValue(ua.Variant(None), WAITING))
        return made

    async def _make_variable(self, node_id: ua.NodeId, variable: Variable) -> None:
        item = ua.AddNodesItem(
            RequestedNewNodeId=node_id, ParentNodeId=self.id, ReferenceTypeId=ua.NodeId(ua.ObjectIds.HasComponent),
            NodeClass=ua.NodeClass.Variable, BrowseName=ua.QualifiedName(variable.name, self._namespace),
            TypeDefinition=ua.NodeId(variable.type_definition), NodeAttributes=variable.attributes(),
        )  # fmt: skip
        added = await self._server.iserver.isession.add_nodes([item])
        added[0].StatusCode.check()
        node = self._server.get_node(node_id)
        for name, value in properties_of(variable):
            place = ua.NodeId(f"{self._twin}.{variable.name}.{name}", self._namespace)
            await node.add_property(place, ua.QualifiedName(name), value)
        await self._write(node_id, ua.DataValue(ua.Variant(None), WAITING))

    async def _write(self, node_id: ua.NodeId, value: ua.DataValue) -> None:
        await self._server.write_attribute_value(node_id, value)

    async def sample(self, values: Mapping[str, Any], clock: TwinClock) -> None:
        """Hold the figures of a sample."""
        moment, told = clock.moment(values["time"]), datetime.now(UTC)
        for node_id, variable in self.variables.items():
            value = variable.value(values.get(variable.name), moment, told)
            self._held[node_id] = value
            await self._write(node_id, value)

    async def state(self, state: str) -> None:
        """Hold what the twin does."""
        now = datetime.now(UTC)
        text = ua.Variant(state, ua.VariantType.String)
        await self._write(self._id(STATE), ua.DataValue(text, SourceTimestamp=now, ServerTimestamp=now))

    async def doubt(self, status: ua.StatusCode) -> None:
        """Hold the newest figures as they are, with a status that says why there are no newer ones."""
        told = datetime.now(UTC)
        for node_id, value in self._held.items():
            if value.StatusCode.is_good():
                await self._write(node_id, replace(value, StatusCode=status, ServerTimestamp=told))
