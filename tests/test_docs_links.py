"""Links between documents lead to files that are there; every document is in the index and in the site's navigation."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
DOCUMENTS = sorted([*ROOT.glob("*.md"), ROOT / "benchmarks" / "README.md", *DOCS.rglob("*.md")])


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_to_files(document):
    text = re.sub(r"```.*?```", "", document.read_text(encoding="utf-8"), flags=re.DOTALL)
    targets = re.findall(r"\]\(([^)\s]+)\)", text)
    here = [target.partition("#")[0] for target in targets if "://" not in target and not target.startswith("#")]
    missing = [target for target in here if not (document.parent / target).exists()]
    assert missing == []


def test_every_document_is_in_the_index():
    linked = set(re.findall(r"\]\(([\w/-]+\.md)\)", (DOCS / "index.md").read_text(encoding="utf-8")))
    assert {str(path.relative_to(DOCS)) for path in DOCS.rglob("*.md")} - {"index.md"} == linked


def test_every_document_is_in_the_navigation():
    shown = set(re.findall(r"- ([\w/-]+\.md)$", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"), re.MULTILINE))
    beside = {"contributing.md", "changelog.md"}  # pages made of CONTRIBUTING.md and CHANGELOG.md by docs/hooks.py
    assert {str(path.relative_to(DOCS)) for path in DOCS.rglob("*.md")} | beside == shown


def test_readme_is_short_and_says_how_to_start():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.split()) <= 750
    for wanted in ("./run ", "./run test", "docs/index.md", "CONTRIBUTING.md", "![", ">>> from station import"):
        assert wanted in text, wanted


def test_the_citation_names_this_version():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {project['version']}\n" in citation
    assert f"\nlicense: {project['license']}\n" in citation


def test_every_command_is_in_the_list_of_commands():
    from typer.main import get_command

    from api.cli.main import app

    text = (DOCS / "commands.md").read_text(encoding="utf-8")
    assert [name for name in get_command(app).commands if f"hrs {name}" not in text] == []
