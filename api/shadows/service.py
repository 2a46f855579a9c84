"""Shadows of the twins of a server: stretches that are over become jobs, and their results sums by day."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from api.jobs.schemas import JobProblem
from api.shadows.schemas import ShadowDay, ShadowRun, ShadowStretch, ShadowSum, TwinShadow
from api.store.jobs import JobRepository
from api.store.records import Job, JobKind
from api.twins.days import DAY_S
from api.twins.service import Twins

KEPT_MAX = 700
"""Stretches of a twin that are kept: a week, where one begins each quarter of an hour."""

_ALMOST_NONE = 0.005
"""A smaller difference of vehicles would be told as 0."""


def shadow_of(twins: Twins, jobs: JobRepository, twin_id: str, limit: int) -> TwinShadow:
    """The shadows of a twin, with at most `limit` of their stretches; a problem if there is no such twin."""
    settings, created = twins.shadow_settings(twin_id), twins.created(twin_id)
    stretches = _stretches(jobs, twin_id, created)
    live = twins.live(twin_id)
    return TwinShadow(
        twin=twin_id,
        settings=settings,
        lasting=0 if live is None else len(live.shadow.lasting) + len(live.shadow.due),
        left_out=0 if live is None else live.shadow.left_out,
        days=list(_days(stretches)),
        stretches=[shown for _, shown in stretches[:limit]],
    )


def _stretches(jobs: JobRepository, twin_id: str, created: float) -> list[tuple[Job, ShadowStretch]]:
    """The stretches of a twin started then, the newest first; of one that was run twice, the later."""
    found = {
        job.summary["begin_s"]: job
        for job in reversed(jobs.of_twin(JobKind.SHADOW, twin_id, KEPT_MAX))
        if job.created >= created  # else of another twin of that name
    }
    rows = jobs.results_of([job.id for job in found.values()])
    ordered = sorted(found.items(), reverse=True)
    return [(job, _shown(job, rows.get(job.id, ()))) for _, job in ordered]


def _shown(job: Job, rows: Sequence[dict[str, Any]]) -> ShadowStretch:
    about = job.summary
    return ShadowStretch(
        from_s=about["begin_s"], to_s=about["begin_s"] + about["horizon_s"], state=job.state,
        problem=None if job.error is None else JobProblem.model_validate(job.error), acted=about["acted"],
        changed=about["changed"], error_bar=rows[0]["error_bar"] if rows else None, runs=[_run(row) for row in rows],
    )  # fmt: skip


def _run(row: dict[str, Any]) -> ShadowRun:
    figures = row["figures"]
    counts = {name: int(figures[name]) for name in ("vehicles", "served", "incomplete", "waiting")}
    return ShadowRun(
        controller=row["controller"], wait_s=figures["wait"], energy_kwh=figures["energy"], cost_eur=figures["cost"],
        score_eur=row["score"], **counts,
    )  # fmt: skip


def _days(stretches: Sequence[tuple[Job, ShadowStretch]]) -> Iterator[ShadowDay]:
    """Sums by day, the newest first."""
    days: dict[int, dict[str, list[tuple[float, ShadowRun, ShadowRun]]]] = {}
    for job, stretch in stretches:
        if not stretch.runs:
            continue
        part = min(1.0, job.summary["every_s"] / job.summary["horizon_s"])  # else a second would count several times
        of_day = days.setdefault(stretch.from_s // DAY_S, {})
        for run in stretch.runs[1:]:
            of_day.setdefault(run.controller, []).append((part, stretch.runs[0], run))
    for day, of_day in days.items():
        sums = [_sum(name, pairs) for name, pairs in of_day.items()]
        yield ShadowDay(day=day, sums=sorted(sums, key=lambda each: -each.saves_score_eur))


def _sum(controller: str, pairs: Sequence[tuple[float, ShadowRun, ShadowRun]]) -> ShadowSum:
    """What a controller would have made of stretches, each with the part that counts, who acted and itself."""
    costs = [
        part * (acting.cost_eur - run.cost_eur)
        for part, acting, run in pairs
        if acting.cost_eur is not None and run.cost_eur is not None
    ]
    saves = sum(costs) if len(costs) == len(pairs) else None
    vehicles = sum(part * acting.vehicles for part, acting, _ in pairs)
    waited = sum(part * (run.wait_s * run.vehicles - acting.wait_s * acting.vehicles) for part, acting, run in pairs)
    against = list(dict.fromkeys(acting.controller for _, acting, _ in reversed(pairs)))
    better = sum(run.score_eur < acting.score_eur for _, acting, run in pairs)
    waits = waited / vehicles if vehicles else 0.0
    loses = sum(part * (run.incomplete - acting.incomplete) for part, acting, run in pairs)
    return ShadowSum(
        controller=controller,
        against=against,
        stretches=len(pairs),
        better=better,
        saves_eur=saves,
        saves_score_eur=sum(part * (acting.score_eur - run.score_eur) for part, acting, run in pairs),
        waits_s=waits,
        loses=loses,
        words=f"{controller} would have {_words(saves, waits, loses)} than {', '.join(against)}; "
        f"better in {better} of {len(pairs)} stretches",
    )


def _words(saves: float | None, waits: float, loses: float) -> str:
    cost = "" if saves is None else f"cost {abs(saves):.2f} EUR {'less' if saves >= 0 else 'more'} and "
    waiting = f"{abs(waits):.0f} s {'more' if waits >= 0 else 'less'} of waiting a vehicle"
    left = f", with {abs(loses):.2f} {'more' if loses > 0 else 'fewer'} vehicles that leave before they are full,"
    return f"{cost or 'had '}{waiting}{'' if abs(loses) < _ALMOST_NONE else left}"
