"""The file of the thesis's examples: one table an example, as printed."""

from __future__ import annotations

import tomllib
from functools import cache
from importlib.resources import files
from typing import Any

from theory.errors import IllPosedError


def example_table(name: str, names: tuple[str, ...]) -> dict[str, Any]:
    """The table of an example.

    Parameters
    ----------
    name
        The example.
    names
        The examples to choose from; any other raises `IllPosedError`.
    """
    if name not in names:
        raise IllPosedError("example", f"{name!r} is none of {', '.join(names)}")
    return dict(data()[name])


@cache
def data() -> dict[str, Any]:
    """All tables by name, read once."""
    return tomllib.loads((files("theory") / "data" / "examples.toml").read_text(encoding="utf-8"))
