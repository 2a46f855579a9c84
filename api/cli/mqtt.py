"""The commands `mqtt publish` and `mqtt subscribe`: a twin at a broker, until they are interrupted."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from api.cli.interruption import interruption
from api.cli.options import UrlOption, check_source

if TYPE_CHECKING:
    from api.bridges.mqtt.broker import Broker
    from api.settings import Settings

BrokerArgument = Annotated[
    str, typer.Argument(metavar="BROKER", help="mqtt://127.0.0.1:1883, or mqtts://user@host:8883 with TLS")
]
TwinArgument = Annotated[str, typer.Argument(metavar="TWIN", help="id of a live twin")]
AuthorityOption = Annotated[
    Path | None, typer.Option("--ca", metavar="FILE", help="PEM authority of the broker's certificate; default public")
]
PlaintextOption = Annotated[
    bool, typer.Option("--plaintext", help="without TLS to another machine: in a network nobody else is in")
]

group = typer.Typer(help="Live twins at an MQTT broker.", no_args_is_help=True)


@group.command()
def publish(
    twin: TwinArgument,
    broker: BrokerArgument,
    place: Annotated[
        Path | None, typer.Option("--place", metavar="FILE", help="keep how far the broker has got, and go on there")
    ] = None,
    sparkplug: Annotated[
        str | None, typer.Option("--sparkplug", metavar="GROUP", help="as an edge node of Sparkplug B in this group")
    ] = None,
    *,
    commands: Annotated[
        bool, typer.Option("--commands", help="obey commands from the broker; the key must have the scope operate")
    ] = False,
    ca: AuthorityOption = None,
    plaintext: PlaintextOption = False,
    url: UrlOption = None,
) -> None:
    """Publish a twin's seconds and events under hrs/v1/TWIN, until it ends; the password is HRS_MQTT_PASSWORD."""
    from api.client import Service
    from api.settings import load_settings
    from station import InputError

    settings = load_settings(url=url)
    address = _broker(settings, broker, ca, plaintext=plaintext)
    if sparkplug is not None and place is not None:
        raise InputError("mqtt", [("--place", "must be left out with --sparkplug, whose data nobody acknowledges")])
    from api.bridges.mqtt.publish import Publisher
    from api.bridges.mqtt.sparkplug import EdgeNode

    with Service(settings) as service:
        if sparkplug is not None:
            EdgeNode(service.twin(twin), address, sparkplug, commands=commands).run(interruption())
            return
        whole = Publisher(service.twin(twin), address, place, commands=commands).run(interruption())
    if not whole:
        typer.echo("hrs: the broker has not acknowledged the last messages", err=True)
        raise typer.Exit(1)


@group.command()
def subscribe(
    twin: TwinArgument,
    broker: BrokerArgument,
    topic: Annotated[str, typer.Option(metavar="FILTER", help="topics with readings, as plant/+")],
    source: Annotated[
        str, typer.Option(metavar="NAME", help="of these readings at the service; names the session at the broker too")
    ] = "mqtt",
    *,
    ca: AuthorityOption = None,
    plaintext: PlaintextOption = False,
    url: UrlOption = None,
) -> None:
    """Store readings from a broker for a measured twin, until interrupted; the password is HRS_MQTT_PASSWORD."""
    from api.client import Service
    from api.settings import load_settings

    check_source("mqtt", source)
    settings = load_settings(url=url)
    address = _broker(settings, broker, ca, plaintext=plaintext)
    from api.bridges.mqtt.subscribe import Subscriber

    with Service(settings) as service:
        subscriber = Subscriber(service, twin, address, topic, source)
        subscriber.run(interruption())
    counts = subscriber.counts
    typer.echo(
        f"twin {twin} has {counts.stored} readings of {counts.messages} messages; {counts.again} came again, "
        f"{counts.refused} messages were refused"
    )


def _broker(settings: Settings, url: str, ca: Path | None, *, plaintext: bool) -> Broker:
    """The broker at an address; StationError where the extra is not installed."""
    from station import StationError

    try:
        from api.bridges.mqtt.broker import Broker
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "paho":
            raise
        raise StationError("paho-mqtt is not installed: pip install hrs-twin[mqtt]") from None
    return Broker.parse(url, password=settings.mqtt_password, ca=ca, plaintext=plaintext)


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.add_typer(group, name="mqtt")
