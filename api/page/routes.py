"""GET / and its files, and /docs: nothing is loaded from elsewhere, no script stands in the page."""

from __future__ import annotations

import base64
import hashlib
import re
import threading
from functools import cache
from importlib.resources import files

from fastapi import APIRouter, FastAPI
from fastapi.openapi.docs import get_swagger_ui_html
from starlette.datastructures import Headers
from starlette.responses import HTMLResponse, Response
from starlette.staticfiles import NotModifiedResponse, StaticFiles
from starlette.types import Scope

from api.page import limit_words
from controllers.registry import load_all

_POLICY = "default-src 'self'; style-src 'self'; img-src 'self' data:; frame-ancestors 'none'; base-uri 'none'"

_DOCS_POLICY = (
    "default-src 'self'; script-src 'self' 'sha256-{}'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; "
    "frame-ancestors 'none'; base-uri 'none'"
)
"""Of the documentation, whose one script is named by its digest; Swagger UI sets styles by itself."""

_SCRIPT = re.compile(rb"<script>(.*?)</script>", re.DOTALL)

_READ = ["GET", "HEAD"]
"""A GET route of the framework answers no HEAD; files do, and the server leaves the body out."""

router = APIRouter(include_in_schema=False)


@router.api_route("/", methods=_READ)
def page() -> Response:
    """The page; what its views will ask about controllers is loaded meanwhile."""
    _load_controllers()
    content = (files("api.page") / "static" / "index.html").read_text(encoding="utf-8")
    return HTMLResponse(content, headers={"Content-Security-Policy": _POLICY})


@cache
def _load_controllers() -> None:
    """In the background, once a process."""
    threading.Thread(target=load_all, name="controllers", daemon=True).start()


@router.api_route("/docs", methods=_READ)
def documentation() -> HTMLResponse:
    """The API's documentation to try out; Swagger UI's files come with fastapi-offline."""
    shown = get_swagger_ui_html(
        openapi_url="/openapi.json",
        title="hrs-twin API",
        swagger_js_url="/static/docs/swagger-ui-bundle.js",
        swagger_css_url="/static/docs/swagger-ui.css",
        swagger_favicon_url="/static/icon.svg",
    )
    [script] = _SCRIPT.findall(shown.body)
    digest = base64.b64encode(hashlib.sha256(script).digest()).decode()
    shown.headers["Content-Security-Policy"] = _DOCS_POLICY.format(digest)
    return shown


class _PageFiles(StaticFiles):
    """The files of the page, with the module that is made of the registry of limits."""

    async def get_response(self, path: str, scope: Scope) -> Response:
        if path != limit_words.PLACE or scope["method"] not in _READ:
            return await super().get_response(path, scope)
        answer = limit_words.limit_words_response()
        held = self.is_not_modified(answer.headers, Headers(scope=scope))
        return NotModifiedResponse(answer.headers) if held else answer


def install(app: FastAPI) -> None:
    """Serve the page, its files and the documentation."""
    app.include_router(router)
    app.mount("/static/docs", StaticFiles(packages=[("fastapi_offline", "static")]), name="docs")
    app.mount("/static", _PageFiles(packages=[("api.page", "static")]), name="static")
