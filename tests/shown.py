"""Output that a document shows against output that a program gave."""

from __future__ import annotations

import re
from collections.abc import Sequence

ELLIPSIS = "[...]"


def pattern(shown: Sequence[str], varies: Sequence[str] = ()) -> re.Pattern[str]:
    """What output must match to be as shown.

    `[...]` on a line of its own stands for any lines, within a line for any text; each of `varies` (a time, an id)
    for any text without spaces. Blank lines and the width of gaps count for nothing.
    """
    parts = []
    for line in shown:
        words = " ".join(line.split())
        if not words:
            continue
        if words == ELLIPSIS:
            parts.append(r"(?:.*\n)*?")
            continue
        found = re.escape(words).replace(re.escape(ELLIPSIS), r".*").replace(r"\ ", " ")
        for each in varies:
            found = found.replace(re.escape(each).replace(r"\ ", " "), r"\S+")
        parts.append(found + r"\n")
    return re.compile("".join(parts))


def agree(shown: Sequence[str], output: str, varies: Sequence[str] = ()) -> None:
    """Fail unless the output is as shown."""
    lines = [" ".join(line.split()) for line in output.splitlines()]
    given = "".join(f"{line}\n" for line in lines if line)
    assert pattern(shown, varies).fullmatch(given), f"shown:\n{chr(10).join(shown)}\n\ngiven:\n{output}"
