"""A picture of a run: pressures, temperatures, flows, valves and queue over time."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from station import InputError, Record
from station.geometry import BUFFERS, VALVES

FORMATS = (".png", ".svg", ".pdf")

_LONG_S = 7200
"""From here on time is told in hours [s]."""

_COLORS = {"high": "#c0392b", "medium": "#d68910", "low": "#2471a3", "vehicle": "#1e8449"}


def check_format(path: Path) -> None:
    """Raise InputError unless the file name asks for a picture we draw."""
    if path.suffix.lower() not in FORMATS:
        raise InputError("plot", [(str(path), f"must end in {', '.join(FORMATS)}")])


class Columns(Protocol):
    """Columns of a record, or of part of one, by name."""

    def __getitem__(self, column: str) -> NDArray[Any]:
        """The column of that name, one entry a row."""


def plot_run(record: Record, path: Path) -> None:
    """Draw `record` into `path`."""
    figure = draw(record)
    figure.suptitle(
        f"{record.scenario.name} at {record.scenario.station.name}: {record.controller}", fontsize=14, weight="bold"
    )
    figure.savefig(path, dpi=110)


def draw(record: Columns, size: tuple[float, float] = (12, 11), *, with_queue: bool = True) -> Any:
    """A Matplotlib figure of `size` inches: pressures, temperatures, flows, valves and, if wanted, the queue."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    heights = [3, 2, 2, 2, 1] if with_queue else [3, 2, 2, 2]
    axes = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights)
    long = record["time"][-1] - record["time"][0] > _LONG_S
    time = record["time"] / (3600 if long else 1)
    tanks = (*BUFFERS, "vehicle")
    for tank in tanks:
        axes[0].plot(time, record[f"pressure_{tank}"], color=_COLORS[tank], label=tank, linewidth=1.1)
        axes[1].plot(time, record[f"temperature_{tank}"], color=_COLORS[tank], linewidth=1.1)
    axes[0].set_ylabel("pressure [bar]")
    axes[0].legend(ncols=4, loc="upper center", bbox_to_anchor=(0.5, 1.16), frameon=False)
    axes[1].set_ylabel("temperature [°C]")
    axes[2].step(
        time, record["flow_dispenser"], where="post", color=_COLORS["vehicle"], linewidth=0.9, label="dispenser"
    )
    axes[2].step(time, record["flow_compressor"], where="post", color="#7d3c98", linewidth=0.9, label="compressor")
    axes[2].set_ylabel("flow [g/s]")
    axes[2].legend(ncols=2, loc="lower right", bbox_to_anchor=(1, 0.94), frameon=False)
    for place, valve in enumerate(reversed(VALVES)):
        axes[3].fill_between(
            time, place + 0.1, place + 0.1 + 0.8 * record[valve], step="post", linewidth=0,
            color=_COLORS[valve.rpartition("_")[2]],
        )  # fmt: skip
    axes[3].set_yticks(np.arange(len(VALVES)) + 0.5, [valve.replace("_", " ") for valve in reversed(VALVES)])
    axes[3].set_ylim(0, len(VALVES))
    if with_queue:
        axes[4].fill_between(time, record["queue_length"], step="post", color="#566573", linewidth=0)
        axes[4].set_ylabel("queue")
        axes[4].set_ylim(0, max(1, int(record["queue_length"].max())) * 1.1)
    axes[-1].set_xlabel("time [h]" if long else "time [s]")
    for axis in axes:
        axis.grid(alpha=0.25)
        axis.set_axisbelow(True)
        axis.spines[["top", "right"]].set_visible(False)
    return figure
