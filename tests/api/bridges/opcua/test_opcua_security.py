"""Certificates and keys: who has both is let in, and reads alone."""

from __future__ import annotations

import asyncio
import threading
from pathlib import Path

import pytest
from asyncua import Client, ua
from asyncua.crypto.cert_gen import setup_self_signed_certificate
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
from cryptography.x509.oid import ExtendedKeyUsageOID

from api.bridges.opcua.endpoint import Certificate, Endpoint, OpcUaError
from api.bridges.opcua.reader import NodeReader, Peer
from api.bridges.opcua.server import TwinServer
from api.client import Service
from station import InputError, StationError
from tests.api.bridges.opcua.conftest import Serving
from tests.api.conftest import RunningService
from tests.api.here import hrs
from tests.waiting import awaited, wait_until

EVERYWHERE = Endpoint.parse("--endpoint", "opc.tcp://0.0.0.0:4840/hrs")


def certificate(folder: Path, name: str, uri: str) -> Certificate:
    """A self-signed certificate of an application."""
    made = Certificate(folder / f"{name}.der", folder / f"{name}-key.pem")
    usage = [ExtendedKeyUsageOID.CLIENT_AUTH, ExtendedKeyUsageOID.SERVER_AUTH]
    awaited(setup_self_signed_certificate(made.private_key, made.certificate, uri, "localhost", usage, {}))
    return made


@pytest.fixture(scope="module")
def guarded(tmp_path_factory):
    """A service that asks for keys, one of them, and a twin that stands still."""
    folder = tmp_path_factory.mktemp("guarded")
    keys = {scope: hrs("keys", "create", scope, "--scope", scope, "--data", folder).stdout.strip()
            for scope in ("operate", "read")}  # fmt: skip
    running = RunningService(folder, "--host", "0.0.0.0", "--workers", "0")  # noqa: S104  # what needs the keys
    with Service(url=running.url, key=keys["operate"]) as service:
        twin = service.start("S1", id="secret", speed=1000, at_end="idle")
        wait_until(lambda: twin.state()["samples"] > 5)
        twin.change(paused=True)
    yield running, keys["read"]
    running.stop()


def test_another_machine_needs_a_certificate_and_keys(service, running, tmp_path):
    with pytest.raises(InputError, match="--certificate: must be given where other machines can connect"):
        TwinServer(service, ["any"], EVERYWHERE, None, running.url)
    ours = certificate(tmp_path, "server", "urn:hrs-twin:opcua")
    with pytest.raises(StationError, match="asks nobody for a key"):
        TwinServer(service, ["any"], EVERYWHERE, ours, running.url)


@pytest.mark.slow
def test_who_has_a_certificate_and_a_key_reads_and_nobody_else(guarded, tmp_path):
    running, key = guarded
    ours, theirs = certificate(tmp_path, "server", "urn:hrs-twin:opcua"), certificate(tmp_path, "client", "urn:test")
    shown = ("--certificate", ours.certificate, "--private-key", ours.private_key)
    serve = Serving(running, "secret", *shown, HRS_API_KEY=key)

    async def value(user, password, *, secured=True):
        client = Client(serve.url, timeout=20, watchdog_intervall=20)
        client.application_uri = "urn:test"
        if secured:
            await client.set_security(
                SecurityPolicyBasic256Sha256, str(theirs.certificate), str(theirs.private_key),
                server_certificate=str(ours.certificate),
            )  # fmt: skip
        if user:
            client.set_user(user)
            client.set_password(password)
        async with client:
            pressure = client.get_node("ns=2;s=secret.pressure_high")
            with pytest.raises(ua.UaStatusCodeError):
                await pressure.write_value(1.0)
            with pytest.raises(ua.UaStatusCodeError):
                await client.nodes.objects.add_variable(2, "mine", 1.0)
            return await pressure.read_value()

    assert awaited(value("admin", key)) > 0
    assert awaited(value("ann", key)) > 0
    for user, password, secured in (("ann", "wrong", True), ("ann", "", True), (None, None, True), ("ann", key, False)):
        with pytest.raises((ua.UaError, OSError, asyncio.TimeoutError)):
            awaited(value(user, password, secured=secured))
    serve.stop()


@pytest.mark.slow
def test_a_server_with_security_is_followed_if_it_is_the_right_one(guarded, tmp_path):
    running, key = guarded
    ours, theirs = certificate(tmp_path, "server", "urn:hrs-twin:opcua"), certificate(tmp_path, "client", "urn:test")
    shown = ("--certificate", ours.certificate, "--private-key", ours.private_key)
    serve = Serving(running, "secret", *shown, HRS_API_KEY=key)
    endpoint = Endpoint.parse("--from", serve.url.replace("opc.tcp://", "opc.tcp://ann@"))

    def heard(password, server_certificate):
        peer = Peer.of(endpoint, password=password, certificate=theirs, server_certificate=server_certificate)
        found, ending = [], threading.Event()

        async def take(readings):
            found.extend(readings)
            ending.set()

        async def silent():
            raise AssertionError

        nodes = {"P": "nsu=urn:hrs-twin:twins;s=secret.pressure_high"}
        awaited(NodeReader(peer, nodes, take, silent, 10.0).run(ending))
        return found

    assert heard(key, ours.certificate)[0].value > 0
    with pytest.raises(OpcUaError, match="no server can be followed"):
        heard("wrong", ours.certificate)
    with pytest.raises(OpcUaError, match="no server can be followed"):
        heard(key, certificate(tmp_path, "stranger", "urn:hrs-twin:opcua").certificate)
    serve.stop()


@pytest.mark.parametrize(
    ("url", "options", "message"),
    [
        ("opc.tcp://plc.example", {}, "--certificate: must be given for another machine's server, or --plaintext"),
        ("opc.tcp://127.0.0.1", {"password": "x"}, "must name a user where HRS_OPCUA_PASSWORD is set"),
        ("opc.tcp://ann@plc.example", {"server_certificate": Path("plc.der")}, "--certificate: must be given, too"),
        ("opc.tcp://ann@plc.example", {"certificate": Certificate(Path("a"), Path("b"))},
         "--server-certificate: must be given, too"),
    ],
)  # fmt: skip
def test_a_server_that_is_not_known_is_refused(url, options, message):
    with pytest.raises(InputError, match=message):
        Peer.of(Endpoint.parse("--from", url), **options)


@pytest.mark.parametrize(
    ("url", "message"),
    [
        ("http://127.0.0.1", r"must be opc.tcp://\[user@\]host"),
        ("opc.tcp://127.0.0.1:port", "must be opc.tcp://"),
        ("opc.tcp://127.0.0.1:99999", "must be opc.tcp://"),
        ("opc.tcp://", "must be opc.tcp://"),
        ("opc.tcp://ann:secret@127.0.0.1", "must hold no password"),
    ],
)
def test_an_address_that_is_wrong_is_refused(url, message):
    with pytest.raises(InputError, match=message) as caught:
        Endpoint.parse("--from", url)
    assert "secret" not in str(caught.value)


def test_addresses_have_a_usual_port():
    assert Endpoint.parse("--from", "opc.tcp://ann@plc.example") == ("opc.tcp://plc.example:4840", "plc.example", "ann")
    assert Endpoint.parse("--from", "opc.tcp://[::1]:4841/a").url == "opc.tcp://[::1]:4841/a"
    assert Peer.of(Endpoint.parse("--from", "opc.tcp://plc.example"), plaintext=True).certificate is None
