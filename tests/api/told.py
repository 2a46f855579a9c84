"""What a twin of a running service has told."""

from __future__ import annotations


def events(http, path):
    """Every event of a twin, in order."""
    found, behind = [], -1
    while page := http.get(f"{path}/events", params={"after": behind, "limit": 1000}).json()["items"]:
        found += page
        behind = page[-1]["seq"]
    return found
