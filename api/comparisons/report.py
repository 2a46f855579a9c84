"""A comparison as one self-contained HTML page: tables, bars, and the trade of waiting against compressing."""

from __future__ import annotations

import io
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from typing import Any

import jinja2
from markupsafe import Markup

from api.comparisons.tables import OURS, Table, verdict
from api.runs.service import Result
from station import Scenario

_COLORS = ("#2471a3", "#c0392b", "#1e8449", "#d68910", "#7d3c98", "#566573")
_BARS = ("t_total", "t_comp", "t_dis")


def html(scenarios: Sequence[Scenario], results: Sequence[Result], tables: Sequence[Table]) -> str:
    """The page; pictures are inline SVG, nothing is loaded from elsewhere."""
    return _template().render(
        tables=tables,
        headings=list(OURS.values()),
        verdict=verdict(results),
        bars=_svg(_draw_bars(scenarios, results)),
        trade=_svg(_draw_trade(scenarios, results)),
        seed=results[0].seed,
        replications=1 + max(result.replication for result in results),
    )


@cache
def _template() -> jinja2.Template:
    text = (files("api.comparisons") / "templates" / "report.html").read_text()
    return jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True).from_string(text)


def _svg(figure: Any) -> Markup:
    """The figure as an SVG element; the same figure gives the same text."""
    import matplotlib as mpl

    stream = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": "hrs-twin"}):
        figure.savefig(stream, format="svg", metadata={"Date": None})
    text = stream.getvalue()
    return Markup(text[text.index("<svg") :])  # noqa: S704  # our own drawing, labels escaped by matplotlib


def _mean(results: Sequence[Result], scenario: str, controller: str, figure: str) -> float:
    values = [r.metrics[figure] for r in results if r.scenario == scenario and r.controller == controller]
    return sum(values) / len(values)


def _names(results: Sequence[Result]) -> list[str]:
    return list(dict.fromkeys(result.controller for result in results))


def _panels(scenarios: Sequence[Scenario], height: float) -> tuple[Any, list[Any]]:
    """A figure with a titled panel a scenario, two in a row of `height` inches."""
    from matplotlib.figure import Figure

    lines = (len(scenarios) + 1) // 2
    figure = Figure(figsize=(11, height * lines), layout="constrained")
    axes = list(figure.subplots(lines, 2, squeeze=False).ravel())
    for axis, scenario in zip(axes, scenarios, strict=False):
        axis.set_title(scenario.name, loc="left", weight="bold")
        axis.spines[["top", "right"]].set_visible(False)
    for axis in axes[len(scenarios) :]:
        axis.set_visible(False)
    return figure, axes[: len(scenarios)]


def _draw_bars(scenarios: Sequence[Scenario], results: Sequence[Result]) -> Any:
    """A panel a scenario: each controller's waiting, compressor and dispenser time."""
    names = _names(results)
    figure, axes = _panels(scenarios, 2.9)
    for axis, scenario in zip(axes, scenarios, strict=True):
        for place, name in enumerate(names):
            values = [_mean(results, scenario.name, name, figure_name) for figure_name in _BARS]
            offsets = [group + (place - (len(names) - 1) / 2) * 0.8 / len(names) for group in range(len(_BARS))]
            axis.bar(offsets, values, 0.76 / len(names), color=_COLORS[place % len(_COLORS)], label=name)
        axis.set_xticks(range(len(_BARS)), _BARS)
        axis.set_ylabel("s")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper right", ncols=len(names), frameon=False)
    return figure


def _draw_trade(scenarios: Sequence[Scenario], results: Sequence[Result]) -> Any:
    """Mean wait against compressor time with refilled buffers, a point a run, relative to the scenario."""
    names = _names(results)
    figure, axes = _panels(scenarios, 3.4)
    for axis, scenario in zip(axes, scenarios, strict=True):
        for place, name in enumerate(names):
            runs = [r for r in results if r.scenario == scenario.name and r.controller == name]
            axis.scatter(
                [run.metrics.t_comp_restored for run in runs], [run.metrics.t_avg for run in runs],
                s=36 if len(runs) == 1 else 12, color=_COLORS[place % len(_COLORS)], label=name, alpha=0.8,
            )  # fmt: skip
        axis.set_xlabel("compressor time, buffers restored [s]")
        axis.set_ylabel("mean wait [s]")
        axis.grid(alpha=0.25)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper right", ncols=len(names), frameon=False)
    return figure
