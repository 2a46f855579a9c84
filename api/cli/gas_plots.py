"""Pictures of the real-gas model: one fill, and a measured case beside the model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from station.geometry import KELVIN
from station.plants.real_gas.catalog import TEMPERATURE_LIMIT
from station.plants.real_gas.comparison import Comparison
from station.plants.real_gas.fill import Fill

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_BAR = 1e5
_GAS, _WALL, _OUTER, _FLOW = "#c0392b", "#d68910", "#566573", "#1e8449"


def plot_fill(found: Fill, path: Path) -> None:
    """Draw a fill: pressure, temperatures of gas and wall, flow, state of charge."""
    figure, axes = _figure(f"{found.kind.name}, {found.dispenser.ramp * 60e-6:.3g} MPa/min", 4)
    axes[0].plot(found.time, found.pressure / _BAR, color="#2471a3")
    axes[0].set_ylabel("pressure [bar]")
    lines = (
        (found.temperature, _GAS, "gas"),
        (found.surface, _WALL, "wall inside"),
        (found.outer, _OUTER, "wall outside"),
    )
    for values, color, label in lines:
        axes[1].plot(found.time, values - KELVIN, color=color, label=label)
    axes[1].axhline(TEMPERATURE_LIMIT - KELVIN, color=_GAS, linestyle=":", linewidth=0.9)
    axes[1].set_ylabel("temperature [°C]")
    axes[1].legend(loc="lower right", frameon=False)
    axes[2].step(found.time, found.flow * 1e3, where="post", color=_FLOW)
    axes[2].set_ylabel("flow [g/s]")
    axes[3].plot(found.time, 100 * found.state_of_charge, color="#7d3c98")
    axes[3].set_ylabel("state of charge [%]")
    figure.savefig(path, dpi=110)


def plot_case(found: Comparison, path: Path) -> None:
    """Draw a measured case: lines are the model, points what was measured."""
    measured, model = found.case.measured, found.model
    figure, axes = _figure(found.case.case, 2)
    axes[0].plot(model.time, model.pressure / _BAR, color="#2471a3", label="model")
    if "pressure_MPa" in measured:
        series = measured["pressure_MPa"]
        axes[0].plot(series.time_s, np.array(series.value) * 10, "o", color="#2471a3", markersize=4, label="measured")
    axes[0].set_ylabel("pressure [bar]")
    axes[0].legend(frameon=False)
    axes[1].plot(model.time, model.temperature - KELVIN, color=_GAS, label="gas, model")
    axes[1].plot(model.time, model.surface - KELVIN, color=_WALL, label="wall inside, model")
    axes[1].plot(model.time, model.outer - KELVIN, color=_OUTER, label="wall outside, model")
    for name, marker in zip(sorted(measured), "o^vsDPX*<>" * len(measured), strict=False):
        if name.endswith("_temperature_K"):
            series, color = measured[name], _GAS if name.startswith("gas") else _OUTER
            label = name.removesuffix("_temperature_K").replace("_", " ") + ", measured"
            axes[1].plot(series.time_s, np.array(series.value) - KELVIN, marker, color=color, markersize=4, label=label)
    axes[1].set_ylabel("temperature [°C]")
    axes[1].legend(frameon=False, fontsize=8)
    figure.savefig(path, dpi=110)


def _figure(title: str, rows: int) -> tuple[Any, list[Axes]]:
    """An empty figure of rows that share the time."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 2.6 * rows + 1), layout="constrained")
    figure.suptitle(title, fontsize=13, weight="bold")
    axes = list(figure.subplots(rows, 1, sharex=True))
    axes[-1].set_xlabel("time [s]")
    for axis in axes:
        axis.grid(alpha=0.25)
        axis.set_axisbelow(True)
        axis.spines[["top", "right"]].set_visible(False)
    return figure, axes
