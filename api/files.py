"""Files the face writes: whole or not at all."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from station import InputError


def check_writable(path: Path) -> None:
    """Raise InputError unless a file can be made at `path`; called before anything long runs."""
    if path.is_dir() or not path.parent.is_dir():
        raise InputError("output", [(str(path), "must be a file in a folder that exists")])
    if path.exists() and not path.is_file():
        raise InputError("output", [(str(path), "is no ordinary file")])
    if not os.access(path if path.exists() else path.parent, os.W_OK):
        raise InputError("output", [(str(path), "cannot be written")])


def check_ending(path: Path, endings: tuple[str, ...]) -> None:
    """Raise InputError unless the name of a file that is to be written says what it will hold, and it can be made."""
    if path.suffix not in endings:
        raise InputError("output", [(str(path), f"must end in {' or '.join(endings)}")])
    check_writable(path)


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file, text as UTF-8; a reader sees the old file or the whole new one."""
    check_writable(path)
    partial = path.with_name(path.name + ".partial")
    try:
        partial.write_bytes(content.encode() if isinstance(content, str) else content)
        partial.replace(path)
    except OSError as error:
        raise InputError("output", [(str(path), f"cannot be written: {error.strerror}")]) from None
    finally:
        partial.unlink(missing_ok=True)


def write_json(path: Path, document: Any) -> None:
    """Write a document as JSON; a reader sees the old file or the whole new one."""
    write_whole(path, json.dumps(document, indent=1, allow_nan=False) + "\n")
