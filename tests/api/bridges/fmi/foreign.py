"""Units of somebody else, compiled by the tests: other names, units, variables and equations than ours."""

from __future__ import annotations

import subprocess
from pathlib import Path
from zipfile import ZipFile

from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave

SOURCE = Path(__file__).parent / "data" / "foreign.c"

BANKS = ("HP", "MP", "LP")

VARIABLES = [
    *((f"{side}.{bank}", 3 * place + i, "input", "Real", "") for place, side in enumerate(("fill", "feed"))
      for i, bank in enumerate(BANKS)),
    ("car.number", 6, "input", "Integer", ""),
    ("car.p0", 7, "input", "Real", "kPa"),
    ("car.T0", 8, "input", "Real", "K"),
    *((f"p.{tank}", 10 + i, "output", "Real", "kPa") for i, tank in enumerate((*BANKS, "car"))),
    *((f"T.{bank}", 14 + i, "output", "Real", "K") for i, bank in enumerate(BANKS)),
    ("T.car", 17, "output", "Real", ""),
    ("compressor.flow", 20, "output", "Real", "kg/h"),
    ("dispenser.flow", 21, "local", "Real", "kg/h"),
    ("bad.how", 30, "parameter", "Real", ""),
    ("bad.when", 31, "parameter", "Real", "s"),
    ("p.start", 32, "parameter", "Real", "kPa"),
]  # fmt: skip
"""Name, reference, causality, type and unit of each."""

MAP = """
steps_per_second = 2

[inputs]
inlet_high = { variable = "fill.HP", scale = 0.01 }
inlet_medium = { variable = "fill.MP", scale = 0.01 }
inlet_low = { variable = "fill.LP", scale = 0.01 }
outlet_high = { variable = "feed.HP", scale = 0.01 }
outlet_medium = { variable = "feed.MP", scale = 0.01 }
outlet_low = { variable = "feed.LP", scale = 0.01 }
vehicle_number = { variable = "car.number" }
vehicle_start_pressure = { variable = "car.p0" }
vehicle_start_temperature = { variable = "car.T0" }

[outputs]
pressure_high = { variable = "p.HP" }
pressure_medium = { variable = "p.MP" }
pressure_low = { variable = "p.LP" }
pressure_vehicle = { variable = "p.car" }
temperature_high = { variable = "T.HP" }
temperature_medium = { variable = "T.MP" }
temperature_low = { variable = "T.LP" }
temperature_vehicle = { variable = "T.car", unit = "degC" }
flow_compressor = { variable = "compressor.flow" }
flow_dispenser = { variable = "dispenser.flow", unit = "kg/h" }
"""
"""Its map, as a user would write it."""


def _description(version: int) -> str:
    """`modelDescription.xml`."""
    lines = []
    for name, reference, causality, kind, unit in VARIABLES:
        start = ' start="0"' if causality == "input" else ' start="1e9"' if name == "bad.when" else ""
        start = ' start="90000"' if name == "p.start" else ' start="0"' if name == "bad.how" else start
        traits = f'name="{name}" valueReference="{reference}" causality="{causality}"'
        traits += ' variability="fixed"' if causality == "parameter" else ' variability="discrete"'
        of = f' unit="{unit}"' if unit else ""
        if version == 2:
            lines.append(f"<ScalarVariable {traits}><{kind}{of}{start}/></ScalarVariable>")
        else:
            lines.append(f"<{'Float64' if kind == 'Real' else 'Int32'} {traits}{of}{start}/>")
    if version == 3:
        lines.append('<Float64 name="time" valueReference="99" causality="independent" variability="continuous"/>')
    units = "".join(f'<Unit name="{unit}"/>' for unit in ("kPa", "K", "kg/h", "s"))
    token = "guid" if version == 2 else "instantiationToken"
    outputs = [place for place, each in enumerate(VARIABLES) if each[2] == "output"]
    if version == 2:
        unknowns = "".join(f'<Unknown index="{place + 1}"/>' for place in outputs)
        structure = f"<Outputs>{unknowns}</Outputs><InitialUnknowns>{unknowns}</InitialUnknowns>"
    else:
        structure = "".join(
            f'<{part} valueReference="{VARIABLES[place][1]}"/>' for part in ("Output", "InitialUnknown")
            for place in outputs
        )  # fmt: skip
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<fmiModelDescription fmiVersion="{version}.0" modelName="Foreign" '
        f'{token}="{{f}}"><CoSimulation modelIdentifier="foreign" canHandleVariableCommunicationStepSize="true"/>'
        f"<UnitDefinitions>{units}</UnitDefinitions><ModelVariables>{''.join(lines)}</ModelVariables>"
        f"<ModelStructure>{structure}</ModelStructure></fmiModelDescription>"
    )


def _unused(version: int) -> str:
    """C of the functions that the standard wants of every unit and this one has no use for."""
    text = SOURCE.read_text()
    names = [name for name in dir(FMU2Slave if version == 2 else FMU3Slave) if name.startswith(f"fmi{version}")]
    plain = {name: name.removeprefix(f"fmi{version}") for name in names}
    there = {name for name, short in plain.items() if f"{name}(" in text or f"NAME({short})" in text}
    return "".join(f"int {name}(void) {{ return 3; }}\n" for name in names if name not in there)


def build(folder: Path, version: int, *, platform: str | None = None) -> Path:
    """The unit's file, with a binary for Linux on x86-64, or said to be for another platform."""
    library, unused = folder / f"foreign{version}.so", folder / f"unused{version}.c"
    unused.write_text(_unused(version))
    command = ["gcc", "-shared", "-fPIC", "-w", f"-DVERSION={version}", "-o", library, SOURCE, unused]
    subprocess.run([str(part) for part in command], check=True)
    path = folder / f"foreign{version}.fmu"
    where = platform or {2: "linux64", 3: "x86_64-linux"}[version]
    with ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", _description(version))
        archive.write(library, f"binaries/{where}/foreign.so")
    return path
