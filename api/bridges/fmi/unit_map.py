"""The map of a foreign unit: which of its variables is which quantity of a station, in which unit."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from pydantic import Field, ValidationError

from station.errors import InputError
from station.files import parse_file
from station.geometry import TANKS, VALVES
from station.measurement import range_of, unit_registry
from station.quantities import PRESSURE_MAX, VOLUME_MAX, Part

NUMBER, CONNECTED = "vehicle_number", "vehicle_connected"
"""Quantities that tell the unit of a vehicle: 1, 2, ... for each, 0 for none; and whether there is one."""

_MASS_MAX = 1e9
"""Beyond it a mass is a mistake of unit [g]."""


class Quantity(NamedTuple):
    """A quantity of a station that a variable may stand for."""

    unit: str  # empty: a number without one
    low: float
    high: float
    required: bool = False


INPUTS = {
    **dict.fromkeys(VALVES, Quantity("", 0.0, 1.0, required=True)),
    CONNECTED: Quantity("", 0.0, 1.0),
    NUMBER: Quantity("", 0.0, 1e9),
    "vehicle_start_pressure": Quantity("bar", 0.0, PRESSURE_MAX),
    "vehicle_start_temperature": Quantity("degC", *range_of("temperature_vehicle")),
    "vehicle_volume": Quantity("m^3", 0.0, VOLUME_MAX),
}
"""What the unit is given, by quantity."""

OUTPUTS = {
    **{f"pressure_{tank}": Quantity("bar", *range_of(f"pressure_{tank}"), required=True) for tank in TANKS},
    **{f"temperature_{tank}": Quantity("degC", *range_of(f"temperature_{tank}"), required=True) for tank in TANKS},
    **{f"mass_{tank}": Quantity("g", 0.0, _MASS_MAX) for tank in TANKS},
    **{f"flow_{side}": Quantity("g/s", *range_of(f"flow_{side}")) for side in ("compressor", "dispenser")},
}
"""What the unit shows, by quantity."""

_CAUSALITIES = {"inputs": ("input",), "outputs": ("output", "local"), "parameters": ("parameter",)}
"""Of the variables in each table of the map."""

_NUMERIC = ("Real", "Integer", "Enumeration", "Boolean", "Float32", "Float64",
            *(f"{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64)))  # fmt: skip
"""Types of variables that can hold a quantity."""

Factor = Annotated[float, Field(ge=-1e12, le=1e12, allow_inf_nan=False)]


class Mapped(Part):
    """A variable: its quantity is `scale` times its value plus `offset`, in `unit`."""

    variable: Annotated[str, Field(min_length=1, max_length=1000)]
    unit: Annotated[str, Field(max_length=50)] | None = None
    scale: Factor = 1.0
    offset: Factor = 0.0


class UnitMap(Part):
    """The map of a unit: inputs and outputs by quantity, values of its parameters in the unit's own units.

    A second is stepped in `steps_per_second` equal steps.
    """

    inputs: dict[str, Mapped]
    outputs: dict[str, Mapped]
    parameters: dict[str, Annotated[float, Field(allow_inf_nan=False)] | bool] = Field(default_factory=dict)
    steps_per_second: Annotated[int, Field(ge=1, le=1000)] = 1


class Channel(NamedTuple):
    """A variable of the unit with the quantity that it stands for."""

    quantity: str
    variable: str
    reference: int
    type: str
    unit: str  # of the value that `scale` and `offset` give; the quantity's own where nothing is converted
    own: str  # the quantity's unit
    scale: float
    offset: float

    def read(self, value: float) -> float:
        """The quantity, in its own unit, of a value of the variable."""
        value = value if (self.scale, self.offset) == (1.0, 0.0) else self.scale * value + self.offset
        return value if self.unit == self.own else _converted(value, self.unit, self.own)

    def written(self, value: float) -> float:
        """The value of the variable that stands for a quantity in its own unit."""
        value = value if self.unit == self.own else _converted(value, self.own, self.unit)
        return value if (self.scale, self.offset) == (1.0, 0.0) else (value - self.offset) / self.scale


class Wiring(NamedTuple):
    """A map whose variables were found in a unit's description."""

    inputs: dict[str, Channel]
    outputs: dict[str, Channel]
    parameters: tuple[tuple[Channel, float], ...]
    steps_per_second: int


def _converted(value: float, unit: str, wanted: str) -> float:
    return float(unit_registry().Quantity(value, unit).to(wanted).magnitude)


def load_map(path: Path) -> UnitMap:
    """The map of a TOML or JSON file.

    Raises
    ------
    InputError
        naming each wrong field, or the file that cannot be read.
    """
    try:
        return UnitMap.model_validate(parse_file(path, str(path)))
    except ValidationError as error:
        raise InputError.of(str(path), error) from None


