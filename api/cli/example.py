"""Commands that run the examples of chapters 5 and 6: control without a model, and paths among obstacles."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from station import InputError

if TYPE_CHECKING:
    from theory.paths.closed_loop import Trajectory
    from theory.paths.experiments import OneStepExperiment
    from theory.tubes.experiments import EdgeExperiment, Experiment

example = typer.Typer(
    no_args_is_help=True, help="Run an example of the thesis: `dmd` (chapter 5), `paths` (chapter 6)."
)

SeedOption = Annotated[int, typer.Option(min=0, help="seed of the first run; later ones count on from it")]
RunsOption = Annotated[int, typer.Option(min=1, max=10_000, help="closed loops, a seed each")]
PlotOption = Annotated[Path | None, typer.Option(metavar="FILE.png", help="draw the first run (.png, .svg or .pdf)")]
JsonOption = Annotated[Path | None, typer.Option("--json", metavar="FILE", help="write every run as JSON")]


def _at_least_two(draws: int) -> int:
    """Draws of a study: none, or enough for a spread."""
    if draws == 1:
        raise typer.BadParameter("must be 0 or at least 2")
    return draws


class System(StrEnum):
    """Which unknown system."""

    THESIS = "thesis"
    THREE_STATES = "three-states"


class Reading(StrEnum):
    """Which reading of Sec. 6.4."""

    WORKS = "works"
    PRINTED = "printed"


@example.command()
def dmd(
    system: Annotated[System, typer.Option(help="Sec. 5.6, or three states and two inputs")] = System.THESIS,
    runs: RunsOption = 1,
    seed: SeedOption = 0,
    edge: Annotated[
        int, typer.Option(min=0, max=1000, help="starts at the edge of the region of attraction, beside a known model")
    ] = 0,
    plot: PlotOption = None,
    json_file: JsonOption = None,
) -> None:
    """Learn an unknown system, then control it with its limits kept (Algorithm 1)."""
    from api.cli.console import progress_bar
    from api.cli.example_reports import format_dmd, format_edge
    from api.files import write_json
    from theory.tubes.examples import unknown
    from theory.tubes.experiments import run_edge_experiments, run_experiment

    _check(plot, json_file)
    chosen = unknown("dmd" if system is System.THESIS else "dmd_three_states")
    found = []
    with progress_bar("runs") as progress:
        for i in range(runs):
            found.append(run_experiment(chosen, seed + i))
            progress(i + 1, runs)
    typer.echo("\n".join(format_dmd(found)))
    starts: list[EdgeExperiment] = []
    if edge:
        with progress_bar("starts") as progress:
            starts = run_edge_experiments(found[0], edge, seed=seed, progress=progress)
        typer.echo("\n".join(format_edge(starts)))
    if plot:
        from api.cli.example_plots import plot_dmd

        with _writing(plot):
            plot_dmd(found[0], plot)
    if json_file:
        document = {"runs": [_dmd_document(item, seed + i) for i, item in enumerate(found)]}
        if starts:
            document["edge"] = [{"start": list(item.start), "excess": item.excess} for item in starts]
        write_json(json_file, document)


@example.command()
def paths(
    reading: Annotated[Reading, typer.Option(help="the one that works, or Sec. 6.4 as printed")] = Reading.WORKS,
    runs: RunsOption = 1,
    seed: SeedOption = 0,
    scenarios: Annotated[int, typer.Option(min=1, max=1000, help="futures drawn a decision, S")] = 19,
    remove: Annotated[int, typer.Option(min=0, max=20, help="scenarios given up a decision, R (Remark 6.5)")] = 0,
    one_step: Annotated[
        int,
        typer.Option(
            metavar="DRAWS",
            min=0,
            max=10_000,
            callback=_at_least_two,
            help="decisions from one state at a limit (Fig. 6.3)",
        ),
    ] = 0,
    choice: Annotated[
        int,
        typer.Option(
            metavar="DRAWS", min=0, max=100_000, callback=_at_least_two, help="decisions among 2, 4, 8 and 16 paths"
        ),
    ] = 0,
    plot: PlotOption = None,
    json_file: JsonOption = None,
    *,
    between_samples: Annotated[
        bool, typer.Option("--between-samples", help="keep the distance between samples, too")
    ] = False,
) -> None:
    """Steer a vehicle among obstacles with a stated probability of keeping its distance (Algorithm 2)."""
    from api.cli.console import progress_bar
    from api.cli.example_reports import format_choice, format_one_step, format_paths
    from api.files import write_json
    from theory.paths.closed_loop import simulate_mission
    from theory.paths.examples import mission
    from theory.paths.experiments import at_the_limit, many_paths

    _check(plot, json_file)
    name = "paths" if reading is Reading.WORKS else "paths_printed"
    chosen, start = mission(name, scenarios=scenarios, removed=remove, between_samples=between_samples)
    found = []
    with progress_bar("runs") as progress:
        for i in range(runs):
            found.append(simulate_mission(chosen, start, seed + i))
            progress(i + 1, runs)
    typer.echo("\n".join(format_paths(found)))
    studies: list[OneStepExperiment] = []
    if one_step:
        with progress_bar("studies") as progress:
            for done, count in enumerate((39, 19, 9)):
                studies.append(at_the_limit(count, one_step, seed))
                progress(done + 1, 3)
        typer.echo("\n".join(format_one_step(studies)))
    if choice:
        with progress_bar("choices") as progress:
            choices = []
            for done, dimension in enumerate((1, 2, 4, 8)):
                choices.append(many_paths(dimension, scenarios, choice, seed))
                progress(done + 1, 4)
        typer.echo("\n".join(format_choice(choices)))
    if plot:
        from api.cli.example_plots import plot_paths

        with _writing(plot):
            plot_paths(found[0], studies, plot)
    if json_file:
        document = {"runs": [_paths_document(item, seed + i) for i, item in enumerate(found)]}
        write_json(json_file, document)


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.add_typer(example, name="example")


def _check(plot: Path | None, json_file: Path | None) -> None:
    from api.files import check_writable
    from api.runs.plot import check_format

    for path in (plot, json_file):
        if path:
            check_writable(path)
    if plot:
        check_format(plot)
    if plot and json_file and plot.resolve() == json_file.resolve():
        raise InputError("output", [(str(plot), "cannot be the picture and the JSON at once")])


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError("output", [(str(path), f"cannot be written: {error.strerror}")]) from None


def _dmd_document(item: Experiment, seed: int) -> dict[str, Any]:
    return {
        "seed": seed,
        "preparation": {"states": item.prepared.states.tolist(), "inputs": item.prepared.inputs.tolist()},
        "states": item.run.states.tolist(),
        "inputs": item.run.inputs.tolist(),
        "modes": item.run.modes,
        "scenarios": [action.scenario for action in item.run.actions],
        "costs": [None if action.plan is None else action.plan.cost for action in item.run.actions],
        "model_in_set": item.model_in_set,
        "entered": item.entered,
        "limits_broken": item.limits_broken,
        "tube_escapes": item.tube_escapes,
        "flagged": item.flagged,
    }


def _paths_document(item: Trajectory, seed: int) -> dict[str, Any]:
    return {
        "seed": seed,
        "arrived": item.arrived,
        "states": item.states.tolist(),
        "steps": [
            {
                "input": step.input.tolist(), "cost": step.cost, "paths": step.paths, "programs": step.nodes,
                "slack": step.slack, "sensed": list(step.sensed), "given_up": list(step.given_up),
                "path": {"low": step.path.low.tolist(), "high": step.path.high.tolist()},
                "bounds": [asdict(bound) for bound in step.bounds],
            }
            for step in item.steps
        ],
        "kept": item.kept,
        "cuts": item.cuts(),
    }  # fmt: skip
