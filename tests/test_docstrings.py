"""Public names of station, controllers and theory have docstrings in numpydoc form that agree with their signatures.

The sources are read, not imported. Types of parameters stand in the signatures, which mypy holds, so that the sections
say shape, unit and meaning.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
from numpydoc.hooks.validate_docstrings import AstValidator
from numpydoc.validate import validate

ROOT = Path(__file__).parents[1]

ROOMS = ("station", "controllers", "theory")

CHECKS = {
    "GL01",
    "GL03",
    "GL05",
    "GL06",
    "GL07",
    "GL08",
    "GL10",
    "SS01",
    "SS04",
    "PR02",
    "PR03",
    "PR05",
    "PR07",
    "PR10",
    "RT03",
}
"""Of numpydoc's validation, what holds everywhere; each means what its name in numpydoc says."""

OPENINGS = {"What", "Whatever", "Who", "Whoever", "Whose", "Where", "Wherever", "Nobody", "Somebody"}
"""Words no docstring begins with: a noun phrase or a verb says sooner what the thing is."""

ARRAYS = ("Array", "ExactMatrix")
"""Types of arguments in theory that have a shape, which only a section Parameters can tell."""


class Documented(NamedTuple):
    """A module, or a public class, function or method of one."""

    path: str
    name: str
    node: ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
    ancestry: list[ast.AST]

    @property
    def docstring(self) -> str:
        return ast.get_docstring(self.node) or ""

    def __str__(self) -> str:
        return f"{self.path}:{getattr(self.node, 'lineno', 1)} {self.name}"


def _public(path: str, node: ast.AST, name: str, ancestry: list[ast.AST]) -> Iterator[Documented]:
    if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
        if getattr(node, "name", "").startswith("_"):
            return
        yield Documented(path, name, node, ancestry)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            return  # what is inside cannot be imported
        ancestry = [*ancestry, node]
    for child in ast.iter_child_nodes(node):
        yield from _public(path, child, f"{name}.{getattr(child, 'name', '')}".rstrip("."), ancestry)


def documented(text: str, path: str) -> list[Documented]:
    """All public names of a source."""
    return list(_public(path, ast.parse(text), path.removesuffix(".py").replace("/", "."), []))


FOUND = [
    each
    for room in ROOMS
    for file in sorted((ROOT / room).rglob("*.py"))
    for each in documented(file.read_text(), str(file.relative_to(ROOT)))
]


def faults(each: Documented) -> list[str]:
    """Violated checks of numpydoc; missing parameters are one where the docstring has a section Parameters."""
    report = validate(each.name, AstValidator, ast_node=each.node, filename=ROOT / each.path, ancestry=each.ancestry)
    checks = CHECKS | ({"PR01"} if "\nParameters\n---" in each.docstring else set())
    return [f"{each}: {code} {message}" for code, message in report["errors"] if code in checks]


def opened_badly(each: Documented) -> bool:
    """Whether the docstring begins with a word of `OPENINGS`."""
    return each.docstring.partition(" ")[0].rstrip(",:") in OPENINGS


def lacks_sections(each: Documented) -> bool:
    """Whether a function is given arrays, and no section Parameters tells their shapes."""
    if not isinstance(each.node, ast.FunctionDef) or "\nParameters\n---" in each.docstring:
        return False
    arguments = [*each.node.args.posonlyargs, *each.node.args.args, *each.node.args.kwonlyargs]
    types = [ast.unparse(argument.annotation) for argument in arguments if argument.annotation]
    return any(array in kind for kind in types for array in ARRAYS)


@pytest.mark.slow
def test_public_names_have_docstrings_that_agree_with_their_signatures():
    assert len(FOUND) > 1000
    assert [fault for each in FOUND for fault in faults(each)] == []


def test_no_docstring_opens_with_a_question_word():
    assert [str(each) for each in FOUND if opened_badly(each)] == []


def test_shapes_of_arrays_stand_in_parameters():
    in_theory = [each for each in FOUND if each.path.startswith("theory/")]
    assert len(in_theory) > 300
    assert [str(each) for each in in_theory if lacks_sections(each)] == []


WRONG = '''"""A module."""

def {name}(values: Array, other: int) -> None:
    """{docstring}"""
'''
SECTION = "Do.\n\n    Parameters\n    ----------\n    {}\n    "


@pytest.mark.parametrize(
    ("docstring", "code"),
    [
        ("", "GL08"),
        (SECTION.format("values\n        n.\n    others\n        Number."), "PR02"),
        (SECTION.format("values\n        n."), "PR01"),
        (SECTION.format("other\n        Number.\n    values\n        n."), "PR03"),
        (SECTION.format("values\n        n.\n    other"), "PR07"),
        ("Do.\n\n    Returns\n    -------\n    k x n\n    ", "RT03"),
    ],
)
def test_a_wrong_docstring_is_seen(docstring, code, tmp_path):
    source = tmp_path / "wrong.py"
    source.write_text(WRONG.format(name="wrong", docstring=docstring))
    each = documented(source.read_text(), str(source))[-1]
    assert code in " ".join(faults(each))
    assert lacks_sections(each) == ("Parameters" not in docstring)


def test_private_names_need_none():
    assert [each.node.__class__.__name__ for each in documented(WRONG.format(name="_wrong", docstring=""), "a.py")] == [
        "Module"
    ]
    assert opened_badly(documented(WRONG.format(name="wrong", docstring="What it does."), "a.py")[-1])
