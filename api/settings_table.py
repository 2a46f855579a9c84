"""The table of settings in docs/operations.md: `python -m api.settings_table` prints it, a test compares."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from api.settings import Settings

_UNITS = {"bytes": "bytes", "days": "days", "s": "s", "h": "h"}
"""Endings of names that are units, for settings whose schema names none."""

_DEFAULTS = {"data": "`~/.local/share/hrs-twin`", "workers": "one a core"}
"""Defaults that are found on the machine."""


def table() -> str:
    """One row a setting, in the order of their declaration."""
    properties = Settings.model_json_schema()["properties"]
    rows = ["| setting | default | unit | limits | what |", "| :-- | --: | :-- | :-- | :-- |"]
    rows += [_row(name, about) for name, about in properties.items()]
    return "\n".join(rows)


def _row(name: str, about: dict[str, Any]) -> str:
    default = _DEFAULTS.get(name) or _shown(Settings.model_fields[name].get_default())
    unit = about.get("unit") or next((unit for part, unit in _UNITS.items() if part in name.split("_")), "")
    kinds = [about, *about.get("anyOf", [])]
    signs = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}
    limits = [f"{sign} {_shown(kind[key])}" for kind in kinds for key, sign in signs.items() if key in kind]
    limits += [", ".join(f"`{choice}`" for choice in kind["enum"]) for kind in kinds if "enum" in kind]
    return f"| `{name}` | {default} | {unit} | {', '.join(limits)} | {about['description']} |"


def _shown(value: Any) -> str:
    if value is None or value == "":
        return ""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        return f"{value:,g}".replace(",", " ") if value < 1e6 else f"{value:,.0f}".replace(",", " ")
    return f"`{value}`" if not isinstance(value, Path) else ""


if __name__ == "__main__":
    print(table())
