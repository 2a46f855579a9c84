"""Commands of the service: serve it, and use one that runs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from api.cli.options import CaOption, DatabaseOption, DataOption, UrlOption, UserOption


def serve(
    host: Annotated[str | None, typer.Option(help="address; any but loopback asks every request for a key")] = None,
    port: Annotated[int | None, typer.Option(min=0, max=65535, help="default 8000; 0 takes a free one")] = None,
    data: DataOption = None,
    database: DatabaseOption = None,
    workers: Annotated[int | None, typer.Option(min=0, max=256, help="processes; default one a core")] = None,
    executor: Annotated[
        str | None,
        typer.Option(metavar="WHERE", help="dask://host:port: compute jobs on that cluster, not here"),
    ] = None,
    zenoh_listen: Annotated[
        str | None,
        typer.Option(
            metavar="ENDPOINT",
            help="of the embedded router; default tcp/127.0.0.1:7447; other machines need tls/0.0.0.0:7447",
        ),
    ] = None,
    zenoh_certificate: Annotated[
        Path | None, typer.Option(metavar="FILE", help="PEM certificate of a tls/ endpoint")
    ] = None,
    zenoh_private_key: Annotated[
        Path | None, typer.Option(metavar="FILE", help="PEM private key of that certificate")
    ] = None,
    zenoh_connect: Annotated[
        str | None, typer.Option(metavar="ENDPOINT", help="use this router instead of the embedded one")
    ] = None,
    *,
    demo: Annotated[bool, typer.Option("--demo", help="with a live twin, and S1-S4 as the first job")] = False,
) -> None:
    """Run the service: REST, live twins over zenoh, jobs. Settings are also read from HRS_* variables."""
    from api.settings import load_settings

    settings = load_settings(
        host=host,
        port=port,
        data=data,
        database=database,
        workers=workers,
        executor=executor,
        zenoh_listen=zenoh_listen,
        zenoh_certificate=zenoh_certificate,
        zenoh_private_key=zenoh_private_key,
        zenoh_connect=zenoh_connect,
        demo=demo or None,
    )
    from api.cli.serve import serve as run  # takes seconds, for which nobody should wait whose settings are wrong

    run(settings)


def submit(
    scenarios: Annotated[
        list[str], typer.Argument(metavar="SCENARIO...", help="names that the service knows, or files")
    ],
    controllers: Annotated[str, typer.Option(help="comma-separated, options behind colons")] = "logic",
    replications: Annotated[int, typer.Option(min=1, help="replication 0 is the pattern, later ones are drawn")] = 1,
    seed: Annotated[int, typer.Option(min=0, help="seed of replications >= 1")] = 0,
    *,
    record: Annotated[
        str | None,
        typer.Option(
            help="what of each run is stored beside its figures: full (a single run's default), vehicles, "
            "none (a comparison's)"
        ),
    ] = None,
    wait: Annotated[bool, typer.Option("--wait", help="show progress, then the result")] = False,
    url: UrlOption = None,
) -> None:
    """Submit a run (one scenario, one controller) or a comparison to a running service; prints its id."""
    from api.cli.scenario import FILES
    from api.client import Job, Service
    from api.settings import load_settings
    from station import load_scenario

    names = [name.strip() for name in controllers.split(",")]
    chosen = [load_scenario(name) if Path(name).suffix in FILES else name for name in scenarios]
    with Service(load_settings(url=url)) as service:
        job: Job
        if len(chosen) == len(names) == replications == 1:
            job = service.run(chosen[0], names[0], seed=seed, record=record or "full")
        else:
            job = service.compare(chosen, names, replications=replications, seed=seed, record=record or "none")
        typer.echo(job.id)
        for each in job.document.get("scenario_replications", []):
            if each["reason"]:
                typer.echo(f"{each['scenario']}: {each['reason']}", err=True)
        if wait:
            _follow(service, job.path)


def jobs(
    job: Annotated[str | None, typer.Argument(metavar="[ID]", help="one job: its figures or table")] = None,
    limit: Annotated[int, typer.Option(min=1, max=200, help="newest jobs to list")] = 10,
    *,
    cancel: Annotated[bool, typer.Option("--cancel", help="end the job")] = False,
    wait: Annotated[bool, typer.Option("--wait", help="show progress until the job ends")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="what the service answers")] = False,
    url: UrlOption = None,
) -> None:
    """List the jobs of a running service, or show, await or cancel one."""
    from api.client import Client
    from api.settings import load_settings
    from station import InputError

    with Client(load_settings(url=url)) as client:
        if job is None:
            found = [
                item
                for kind in ("runs", "comparisons", "certificates", "calibrations")
                for item in client.get(f"/v1/{kind}", limit=limit)["items"]
            ]
            found = sorted(found, key=lambda item: str(item["created"]), reverse=True)[:limit]
            typer.echo(json.dumps(found, indent=1) if as_json else _listing(found), nl=bool(found))
            return
        kind = job.partition("-")[0]
        if kind not in {"run", "comparison", "certificate", "calibration"}:
            begins = "run-, comparison-, certificate- or calibration-"
            raise InputError("job", [("ID", f"must begin with {begins}; given {job!r}")])
        path = f"/v1/{kind}s/{job}"
        if cancel:
            client.post(f"{path}/cancel")
        if as_json:
            typer.echo(json.dumps(client.get(path), indent=1))
        elif wait:
            _follow(client, path)
        else:
            _show(client, path, client.get(path))


def watch(
    twin: Annotated[str, typer.Argument(help="id of a live twin")],
    endpoint: Annotated[
        str | None, typer.Option(help="zenoh router; default HRS_ZENOH_CONNECT or tcp/127.0.0.1:7447")
    ] = None,
    seconds: Annotated[float | None, typer.Option(min=0, help="end after so long; default when interrupted")] = None,
    user: UserOption = None,
    ca: CaOption = None,
) -> None:
    """Watch a live twin in the terminal. A user's password is read from HRS_ZENOH_PASSWORD."""
    from api.settings import load_settings
    from api.telemetry.watch import watch as show

    settings = load_settings(zenoh_user=user, zenoh_ca=ca)
    show(twin, endpoint or settings.zenoh_connect or settings.zenoh_listen, settings, seconds)


