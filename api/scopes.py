"""Scopes of keys."""

from __future__ import annotations

from collections.abc import Collection
from enum import StrEnum


class Scope(StrEnum):
    """The scope of a key; each but the first includes reading."""

    READ = "read"  # look, and ask what changes nothing
    RUN = "run"  # runs, comparisons, certificates, calibrations
    OPERATE = "operate"  # live twins
    MEASURE = "measure"  # measurements to live twins
    ADMIN = "admin"  # everything, keys too


USUAL = (Scope.READ, Scope.RUN, Scope.OPERATE)
"""Of a key that is made without saying."""


def allows(held: Collection[str], scope: Scope) -> bool:
    """Whether a key with these scopes may do what needs `scope`."""
    return Scope.ADMIN in held or scope in held or (scope is Scope.READ and bool(held))
