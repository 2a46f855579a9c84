"""A picture of a followed record: measured pressures against the model's, and the states of health."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from station.estimation.filter import STATES, Followed
from station.frames import Frames
from station.geometry import BUFFERS


def plot_followed(frames: Frames, followed: Followed, path: Path) -> None:
    """Draw pressures measured and modelled, leaks, and the factors of compressor and dispenser."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 8), layout="constrained")
    top, middle, bottom = figure.subplots(3, 1, sharex=True)
    hours = (frames.start + np.arange(len(frames))) / 3600
    for channel, name in enumerate(BUFFERS):
        measured = frames.values[:, channel]
        (line,) = top.plot(hours, measured, ".", markersize=1, alpha=0.4)
        top.plot(hours, measured - followed.errors[:, channel], linewidth=0.8, color=line.get_color(), label=name)
        middle.plot(hours, followed.states[:, STATES.index(f"leak_{name}")], linewidth=0.8, label=name)
    for name in ("compressor_factor", "dispenser_factor"):
        bottom.plot(hours, followed.states[:, STATES.index(name)], linewidth=0.8, label=name.replace("_", " "))
    top.set_ylabel("pressure [bar]\ndots measured, lines model")
    middle.set_ylabel("leak [g/s]")
    bottom.set_ylabel("factor [1]")
    bottom.set_xlabel("time [h]")
    for axes in (top, middle, bottom):
        axes.legend(loc="upper right", fontsize="small")
    figure.savefig(path, dpi=150)
