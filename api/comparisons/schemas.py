"""Comparisons as requests order them and answers show them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import BaseModel, Field

from api.comparisons.service import SAME
from api.comparisons.summary import Summary
from api.comparisons.tables import OURS, Table
from api.http.pagination import Next
from api.http.strict import Body
from api.jobs.schemas import ControllerSpec, JobStatus, status_of
from api.packing import Kept
from api.runs.schemas import Keeping
from api.scenarios.schemas import ScenarioInput, Seed
from api.store.records import Job
from controllers.registry import THESIS_CONTROLLERS
from station.metrics import UNITS, units_of
from station.whole import WHOLE

Replications = Annotated[
    int,
    Field(ge=1, description="Replications of each scenario; 0 is the pattern, later ones are drawn", examples=[1]),
    WHOLE,
]


class ComparisonRequest(Body):
    """Controllers on replications of scenarios."""

    scenarios: Annotated[
        list[ScenarioInput],
        Field(min_length=1, max_length=100, description="Names or whole scenarios", examples=[["S1", "S2"]]),
    ]
    controllers: Annotated[
        list[ControllerSpec],
        Field(
            min_length=1,
            max_length=100,
            description="Names, options behind colons",
            examples=[["logic", "minlp1:horizon=2"]],
        ),
    ] = list(THESIS_CONTROLLERS)  # noqa: RUF012  # pydantic copies it
    replications: Replications = 1
    seed: Seed = 0
    record: Keeping = Kept.NONE


class ScenarioReplications(BaseModel):
    """How often a comparison runs each controller on a scenario."""

    scenario: Annotated[str, Field(description="Name of the scenario", examples=["S1"])]
    replications: Replications
    reason: Annotated[
        str | None, Field(description="Why that is fewer than asked for; null where it is not", examples=[None])
    ] = None


class Comparison(JobStatus):
    """A comparison and how far it has come."""

    scenarios: Annotated[list[str], Field(description="Names of the scenarios", examples=[["S1", "S2"]])]
    controllers: Annotated[list[str], Field(description="Controllers", examples=[["logic", "minlp1:horizon=2"]])]
    replications: Replications
    seed: Seed
    record: Keeping
    scenario_replications: Annotated[
        list[ScenarioReplications],
        Field(
            description="Replications by scenario: one where nothing is drawn, as in a recorded day",
            examples=[[{"scenario": "S1", "replications": 10, "reason": None}]],
        ),
    ]
    runs: Annotated[int, Field(ge=1, description="Runs in all", json_schema_extra={"unit": "runs"}, examples=[16])]
    runs_done: Annotated[int, Field(ge=0, description="Runs done", json_schema_extra={"unit": "runs"}, examples=[12])]


class ComparisonPage(BaseModel):
    """Comparisons, the newest first."""

    items: Annotated[list[Comparison], Field(description="Comparisons", examples=[[]])]
    next: Next


class TableRow(BaseModel):
    """One line of a table."""

    controller: Annotated[str, Field(description="Controller; empty where the line above goes on", examples=["minlp1"])]
    origin: Annotated[str, Field(description="Whose figures", examples=["ours", "thesis"])]
    cells: Annotated[
        list[str],
        Field(
            description="A text for each heading; percentages against logic",
            examples=[["846 -20 %", "169 -20 %", "1 517 +12 %"]],
        ),
    ]


class ScenarioTable(BaseModel):
    """The table of one scenario."""

    title: Annotated[str, Field(description="Scenario and station", examples=["Table 7.4  S1: 5 vehicles in 1000 s"])]
    headings: Annotated[list[str], Field(description="Figures, with units", examples=[list(OURS.values())])]
    rows: Annotated[list[TableRow], Field(description="A line a controller and origin", examples=[[]])]


class ComparisonTable(BaseModel):
    """A comparison as tables, like `hrs compare` prints them."""

    tables: Annotated[list[ScenarioTable], Field(description="One a scenario", examples=[[]])]
    verdict: Annotated[
        str,
        Field(
            description="How close S1-S4 come to the thesis; empty for others",
            examples=["Against the thesis: 36 of 36 signs"],
        ),
    ]


class ComparisonResults(BaseModel):
    """Every run of a comparison."""

    units: Annotated[dict[str, str], Field(description="Unit of each figure", examples=[UNITS])]
    results: Annotated[
        list[dict[str, str | float | int | None]],
        Field(
            description="One a run, in the order scenarios, controllers, replications",
            examples=[[{"scenario": "S1", "controller": "logic", "replication": 0, "seed": 0, "t_total": 1054.0}]],
        ),
    ]


_UNITS = {"units": UNITS}


class ControllerFigures(BaseModel):
    """A controller's replications of one scenario, in numbers."""

    scenario: Annotated[str, Field(description="Name of the scenario", examples=["S1"])]
    controller: Annotated[str, Field(description="Controller", examples=["minlp1"])]
    runs: Annotated[int, Field(ge=1, description="Runs done", json_schema_extra={"unit": "runs"}, examples=[10])]
    mean: Annotated[
        dict[str, float | None],
        Field(
            description="Mean of each figure; null where one is not finite",
            json_schema_extra=_UNITS,
            examples=[{"t_avg": 169.2, "t_comp_restored": 1640.3}],
        ),
    ]
    deviation: Annotated[
        dict[str, float | None] | None,
        Field(
            description="Standard deviation over the replications; null for one run",
            json_schema_extra=_UNITS,
            examples=[{"t_avg": 41.0, "t_comp_restored": 120.5}],
        ),
    ]
    thesis: Annotated[
        dict[str, float],
        Field(
            description="What the thesis prints; empty where it prints nothing",
            json_schema_extra=_UNITS,
            examples=[{"t_total": 959, "t_avg": 191, "t_comp": 1995, "t_dis": 1729}],
        ),
    ]


