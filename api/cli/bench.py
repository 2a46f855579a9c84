"""The command `bench`: the benchmarks in a process of their own."""

from __future__ import annotations

import subprocess
import sys

import typer


def bench(arguments: typer.Context) -> None:
    """Measure what decisions, days and comparisons cost here (`hrs bench --help`)."""
    # A process of its own: nothing of the command line counts, and the benchmarks stand above this room.
    raise typer.Exit(subprocess.run([sys.executable, "-m", "benchmarks", *arguments.args], check=False).returncode)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(
        context_settings={"allow_extra_args": True, "ignore_unknown_options": True, "help_option_names": []},
        add_help_option=False,
    )(bench)
