"""Requests that another web page has a browser send, recognised by Fetch metadata and Origin."""

from __future__ import annotations

from collections.abc import Collection
from http import HTTPStatus

from starlette.datastructures import Headers

from api.http.problems import ProblemError

SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})
"""Methods that change nothing and start nothing."""

_OWN_SITES = frozenset({"same-origin", "none"})
"""Values of Sec-Fetch-Site of the page itself, and of an address the user entered."""

_DEFAULT_PORTS = {"http": ":80", "https": ":443"}

ISOLATION = (
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"referrer-policy", b"same-origin"),
    (b"x-content-type-options", b"nosniff"),
    (b"content-security-policy", b"default-src 'none'; frame-ancestors 'none'"),
)
"""Headers of every answer that does not set its own: no other page embeds, frames or reads it."""


def isolated(headers: list[tuple[bytes, bytes]]) -> list[tuple[bytes, bytes]]:
    """Response headers with those of `ISOLATION` that are not among them."""
    given = {name.lower() for name, _ in headers}
    return [*headers, *(header for header in ISOLATION if header[0] not in given)]


def check_origin(method: str, headers: Headers, allowed: Collection[str]) -> None:
    """Refuse a request of a foreign origin, unless it only opens an address in a window of its own.

    A browser says in Sec-Fetch-Site which relation the page that asks has to this service; older ones, and all of them
    over plain HTTP to another machine, send Origin alone. Programs send neither. Where both are sent, both must fit,
    except that a same-origin request may name an Origin that a proxy, which has replaced Host, no longer shows.

    Raises
    ------
    ProblemError
        403 `foreign-origin`.
    """
    if not is_foreign(headers, allowed) or (method in SAFE_METHODS and _opens_window(headers)):
        return
    origin = headers.get("origin") or "another origin"
    raise ProblemError(
        HTTPStatus.FORBIDDEN, "foreign-origin", "Foreign origin",
        f"a page of {origin:.100} may not use this service (setting allowed_origins)",
    )  # fmt: skip


def is_foreign(headers: Headers, allowed: Collection[str]) -> bool:
    """Whether a page of another origin has a browser send this; a program is not foreign."""
    site, origin = headers.get("sec-fetch-site"), headers.get("origin")
    if origin is not None and origin in allowed:
        return False
    if site == "same-origin":
        return False
    if site is not None and site not in _OWN_SITES:
        return True
    return origin is not None and not _is_own(origin, headers.get("host", ""))


def _is_own(origin: str, host: str) -> bool:
    """Whether an origin is this host; its scheme may differ, since a proxy may end TLS."""
    if origin.count("://") != 1:
        return False
    scheme, _, place = origin.lower().partition("://")
    port = _DEFAULT_PORTS.get(scheme)
    return port is not None and place.removesuffix(port) == host.lower().removesuffix(port)


def _opens_window(headers: Headers) -> bool:
    """Whether the user follows a link to the address: no part of another page, no prefetch, no frame."""
    return (
        headers.get("sec-fetch-mode") == "navigate"
        and headers.get("sec-fetch-dest") == "document"
        and "sec-purpose" not in headers
        and "purpose" not in headers
    )
