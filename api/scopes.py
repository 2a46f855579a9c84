"""Scopes of keys, and the scope that each request needs."""

from __future__ import annotations

from collections.abc import Collection
from enum import StrEnum


class Scope(StrEnum):
    """The scope of a key; each but the first includes reading."""

    READ = "read"  # look, and ask what changes nothing
    RUN = "run"  # runs, comparisons, certificates
    OPERATE = "operate"  # live twins
    ADMIN = "admin"  # everything, keys too


USUAL = (Scope.READ, Scope.RUN, Scope.OPERATE)
"""Of a key that is made without saying."""

ASKING = ("/v1/scenarios/", "/v1/certificates/verify")
"""A POST below these changes nothing."""


def needed(method: str, path: str) -> Scope:
    """The scope of a request."""
    if path == "/v1/keys" or path.startswith("/v1/keys/"):
        return Scope.ADMIN
    if method in {"GET", "HEAD", "OPTIONS"} or (method == "POST" and path.startswith(ASKING)):
        return Scope.READ
    return Scope.OPERATE if path == "/v1/twins" or path.startswith("/v1/twins/") else Scope.RUN


def allows(held: Collection[str], scope: Scope) -> bool:
    """Whether a key with these scopes may do what needs `scope`."""
    return Scope.ADMIN in held or scope in held or (scope is Scope.READ and bool(held))
