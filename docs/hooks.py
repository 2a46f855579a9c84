"""What `./run docs` does beside mkdocs: a page for each module, and links that leave docs/."""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]
ROOMS = ("station", "controllers", "theory")
"""Packages whose modules have pages; the service is documented by api.md and its own OpenAPI document."""

BESIDE = {"CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md"}
"""Documents of the repository's root that are pages of the site."""

_LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s#]+)(#[^)\s]*)?\)")


def on_config(config: Any) -> Any:
    """Put the reference of modules behind the pages written by hand."""
    rooms = [{room: [{name: f"reference/{name}.md"} for name in _modules(room)]} for room in ROOMS]
    config.nav = [*config.nav, {"Modules": rooms}]
    return config


def on_files(files: Files, config: Any) -> Files:
    """Add a page for each module, filled by mkdocstrings from its docstrings, and the documents of the root."""
    pages = {f"reference/{name}.md": f"# {name}\n\n::: {name}\n" for room in ROOMS for name in _modules(room)}
    for name, page in BESIDE.items():
        text = (ROOT / name).read_text(encoding="utf-8")
        pages[page] = _LINK.sub(lambda link: _moved(link, "docs/"), text)
    for page, text in pages.items():
        files.append(File.generated(config, page, content=text))
    return files


def on_page_markdown(markdown: str, page: Any, **_more: Any) -> str:
    """Lead links to the root's documents to their pages, and show other paths outside of docs/ as text."""
    folder = posixpath.dirname(page.file.src_uri)

    def inside(link: re.Match[str]) -> str:
        target = posixpath.normpath(posixpath.join(folder, link[3]))
        if "://" in link[3] or not target.startswith("../"):
            return link[0]
        path = target.removeprefix("../")
        if path in BESIDE:
            return f"[{link[2]}]({posixpath.relpath(BESIDE[path], folder or '.')}{link[4] or ''})"
        return f"`{path}`" if link[2].strip("`") in path else f"{link[2]} (`{path}`)"

    return _LINK.sub(inside, markdown)


def _moved(link: re.Match[str], start: str) -> str:
    """A link of a document of the root, as it is from docs/."""
    if "://" in link[3]:
        return link[0]
    target = link[3].removeprefix(start) if link[3].startswith(start) else f"../{link[3]}"
    return f"{link[1]}[{link[2]}]({target}{link[4] or ''})"


def _modules(room: str) -> list[str]:
    """Names of a room's public modules, the room itself first."""
    found = []
    for path in (ROOT / room).rglob("*.py"):
        parts = path.relative_to(ROOT).with_suffix("").parts
        if not any(part.startswith("_") and part != "__init__" for part in parts):
            found.append(".".join(part for part in parts if part != "__init__"))
    return sorted(found)
