"""The commands `opcua serve` and `opcua follow`: twins at an OPC UA server, and readings from one."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from api.cli.follow import TagsOption
from api.cli.interruption import interruption
from api.cli.options import UrlOption, check_source

if TYPE_CHECKING:
    from api.bridges.opcua.endpoint import Endpoint

ENDPOINT = "opc.tcp://127.0.0.1:4840/hrs"

TIMEOUT_S = 10.0
"""A server that has been away for so long has bad readings [s]."""

CertificateOption = Annotated[
    Path | None, typer.Option("--certificate", metavar="FILE", help="our own certificate, PEM or DER")
]
PrivateKeyOption = Annotated[Path | None, typer.Option("--private-key", metavar="FILE", help="its private key")]

commands = typer.Typer(help="Live twins at an OPC UA server, and readings from one.", no_args_is_help=True)


@commands.command()
def serve(
    twins: Annotated[str, typer.Option(metavar="A,B", help="ids of live twins")],
    endpoint: Annotated[
        str, typer.Option(metavar="URL", help="to listen at; any but loopback needs a certificate, and keys of clients")
    ] = ENDPOINT,
    certificate: CertificateOption = None,
    private_key: PrivateKeyOption = None,
    url: UrlOption = None,
) -> None:
    """Serve twins to OPC UA clients, to be read: variables, alarms as events, history; until interrupted."""
    from api.settings import load_settings

    settings = load_settings(url=url)
    address = _endpoint("--endpoint", endpoint)
    from api.bridges.opcua.endpoint import certificate_of
    from api.bridges.opcua.server import TwinServer
    from api.client import Service

    names = [name.strip() for name in twins.split(",")]
    with Service(settings) as service:
        shown = certificate_of(certificate, private_key)
        server = TwinServer(service, names, address, shown, settings.service_url)
        server.run(interruption(), lambda: typer.echo(f"{', '.join(names)}: {address.url}"))


@commands.command()
def follow(
    twin: Annotated[str, typer.Option(metavar="ID", help="a live measured twin")],
    server: Annotated[str, typer.Option("--from", metavar="URL", help="opc.tcp://[user@]host[:4840][/path]")],
    tags: TagsOption,
    place: Annotated[
        Path | None, typer.Option("--place", metavar="FILE", help="keep up to where tags are stored, and go on there")
    ] = None,
    source: Annotated[str, typer.Option(metavar="NAME", help="of these readings at the service")] = "opcua",
    timeout: Annotated[
        float, typer.Option(metavar="SECONDS", min=0.1, help="a server away for so long has bad readings")
    ] = TIMEOUT_S,
    certificate: CertificateOption = None,
    private_key: PrivateKeyOption = None,
    server_certificate: Annotated[
        Path | None, typer.Option("--server-certificate", metavar="FILE", help="that the server must have")
    ] = None,
    *,
    plaintext: Annotated[
        bool, typer.Option("--plaintext", help="without security to another machine: in a network nobody else is in")
    ] = False,
    url: UrlOption = None,
) -> None:
    """Store values of an OPC UA server for a measured twin, until interrupted; the password is HRS_OPCUA_PASSWORD."""
    from api.settings import load_settings

    settings = load_settings(url=url)
    address = _endpoint("--from", server)
    from api.bridges.opcua.endpoint import certificate_of
    from api.bridges.opcua.follow import Follower
    from api.bridges.opcua.reader import Peer
    from api.client import Service
    from station.measurement import load_tags

    check_source("opcua", source)
    peer = Peer.of(
        address, password=settings.opcua_password, certificate=certificate_of(certificate, private_key),
        server_certificate=server_certificate, plaintext=plaintext,
    )  # fmt: skip
    with Service(settings) as service:
        follower = Follower(service, twin, peer, load_tags(tags), source, timeout, place)
        follower.run(interruption())
    counts = follower.counts
    typer.echo(
        f"twin {twin} has {counts.stored} readings by {follower.connections} connections; the server was away "
        f"{counts.silences} times for longer than {timeout:g} s"
    )


def _endpoint(name: str, url: str) -> Endpoint:
    """The endpoint at an address; StationError where the extra is not installed."""
    from station import StationError

    try:
        from api.bridges.opcua.endpoint import Endpoint
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "asyncua":
            raise
        raise StationError("asyncua is not installed: pip install hrs-twin[opcua]") from None
    logging.getLogger("asyncua").setLevel(logging.CRITICAL)  # it tells of every break, as we do
    return Endpoint.parse(name, url)


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.add_typer(commands, name="opcua")
