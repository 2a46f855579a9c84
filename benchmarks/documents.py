"""Documents with generated parts: a part stands between two marks and is rewritten, the prose around it stays."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

from api.files import write_whole

DOCS = Path(__file__).resolve().parent.parent / "docs"


def _marks(name: str) -> tuple[str, str]:
    return f"<!-- generated: {name} -->\n", f"<!-- end of {name} -->"


def part(text: str, name: str) -> str:
    """The generated part of that name.

    Raises
    ------
    ValueError
        if the document has no such part.
    """
    start, end = _marks(name)
    if start not in text or end not in text:
        raise ValueError(f"the document has no part called {name!r}")
    return text[text.index(start) + len(start) : text.index(end)]


def with_parts(text: str, parts: Mapping[str, str]) -> str:
    """The document with each of these parts replaced."""
    for name, new in parts.items():
        start, end = _marks(name)
        text = text.replace(start + part(text, name) + end, f"{start}\n{new.strip()}\n\n{end}")
    return text


def rewrite(document: str, parts: Mapping[str, str]) -> None:
    """Rewrite these parts of a document in docs/, whole or not at all."""
    path = DOCS / document
    write_whole(path, with_parts(path.read_text(encoding="utf-8"), parts))


def table(headings: Sequence[str], rows: Iterable[Sequence[str]], left: int = 1) -> str:
    """A Markdown table; the first `left` columns are aligned left, the others right."""
    rule = [":--"] * left + ["--:"] * (len(headings) - left)
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (headings, rule, *rows))


def seconds(value: float) -> str:
    """A whole number with thin groups of three digits."""
    return f"{value:,.0f}".replace(",", " ")


def recompute(document: str, parts: Mapping[str, Callable[[], str]], names: Sequence[str]) -> None:
    """Recompute the parts named, or all, and rewrite the document after each."""
    if unfit := set(names) - set(parts):
        sys.exit(f"no part is called {', '.join(sorted(unfit))}; there are {', '.join(parts)}")
    for name in names or parts:
        rewrite(document, {name: parts[name]()})
        print(name, file=sys.stderr)
