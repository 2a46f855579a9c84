"""`modelDescription.xml` of a unit, of either version of the standard."""

from __future__ import annotations

from xml.etree import ElementTree as ET

from api.bridges.fmi.variables import BOOLEANS, FACTORS, VARIABLES, Variable
from station.geometry import BUFFERS
from station.parameters import Station
from station.run import PERIOD

NAME = "station"
"""Identifier of the model: of its binary and its source."""

_BASES = {
    "bar": {"kg": "1", "m": "-1", "s": "-2"}, "degC": {"K": "1"}, "m3": {"m": "3"}, "g": {"kg": "1"},
    "g/s": {"kg": "1", "s": "-1"},
}  # fmt: skip


def starts_of(station: Station) -> list[float]:
    """The start value of each variable: valves closed, the usual vehicle, the buffers as the station has them."""
    usual, buffers = station.vehicle, station.buffers.all
    known = {
        "vehicle_start_pressure": usual.start_pressure_bar, "vehicle_start_temperature": usual.start_temperature_c,
        "vehicle_volume": usual.volume_m3,
    }  # fmt: skip
    for name, tank in zip(BUFFERS, buffers, strict=True):
        known[f"initial_pressure_{name}"] = tank.initial_pressure_bar
        known[f"initial_temperature_{name}"] = tank.initial_temperature_c
    return [float(known.get(variable.name, 0.0)) for variable in VARIABLES]


def _units(parent: ET.Element) -> None:
    definitions = ET.SubElement(parent, "UnitDefinitions")
    for unit, (factor, offset) in FACTORS.items():
        base = {**_BASES[unit], "factor": repr(factor), **({"offset": repr(offset)} if offset else {})}
        ET.SubElement(ET.SubElement(definitions, "Unit", name=unit), "BaseUnit", base)


def _text(root: ET.Element) -> bytes:
    ET.indent(root)
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root)


def _about(station: Station) -> str:
    return f"The station {station.name} of hrs-twin: buffers, compressor, dispenser and a vehicle, a second at a time"


def _traits(variable: Variable) -> dict[str, str]:
    """Causality and what goes with it."""
    initial = {"input": {}, "output": {"initial": "calculated"}, "parameter": {"initial": "exact"}}[variable.causality]
    discrete = "fixed" if variable.causality == "parameter" else "discrete"
    return {"causality": variable.causality, "variability": discrete, **initial}


def fmi2(station: Station, token: str, starts: list[float]) -> bytes:
    """The description of FMI 2.0."""
    root = ET.Element(
        "fmiModelDescription", fmiVersion="2.0", modelName=f"hrs-twin {station.name}", guid=token,
        description=_about(station), generationTool="hrs-twin", numberOfEventIndicators="0",
    )  # fmt: skip
    unit = ET.SubElement(
        root, "CoSimulation", modelIdentifier=NAME, canHandleVariableCommunicationStepSize="true",
        canGetAndSetFMUstate="true", canSerializeFMUstate="true", canBeInstantiatedOnlyOncePerProcess="false",
    )  # fmt: skip
    files = ET.SubElement(unit, "SourceFiles")
    ET.SubElement(files, "File", name="fmi2.c")
    _units(root)
    ET.SubElement(root, "DefaultExperiment", startTime="0", stopTime="5000", stepSize=repr(PERIOD))
    variables = ET.SubElement(root, "ModelVariables")
    outputs = []
    for place, (variable, start) in enumerate(zip(VARIABLES, starts, strict=True)):
        scalar = ET.SubElement(
            variables, "ScalarVariable",
            {
                "name": variable.name, "valueReference": str(place), "description": variable.about,
                **_traits(variable),
            },
        )  # fmt: skip
        if variable.causality == "output":
            outputs.append(place + 1)
        given = {} if variable.causality == "output" else {"start": _start(place, start)}
        kind = "Boolean" if place < BOOLEANS else "Real"
        ET.SubElement(scalar, kind, {**({"unit": variable.unit} if variable.unit else {}), **given})
    structure = ET.SubElement(root, "ModelStructure")
    for part in ("Outputs", "InitialUnknowns"):
        listed = ET.SubElement(structure, part)
        for index in outputs:
            ET.SubElement(listed, "Unknown", index=str(index))
    return _text(root)


def fmi3(station: Station, token: str, starts: list[float]) -> bytes:
    """The description of FMI 3.0."""
    root = ET.Element(
        "fmiModelDescription", fmiVersion="3.0", modelName=f"hrs-twin {station.name}", instantiationToken=token,
        description=_about(station), generationTool="hrs-twin",
    )  # fmt: skip
    ET.SubElement(
        root, "CoSimulation", modelIdentifier=NAME, canHandleVariableCommunicationStepSize="true",
        canGetAndSetFMUState="true", canSerializeFMUState="true", canBeInstantiatedOnlyOncePerProcess="false",
    )  # fmt: skip
    _units(root)
    ET.SubElement(root, "DefaultExperiment", startTime="0", stopTime="5000", stepSize=repr(PERIOD))
    variables = ET.SubElement(root, "ModelVariables")
    outputs = []
    for place, (variable, start) in enumerate(zip(VARIABLES, starts, strict=True)):
        if variable.causality == "output":
            outputs.append(str(place))
        given = {} if variable.causality == "output" else {"start": _start(place, start)}
        ET.SubElement(
            variables, "Boolean" if place < BOOLEANS else "Float64",
            {
                "name": variable.name, "valueReference": str(place), "description": variable.about, **_traits(variable),
                **({"unit": variable.unit} if variable.unit else {}), **given,
            },
        )  # fmt: skip
    # Time is a variable of its own here.
    ET.SubElement(
        variables, "Float64", name="time", valueReference=str(len(VARIABLES)), causality="independent",
        variability="continuous", description="simulated time [s]",
    )  # fmt: skip
    structure = ET.SubElement(root, "ModelStructure")
    for part in ("Output", "InitialUnknown"):
        for reference in outputs:
            ET.SubElement(structure, part, valueReference=reference)
    return _text(root)


def _start(place: int, start: float) -> str:
    """A start value as text."""
    return ("true" if start else "false") if place < BOOLEANS else repr(start)