class _Wirer:
    """Finds the variables of a map in a description, and gathers what is wrong."""

    def __init__(self, given: UnitMap, description: Any) -> None:
        self._given = given
        self._variables = {each.name: each for each in description.modelVariables}
        self._bases = {each.name: each.baseUnit for each in description.unitDefinitions if each.baseUnit is not None}
        self.problems: list[tuple[str, str]] = []

    @cached_property
    def wiring(self) -> Wiring:
        """What was found."""
        given = self._given
        inputs = self._table("inputs", given.inputs, INPUTS)
        self._refuse_shared(given.inputs)
        if not {NUMBER, CONNECTED} & given.inputs.keys():
            self.problems.append(("inputs", f"must have {CONNECTED} or {NUMBER}: the unit is told of vehicles by it"))
        parameters = []
        for name, value in given.parameters.items():
            found = self._variable(f"parameters.{name}", "parameters", name)
            if found is not None:
                parameters.append((_plain(name, found), float(value)))
        outputs = self._table("outputs", given.outputs, OUTPUTS)
        return Wiring(inputs, outputs, tuple(parameters), given.steps_per_second)

    def _table(self, table: str, given: dict[str, Mapped], known: dict[str, Quantity]) -> dict[str, Channel]:
        for name, quantity in known.items():
            if quantity.required and name not in given:
                self.problems.append((table, f"must have {name}"))
        found = {}
        for name, mapped in given.items():
            field = f"{table}.{name}"
            if name not in known:
                self.problems.append((field, f"must be one of {', '.join(known)}; given {name!r:.100}"))
                continue
            variable = self._variable(f"{field}.variable", table, mapped.variable)
            meant = None if variable is None else self._unit(f"{field}.unit", mapped, variable, known[name].unit)
            if mapped.scale == 0:
                self.problems.append((f"{field}.scale", "must not be 0"))
            if meant is not None:
                found[name] = _plain(name, variable)._replace(
                    unit=meant.unit, own=known[name].unit, scale=meant.factor * mapped.scale,
                    offset=meant.factor * mapped.offset + meant.offset,
                )  # fmt: skip
        return found

    def _refuse_shared(self, given: dict[str, Mapped]) -> None:
        """Refuse an input variable that two quantities set: the unit would see the last of them alone."""
        first: dict[str, str] = {}
        for name, mapped in given.items():
            other = first.setdefault(mapped.variable, name)
            if other != name:
                wrong = f"must be another variable than that of {other}; given {mapped.variable!r:.100}"
                self.problems.append((f"inputs.{name}.variable", wrong))

    def _variable(self, field: str, table: str, name: str) -> Any:
        """The variable of that name; None, and a problem, where it cannot be used."""
        found, wanted = self._variables.get(name), _CAUSALITIES[table]
        if found is None:
            shown = ", ".join(each for each, one in self._variables.items() if one.causality in wanted)
            wrong = f"must be a variable of the unit, which has {shown or 'none'!s:.300}; given {name!r:.100}"
        elif found.causality not in wanted:
            wrong = f"must be of causality {' or '.join(wanted)}; {name!r:.100} is {found.causality}"
        elif found.type not in _NUMERIC or found.dimensions:
            wrong = f"must be one number; {name!r:.100} is {'an array of ' * bool(found.dimensions)}{found.type}"
        else:
            return found
        self.problems.append((field, wrong))
        return None

    def _unit(self, field: str, mapped: Mapped, variable: Any, wanted: str) -> _Meant | None:
        """The unit of a variable; None, and a problem, where it does not fit."""
        declared = variable.unit or (variable.declaredType.unit if variable.declaredType else None)
        unit = mapped.unit or declared
        if not wanted:
            if mapped.unit:
                self.problems.append((field, f"must be left out: it is a number without one; given {unit!r:.50}"))
            return None if mapped.unit else _Meant("")
        if not unit:
            self.problems.append((field, f"must be given, as {wanted}: the unit's description names none"))
            return None
        meant = _Meant(unit)
        if not mapped.unit and not _is_known(unit) and unit in self._bases:
            meant = _based(self._bases[unit])  # what the description says of a name that is its own
        try:
            unit_registry().Quantity(0.0, meant.unit).to(wanted)
        except Exception as error:  # noqa: BLE001 - pint raises what its parser and tokenizer raise
            self.problems.append((field, f"must be of the dimension of {wanted}; given {unit!r:.50} ({error!s:.200})"))
            return None
        if mapped.unit and declared and _differ(declared, mapped.unit):
            wrong = f"must be {declared}, as the unit's description has {mapped.variable!r:.100}; given {unit!r:.50}"
            self.problems.append((field, wrong))
            return None
        return meant if _differ(meant.unit, wanted) else meant._replace(unit=wanted)


class _Meant(NamedTuple):
    """A unit that Pint knows, and by what a value is brought to it."""

    unit: str
    factor: float = 1.0
    offset: float = 0.0


def _based(base: Any) -> _Meant:
    """A unit as FMI defines it by base units of the SI."""
    powers = {name: int(getattr(base, name) or 0) for name in ("kg", "m", "s", "A", "K", "mol", "cd", "rad")}
    unit = " * ".join(f"{name}**{power}" for name, power in powers.items() if power) or "dimensionless"
    return _Meant(unit, float(base.factor or 1.0), float(base.offset or 0.0))


def _is_known(unit: str) -> bool:
    """Whether Pint knows a unit."""
    try:
        unit_registry().Unit(unit)
    except Exception:  # noqa: BLE001 - pint raises what its parser and tokenizer raise
        return False
    return True


def _differ(one: str, other: str) -> bool:
    """Whether two units are known to be different."""
    registry = unit_registry()
    return _is_known(one) and _is_known(other) and bool(registry.Unit(one) != registry.Unit(other))


def _plain(quantity: str, variable: Any) -> Channel:
    """A channel that converts nothing."""
    return Channel(quantity, variable.name, int(variable.valueReference), variable.type, "", "", 1.0, 0.0)


def wired(given: UnitMap, description: Any, source: str) -> Wiring:
    """A map with the variables that a unit's description (FMPy's) has.

    Raises
    ------
    InputError
        naming each variable that there is not, whose causality, type or unit does not fit, or that is missing.
    """
    wirer = _Wirer(given, description)
    found = wirer.wiring
    if wirer.problems:
        raise InputError(source, wirer.problems)
    return found
