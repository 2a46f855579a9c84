"""Whether the checker refuses a certificate that was changed, and given the checksum of what it says now."""

from __future__ import annotations

from theory import checker
from theory.checker import Refused, verify


def refused(changed):
    try:
        verify({**changed, "checksum": checker.checksum(changed)})
    except Refused:
        return True
    return False