def _follow(client: Any, path: str) -> None:
    """Show progress until a job ends, then its result."""
    from api.cli.console import progress_bar

    with progress_bar("runs") as progress:
        ended = client.wait(path, lambda job: progress(*_progress(job)))
    _show(client, path, ended)


def _progress(job: dict[str, Any]) -> tuple[int, int]:
    """Work that is done, and all of it."""
    if "progress" in job:
        return round(100 * job["progress"]), 100
    return job.get("runs_done", 0), job.get("runs", 1)


def _show(client: Any, path: str, job: dict[str, Any]) -> None:
    from api.cli.console import print_figures, print_tables
    from api.comparisons.tables import Row, Table

    if job["state"] == "failed":
        problem = job["problem"] or {}
        typer.echo(f"failed: {problem.get('title', '')}: {problem.get('detail', '')}", err=True)
        raise typer.Exit(1)
    if job["state"] != "succeeded":
        typer.echo(_listing([job]))
    elif "answer" in job:
        from api.certificates.questions import Answer
        from api.cli.certify import told

        typer.echo("\n".join(told(Answer(**job["answer"]))))
    elif "progress" in job:
        from api.cli.calibrate import show_calibration

        show_calibration(job)
    elif "metrics" in job:
        print_figures(job["metrics"])
    else:
        answer = client.get(f"{path}/table")
        print_tables(
            [
                Table(
                    table["title"],
                    tuple(table["headings"]),
                    tuple(Row(row["controller"], row["origin"], tuple(row["cells"])) for row in table["rows"]),
                )
                for table in answer["tables"]
            ],
            answer["verdict"],
        )


def _listing(found: list[dict[str, Any]]) -> str:
    lines = []
    for job in found:
        created = f"{job['created'][:19]}Z"
        if "runs" in job:
            progress = f"{job['runs_done']}/{job['runs']}"
            what = f"{', '.join(job['scenarios'])} x {', '.join(job['controllers'])}"
        else:
            progress = f"{100 * job['progress']:.0f} %" if "progress" in job else ""
            what = _what(job)
        lines.append(f"{job['id']:<32} {job['state']:<10} {progress:>11}  {created}  {what}")
    return "\n".join(lines)


def _what(job: dict[str, Any]) -> str:
    """What a job of one piece of work is about."""
    if "scenario" in job:
        return f"{job['scenario']} x {job['controller']}"
    if "twin" in job:
        return f"{job['twin']}, seconds {job['from_s']} to {job['to_s']}"
    return f"{job['ask']}, {job['constraint']}"


def register(app: typer.Typer) -> None:
    """Add these commands to the command line."""
    for command in (serve, watch, submit, jobs):
        app.command()(command)