class ComparisonFigures(BaseModel):
    """A comparison in numbers."""

    units: Annotated[dict[str, str], Field(description="Unit of each figure", examples=[UNITS])]
    items: Annotated[list[ControllerFigures], Field(description="One a scenario and controller", examples=[[]])]


def comparison_of(job: Job) -> Comparison:
    """A stored comparison as answers show it."""
    about, wanted = job.summary, job.summary["replications"]
    each = about.get("scenario_replications", [wanted] * len(about["scenarios"]))  # jobs of older versions have none
    return Comparison(
        **status_of(job),
        scenarios=about["scenarios"],
        controllers=about["controllers"],
        replications=about["replications"],
        seed=about["seed"],
        record=Kept(about.get("record", Kept.NONE)),
        scenario_replications=[
            ScenarioReplications(scenario=name, replications=count, reason=SAME if count < wanted else None)
            for name, count in zip(about["scenarios"], each, strict=True)
        ],
        runs=job.runs,
        runs_done=job.runs_done,
    )


def table_of(found: list[Table], verdict: str) -> ComparisonTable:
    """Tables as answers show them."""
    tables: list[dict[str, Any]] = [
        {
            "title": table.title,
            "headings": list(table.headings),
            "rows": [
                {"controller": row.controller, "origin": row.origin, "cells": list(row.cells)} for row in table.rows
            ],
        }
        for table in found
    ]
    return ComparisonTable.model_validate({"tables": tables, "verdict": verdict})


def figures_of(found: list[Summary]) -> ComparisonFigures:
    """Means and spreads as answers show them."""
    items = [
        ControllerFigures(
            scenario=item.scenario,
            controller=item.controller,
            runs=item.runs,
            mean=_finite(item.mean),
            deviation=_finite(item.deviation) if item.deviation else None,
            thesis=dict(item.thesis),
        )
        for item in found
    ]
    return ComparisonFigures(units=units_of(item.mean for item in found), items=items)


def _finite(figures: Mapping[str, float]) -> dict[str, float | None]:
    return {name: value if math.isfinite(value) else None for name, value in figures.items()}
