"""Options that several commands take: which database they use."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

DataOption = Annotated[Path | None, typer.Option("--data", metavar="FOLDER", help="where the embedded database is")]

DatabaseOption = Annotated[
    str | None, typer.Option("--database", metavar="URL", help="postgresql://user:password@host/name instead")
]
