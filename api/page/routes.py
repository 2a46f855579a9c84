"""GET / and its files, and /docs: nothing is loaded from elsewhere, no script stands in the page."""

from __future__ import annotations

import threading
from functools import cache
from importlib.resources import files

from fastapi import APIRouter, FastAPI
from fastapi.openapi.docs import get_swagger_ui_html
from starlette.responses import HTMLResponse, Response
from starlette.staticfiles import StaticFiles

from controllers.registry import load_all

_POLICY = "default-src 'self'; style-src 'self'; img-src 'self' data:; frame-ancestors 'none'; base-uri 'none'"

router = APIRouter(include_in_schema=False)


@router.get("/")
def page() -> Response:
    """The page; what its views will ask about controllers is loaded meanwhile."""
    _load_controllers()
    content = (files("api.page") / "static" / "index.html").read_text(encoding="utf-8")
    return HTMLResponse(content, headers={"Content-Security-Policy": _POLICY, "X-Content-Type-Options": "nosniff"})


@cache
def _load_controllers() -> None:
    """In the background, once a process."""
    threading.Thread(target=load_all, name="controllers", daemon=True).start()


@router.get("/docs")
def documentation() -> HTMLResponse:
    """The API's documentation to try out; Swagger UI's files come with fastapi-offline."""
    return get_swagger_ui_html(
        openapi_url="/openapi.json",
        title="hrs-twin API",
        swagger_js_url="/static/docs/swagger-ui-bundle.js",
        swagger_css_url="/static/docs/swagger-ui.css",
        swagger_favicon_url="/static/icon.svg",
    )


def install(app: FastAPI) -> None:
    """Serve the page, its files and the documentation."""
    app.include_router(router)
    app.mount("/static/docs", StaticFiles(packages=[("fastapi_offline", "static")]), name="docs")
    app.mount("/static", StaticFiles(packages=[("api.page", "static")]), name="static")
