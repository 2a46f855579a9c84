"""docs/glossary.md and docs/dependencies.md leave nothing out."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from station import Limit, Station, Valve, load_station
from station.columns import CODES, COUNTS, VALUES, VEHICLE_COLUMNS
from station.control_model import ControlModel
from station.costs import COST_UNITS
from station.limit_figures import LimitFigures
from station.metrics import UNITS
from station.quantities import Part

ROOT = Path(__file__).parents[2]
GLOSSARY = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")


def _leaves(document: dict[str, object], path: str = "") -> list[str]:
    found: list[str] = []
    for key, value in document.items():
        here = f"{path}.{key}" if path else key
        found += _leaves(value, here) if isinstance(value, dict) else [here]
    return found


def _preset_fields() -> list[str]:
    fields = _leaves(load_station("thesis-fit").model_dump(exclude={"name", "about", "source"}))
    return sorted({re.sub(r"\.(high|medium|low)\b", ".*", field) for field in fields})


def _section_fields() -> list[str]:
    """Parameters of sections, those too that files leave out."""
    sections = {name: field.annotation for name, field in Station.model_fields.items()}
    return [
        f"{section}.{name}"
        for section, kind in sections.items()
        if isinstance(kind, type) and issubclass(kind, Part)
        for name, field in kind.model_fields.items()
        if not (isinstance(field.annotation, type) and issubclass(field.annotation, Part))
    ]


@pytest.mark.parametrize(
    "name",
    [
        *ControlModel._fields,
        *LimitFigures._fields,
        *VALUES,
        *CODES,
        *COUNTS,
        *VEHICLE_COLUMNS,
        *UNITS,
        *COST_UNITS,
        *(limit.name for limit in Limit if limit),
        *(valve.name for valve in Valve),
        *dict.fromkeys([*_preset_fields(), *_section_fields()]),
    ],
)
def test_every_name_is_in_the_glossary(name: str) -> None:
    assert f"`{name}`" in GLOSSARY or f"`{name}:" in GLOSSARY or f"`{name}`:" in GLOSSARY


@pytest.mark.parametrize("figures", [UNITS, COST_UNITS, VALUES])
def test_figures_stand_with_their_unit(figures: dict[str, str]) -> None:
    for name, unit in figures.items():
        lines = [line for line in GLOSSARY.splitlines() if f"`{name}`" in line]
        assert any(unit in line for line in lines) or name.startswith("decision_"), name


def test_every_controller_has_its_row() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    table = (ROOT / "docs" / "controllers.md").read_text(encoding="utf-8").split("\n\n")[1]
    named = {name for line in table.splitlines() for name in re.findall(r"`(\w+)`", line.split("|")[1])}
    assert named == set(project["entry-points"]["hrs.controllers"])


def test_every_dependency_is_explained() -> None:
    text = (ROOT / "docs" / "dependencies.md").read_text(encoding="utf-8").lower()
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    extras = project["project"]["optional-dependencies"]
    wanted = [*project["project"]["dependencies"], *extras["test"], *extras["dask"], *extras["docs"]]
    for requirement in [*wanted, *project["build-system"]["requires"]]:
        name = re.split(r"[<>=\[]", requirement)[0]
        assert f"**{name}**" in text, name
