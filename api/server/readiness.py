"""Whether the service can do its work: each thing it depends on, by name."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping

from api.looks import Look

log = logging.getLogger(__name__)

KEPT_S = 0.5
"""Checks are done again after this long [s]: `/readyz` is open to all, and asks the database."""

PATIENCE_S = 2.0
"""A check that has not answered by then counts as failed [s]; probes wait longer."""


class Readiness:
    """Looks after the things the service depends on: one look at a time, however many ask.

    Parameters
    ----------
    checks
        What to call for each thing: it returns why that fails, or an empty text, and raises if it cannot say. Reasons
        are shown to anybody, so they name no address.
    """

    def __init__(self, checks: Mapping[str, Callable[[], str]]) -> None:
        self._checks = checks
        self._look = Look(self._all, "readiness", KEPT_S)
        self._at = next(iter(checks), "")

    def failures(self) -> Mapping[str, str]:
        """The checks that fail, and why; blocks at most `PATIENCE_S`."""
        found = self._look.found(PATIENCE_S)
        return {self._at: f"does not answer within {PATIENCE_S:g} s"} if found is None else found

    def _all(self) -> dict[str, str]:
        found = {}
        for name, check in self._checks.items():
            self._at = name
            try:
                reason = check()
            except Exception as error:  # noqa: BLE001  # whatever it is, it is not ready
                log.warning("not ready: %s: %s", name, error)
                reason = "does not answer"
            if reason:
                found[name] = reason
        return found

    @property
    def names(self) -> list[str]:
        """The names of the checks."""
        return list(self._checks)
