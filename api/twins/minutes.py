"""Old samples thinned to minutes: of each column its mean, its least and its most figure; frequent events forgotten."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from functools import cache

import numpy as np

from api.http.timeseries import Fold
from api.packing import names_of, plain, unpacked
from api.store.records import Superseded
from api.store.twins import TwinRepository
from api.twins.messages import COLUMNS, EventKind
from api.twins.segments import SENT, history_columns, stored_columns

MINUTE_S = 60.0
"""The span of a row of a thinned history [s]."""

SEGMENTS = 64
"""Segments thinned at once: half a day of seconds, whose minutes are one file."""

FREQUENT = (EventKind.VALVE_CHANGE, EventKind.SHIELD_REFUSAL)
"""Kinds of events that minutes do not need: nearly all of a day's events, and samples told the same."""

EVENTS = 2000
"""Events looked at in one transaction."""

RESOLUTION = "resolution"
"""Column that says what each row of a history stands for: 1 s, or a minute."""


@cache
def asked_columns(layout: str) -> dict[str, str]:
    """Name and unit of every column that a history may be asked for."""
    return {**history_columns(layout), RESOLUTION: "s"}


_STAMPS = ("time", SENT)
"""Columns of which a minute has its first figure."""

_MEAN, _LEAST, _MOST = "", " least", " most"


def thinned(columns: dict[str, np.ndarray]) -> bytes:
    """Columns of a history, a row a second, as minutes in a Parquet file; NaN counts where a minute has no other."""
    time = columns["time"]
    begins = np.flatnonzero(np.diff(np.floor(time / MINUTE_S), prepend=-1.0))
    found = {name: columns[name][begins] for name in _STAMPS}
    for name, column in columns.items():
        if name not in _STAMPS:
            figures = column.astype(np.float64)
            there = np.add.reduceat(~np.isnan(figures), begins)
            total = np.add.reduceat(np.nan_to_num(figures, nan=0.0), begins)
            found[name + _MEAN] = np.divide(total, there, out=np.full(len(begins), np.nan), where=there > 0)
            found[name + _LEAST] = np.fmin.reduceat(figures, begins)
            found[name + _MOST] = np.fmax.reduceat(figures, begins)
    return plain(found)


def thin(store: TwinRepository, before: float) -> int:
    """Thin what was stored before this Unix time [s]; how many samples that were."""
    done = 0
    while found := store.to_thin(before, SEGMENTS):
        twin, epoch, first, _, _, _ = found[0]
        there = [name for *_, blob in found for name in names_of(blob)]
        names = tuple(dict.fromkeys((*(name for name in COLUMNS if name in there), *there, SENT)))
        stored = [stored_columns(blob, names) for *_, blob in found]
        columns = {name: np.concatenate([part[name] for part in stored]) for name in names}
        rows = sum(row[3] for row in found)
        with suppress(Superseded):  # the twin was forgotten meanwhile
            store.thin(twin, epoch, first, rows, max(row[4] for row in found), thinned(columns))
        done += rows
    return done


def thin_events(store: TwinRepository, before: float) -> int:
    """Forget events of the FREQUENT kinds that were stored before this Unix time [s]; how many there were."""
    done = 0
    for twin in store.states():
        looked = -1, 0
        while found := store.thin_events(twin, FREQUENT, before, looked[0], EVENTS):
            looked = found
            done += found[1]
    return done


def minutes(content: bytes, wanted: Sequence[str], fold: Fold, first: int, last: int) -> dict[str, np.ndarray]:
    """The wanted columns of a file that `thinned` made, of minutes that begin between two seconds.

    A minute is a row of means; with `Fold.EXTREMES` it is two rows, the least and the most. NaN where an older version
    did not keep a column.
    """
    asked = [name for name in wanted if name != RESOLUTION]
    suffixes = (_LEAST, _MOST) if fold is Fold.MIN_MAX else (_MEAN,)
    names = [name + suffix for name in asked for suffix in (("",) if name in _STAMPS else suffixes)]
    table = unpacked(content, tuple(dict.fromkeys(("time", *names))))
    chosen = (table["time"] >= first) & (table["time"] <= last)
    table = {name: column[chosen] for name, column in table.items()}
    table[RESOLUTION] = np.full(int(chosen.sum()), MINUTE_S)
    none = np.full(int(chosen.sum()), np.nan)
    found = {}
    for name in wanted:
        parts = [table.get(name if name in (*_STAMPS, RESOLUTION) else name + suffix, none) for suffix in suffixes]
        found[name] = np.column_stack(parts).ravel()
    if fold is Fold.MIN_MAX:
        found["time"] = found["time"] + np.tile((0.0, MINUTE_S / 2), int(chosen.sum()))
    return found
