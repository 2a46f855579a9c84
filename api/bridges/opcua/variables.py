"""What a column of a twin is as an OPC UA variable: its type, unit and range, and its figures as values."""

from __future__ import annotations

import math
from datetime import datetime
from typing import Any, NamedTuple

from asyncua import ua

from station.columns import CODES, COUNTS
from station.geometry import VALVES
from station.measurement import range_of
from station.sensor_names import ANALOG

_CEFACT = "http://www.opcfoundation.org/UA/units/un/cefact"

_OWN = "urn:hrs-twin:units"

_COMMON_CODES = {"bar": "BAR", "degC": "CEL", "K": "KEL", "g": "GRM", "s": "SEC"}
"""Codes of units in UNECE Recommendation 20; their bytes are the unit's number (OPC 10000-8, 5.6.4.3)."""

_NO_UNITS = ("", "1", "code", "index", "vehicles")

NOTHING = ua.StatusCode(ua.StatusCodes.BadNoData)
"""The status of a figure that is no number: there is no vehicle, no reading."""

GOOD = ua.StatusCode(ua.StatusCodes.Good)


class Variable(NamedTuple):
    """A column as a variable."""

    name: str
    unit: str

    @property
    def type(self) -> ua.VariantType:
        """The type of its values: Boolean of a valve, Int32 of what is counted, else Double."""
        if self.name in VALVES:
            return ua.VariantType.Boolean
        return ua.VariantType.Int32 if self.name in CODES or self.name in COUNTS else ua.VariantType.Double

    @property
    def range(self) -> ua.Range | None:
        """What it can be, where it is what a sensor reads."""
        if self.name not in ANALOG:
            return None
        low, high = range_of(self.name)
        return ua.Range(Low=low, High=high)

    @property
    def engineering_unit(self) -> ua.EUInformation | None:
        """Its unit, with the number that OPC UA has for it, or -1."""
        if self.unit in _NO_UNITS:
            return None
        code = _COMMON_CODES.get(self.unit)
        number = -1 if code is None else int.from_bytes(code.encode(), "big")
        return ua.EUInformation(_OWN if code is None else _CEFACT, number, ua.LocalizedText(self.unit))

    @property
    def type_definition(self) -> int:
        """The type of the variable: with a range AnalogItemType, with a unit BaseAnalogType."""
        if self.range is not None:
            return ua.ObjectIds.AnalogItemType
        return ua.ObjectIds.BaseDataVariableType if self.engineering_unit is None else ua.ObjectIds.BaseAnalogType

    def value(self, figure: float | None, moment: datetime, told: datetime | None = None) -> ua.DataValue:
        """A figure of that moment, as it was told to the server."""
        if figure is None or math.isnan(figure):
            return ua.DataValue(ua.Variant(None), NOTHING, moment, told)
        kind = self.type
        whole = bool(figure) if kind is ua.VariantType.Boolean else int(figure)
        content = figure if kind is ua.VariantType.Double else whole
        return ua.DataValue(ua.Variant(content, kind), GOOD, moment, told)

    def attributes(self) -> ua.VariableAttributes:
        """What its node says of it: to be read, now and of the past, and not to be written."""
        access = ua.AccessLevel.CurrentRead.mask | ua.AccessLevel.HistoryRead.mask
        return ua.VariableAttributes(
            DisplayName=ua.LocalizedText(self.name), Description=ua.LocalizedText(self.name),
            DataType=ua.NodeId(getattr(ua.ObjectIds, self.type.name)), Value=ua.Variant(None),
            ValueRank=ua.ValueRank.Scalar, ArrayDimensions=None, AccessLevel=access, UserAccessLevel=access,
            Historizing=True,
        )  # fmt: skip


def properties_of(variable: Variable) -> list[tuple[str, Any]]:
    """Names and values of the properties of a variable's node."""
    found = [("EngineeringUnits", variable.engineering_unit), ("EURange", variable.range)]
    return [(name, value) for name, value in found if value is not None]
