"""Everything that is wrong with a service, by every check there is."""

from __future__ import annotations

from tests.nemesis.checker import Evidence, acknowledged, chunks, gaps, once, replay, results, streamed, told
from tests.nemesis.commanded import announced, obeyed, vehicles
from tests.nemesis.history import History

CHECKS = (
    acknowledged, once, results, chunks, vehicles, obeyed, announced, replay, gaps, told, streamed,
)  # fmt: skip


def verdict(history: History, evidence: Evidence) -> list[str]:
    """What each check finds, and what is wrong with the service and its store."""
    wrong = [problem for check in CHECKS for problem in check(history, evidence)]
    return wrong + [f"{what}: {problem}" for what, problem in evidence.service.items() if problem]
