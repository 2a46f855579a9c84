"""Self-contained pages: templates, pictures as inline SVG, and the headers with which they go out."""

from __future__ import annotations

import io
import threading
from collections.abc import Callable
from functools import cache
from importlib.resources import files
from typing import Any

import jinja2
from markupsafe import Markup

REPORT_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; style-src 'unsafe-inline'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
}
"""A report holds its own style and pictures, and names that users gave; nothing in it is run or loaded."""

_DRAWING = threading.Lock()
"""Matplotlib's settings, which fix the names inside a picture, are those of the process."""


@cache
def template(package: str, name: str) -> jinja2.Template:
    """The template of that name in the folder `templates` of a package."""
    text = (files(package) / "templates" / name).read_text(encoding="utf-8")
    return jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True).from_string(text)


def svgs(*drawings: Callable[[], Any]) -> list[Markup]:
    """The figures that functions draw, as SVG elements; the same figure gives the same text."""
    with _DRAWING:
        return [_svg(draw()) for draw in drawings]


def _svg(figure: Any) -> Markup:
    import matplotlib as mpl  # slow to import

    stream = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": "hrs-twin"}):
        figure.savefig(stream, format="svg", metadata={"Date": None})
    text = stream.getvalue()
    return Markup(text[text.index("<svg") :])  # noqa: S704  # our own drawing, labels escaped by matplotlib
