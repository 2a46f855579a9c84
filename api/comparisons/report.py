"""A comparison as one self-contained HTML page: tables, bars, waiting against compressing, a schedule a scenario."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from api.comparisons.gantt import gantt
from api.comparisons.schedule import SCHEDULES_MAX, schedules
from api.comparisons.summary import Summary, pareto_front, summaries
from api.comparisons.tables import Table, verdict
from api.pictures import svgs, template
from api.runs.service import Result
from station import Scenario

_COLORS = ("#2471a3", "#c0392b", "#1e8449", "#d68910", "#7d3c98", "#566573")
_MARKS = "os^Dv*Xp"
_BARS = ("t_total", "t_comp", "t_dis")


def html(scenarios: Sequence[Scenario], results: Sequence[Result], tables: Sequence[Table]) -> str:
    """The page; pictures are inline SVG, nothing is loaded from elsewhere."""
    found = summaries(scenarios, results)
    drawn = schedules(scenarios, results)
    bars, trade = svgs(lambda: _draw_bars(scenarios, found), lambda: _draw_trade(scenarios, found, results))
    return template("api.comparisons", "report.html").render(
        tables=tables,
        costs=any(scenario.station.tariff is not None for scenario in scenarios),
        verdict=verdict(scenarios, results),
        bars=bars,
        trade=trade,
        seed=results[0].seed,
        schedules=[(name, gantt(name, each)) for name, each in drawn.items()],
        undrawn=len(found) - sum(len(each) for each in drawn.values()),
        schedules_max=SCHEDULES_MAX,
        replications=1 + max(result.replication for result in results),
    )


def _names(found: Sequence[Summary]) -> list[str]:
    return list(dict.fromkeys(summary.controller for summary in found))


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


def _legend(figure: Any, names: Sequence[str]) -> None:
    from matplotlib.lines import Line2D

    looks: list[dict[str, Any]] = [
        {"marker": _MARKS[n % len(_MARKS)], "color": _COLORS[n % len(_COLORS)]} for n in range(len(names))
    ]
    marks = [Line2D([], [], linestyle="", label=name, **look) for name, look in zip(names, looks, strict=True)]
    figure.legend(handles=marks, loc="outside upper right", ncols=min(len(names), 6), frameon=False)


def _draw_bars(scenarios: Sequence[Scenario], found: Sequence[Summary]) -> Any:
    """A panel a scenario: each controller's waiting, compressor and dispenser time, with its spread."""
    names = _names(found)
    figure, axes = _panels(scenarios, 2.9)
    for axis, scenario in zip(axes, scenarios, strict=True):
        for summary in (each for each in found if each.scenario == scenario.name):
            place = names.index(summary.controller)
            offsets = [group + (place - (len(names) - 1) / 2) * 0.8 / len(names) for group in range(len(_BARS))]
            axis.bar(
                offsets, [summary.mean[figure_name] for figure_name in _BARS], 0.76 / len(names),
                color=_COLORS[place % len(_COLORS)], error_kw={"elinewidth": 0.8},
                yerr=[summary.deviation[figure_name] for figure_name in _BARS] if summary.deviation else None,
            )  # fmt: skip
        axis.set_xticks(range(len(_BARS)), _BARS)
        axis.set_ylabel("s")
        axis.set_ylim(bottom=0)
    _legend(figure, names)
    return figure


def _draw_trade(scenarios: Sequence[Scenario], found: Sequence[Summary], results: Sequence[Result]) -> Any:
    """Mean wait against compressor time with refilled buffers: a cloud of runs, the means, and their Pareto front."""
    names = _names(found)
    figure, axes = _panels(scenarios, 3.4)
    for axis, scenario in zip(axes, scenarios, strict=True):
        here = [summary for summary in found if summary.scenario == scenario.name]
        means = [(summary.mean["t_comp_restored"], summary.mean["t_avg"]) for summary in here]
        kept = pareto_front(means)
        axis.plot(
            [means[p][0] for p in kept], [means[p][1] for p in kept],
            color="#808b96", linewidth=1, linestyle="--", drawstyle="steps-post", zorder=1,
        )  # fmt: skip
        for summary, (x, y) in zip(here, means, strict=True):
            place = names.index(summary.controller)
            color, mark = _COLORS[place % len(_COLORS)], _MARKS[place % len(_MARKS)]
            runs = [r.metrics for r in results if (r.scenario, r.controller) == (scenario.name, summary.controller)]
            if len(runs) > 1:
                axis.scatter(
                    [run.t_comp_restored for run in runs], [run.t_avg for run in runs], s=8, color=color, alpha=0.3,
                    linewidths=0,
                )  # fmt: skip
            axis.scatter([x], [y], s=44, color=color, marker=mark, zorder=3)
        axis.set_xlabel("compressor time, buffers restored [s]")
        axis.set_ylabel("mean wait [s]")
        axis.grid(alpha=0.25)
    _legend(figure, names)
    return figure
