"""The benchmark behind `hrs bench`: every row in turn, the long ones left out where asked."""

from __future__ import annotations

from collections.abc import Iterator

from api.jobs.cores import cores
from benchmarks import days, decisions, scaling, shell
from benchmarks.measure import Row

_STATES = 40  # of each of three controllers; some seconds of solver time
_STATES_QUICK = 5


def rows(repeats: int, *, quick: bool) -> Iterator[Row]:
    """All rows; `quick` leaves out the first run from the shell and the scaling, and samples fewer states."""
    yield from decisions.rows(repeats, _STATES_QUICK if quick else _STATES)
    yield from days.rows(repeats)
    yield from shell.warm(max(1, repeats // 3))
    if quick:
        return
    yield from shell.first()
    if cores() >= 2:  # two workers need two cores
        yield from scaling.rows(max(1, repeats // 3))
