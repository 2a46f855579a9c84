"""Certificates and keys: who has both is let in, and reads alone."""

from __future__ import annotations

import asyncio
import shutil
import threading
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from asyncua import Client, Server, ua
from asyncua.crypto.cert_gen import setup_self_signed_certificate
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
from asyncua.server.internal_session import InternalSession
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import (
    BestAvailableEncryption,
    Encoding,
    PrivateFormat,
    load_pem_private_key,
)
from cryptography.x509 import (
    CertificateBuilder,
    DNSName,
    Name,
    NameAttribute,
    SubjectAlternativeName,
    UniformResourceIdentifier,
    load_der_x509_certificate,
)
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from api.bridges.opcua.endpoint import Certificate, Endpoint, OpcUaError, certificate_of
from api.bridges.opcua.reader import NodeReader, Peer
from api.bridges.opcua.readings import Reading
from api.bridges.opcua.server import TwinServer
from api.client import Service
from station import InputError, StationError
from tests.api.bridges.opcua.conftest import Serving
from tests.api.conftest import RunningService, free_port
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


async def first_of(peer: Peer, node: str) -> list[Reading]:
    """The first readings of a node."""
    found, ending = [], threading.Event()

    async def take(readings):
        found.extend(readings)
        ending.set()

    async def silent():
        raise AssertionError

    await NodeReader(peer, {"P": node}, take, silent, 10.0).run(ending)
    return found


@pytest.mark.slow
def test_a_server_with_security_is_followed_if_it_is_the_right_one(guarded, tmp_path):
    running, key = guarded
    ours, theirs = certificate(tmp_path, "server", "urn:hrs-twin:opcua"), certificate(tmp_path, "client", "urn:test")
    shown = ("--certificate", ours.certificate, "--private-key", ours.private_key)
    serve = Serving(running, "secret", *shown, HRS_API_KEY=key)
    endpoint = Endpoint.parse("--from", serve.url.replace("opc.tcp://", "opc.tcp://ann@"))

    def heard(password, server_certificate):
        peer = Peer.of(endpoint, password=password, certificate=theirs, server_certificate=server_certificate)
        return awaited(first_of(peer, "nsu=urn:hrs-twin:twins;s=secret.pressure_high"))

    assert heard(key, ours.certificate)[0].value > 0
    with pytest.raises(OpcUaError, match="no server can be followed"):
        heard("wrong", ours.certificate)
    with pytest.raises(OpcUaError, match="its certificate is not that of --server-certificate"):
        heard(key, certificate(tmp_path, "stranger", "urn:hrs-twin:opcua").certificate)
    serve.stop()


def test_a_strict_server_is_followed_by_files_of_any_name(tmp_path, monkeypatch):
    """A server that refuses, as the standard asks, a client that calls itself otherwise than its certificate does."""
    ours, theirs = certificate(tmp_path, "server", "urn:plc"), certificate(tmp_path, "client", "urn:test")
    shown = pem_of(theirs, tmp_path / "client.crt", tmp_path / "client.key")
    create = InternalSession.create_session

    async def strict(session, params, *more, **named):
        if params.ClientDescription.ApplicationUri != "urn:test":
            raise ua.UaStatusCodeError(ua.StatusCodes.BadCertificateUriInvalid)
        return await create(session, params, *more, **named)

    monkeypatch.setattr(InternalSession, "create_session", strict)
    url = f"opc.tcp://127.0.0.1:{free_port()}"
    peer = Peer.of(
        Endpoint.parse("--from", url), certificate=certificate_of(*shown), server_certificate=ours.certificate
    )

    async def followed():
        server = Server()
        await server.init()
        server.set_endpoint(url)
        server.set_security_policy([ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt])
        await server.load_certificate(ours.certificate)
        await server.load_private_key(ours.private_key)
        await server.nodes.objects.add_variable(ua.NodeId("P", 1), "P", 7.5)
        async with server:
            return await first_of(peer, "ns=1;s=P")

    assert [reading.value for reading in awaited(followed())] == [7.5]


def pem_of(made: Certificate, shown: Path, key: Path) -> tuple[Path, Path]:
    """The same certificate and key as PEM."""
    shown.write_bytes(load_der_x509_certificate(made.certificate.read_bytes()).public_bytes(Encoding.PEM))
    shutil.copy(made.private_key, key)
    return shown, key


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A folder with good and bad files of certificates and keys."""
    folder = tmp_path_factory.mktemp("files")
    certificate(folder, "good", "urn:test")
    certificate(folder, "other", "urn:test")
    (folder / "text.pem").write_text("no certificate")
    key = load_pem_private_key((folder / "good-key.pem").read_bytes(), None)
    name = Name([NameAttribute(NameOID.COMMON_NAME, "nobody")])
    today = datetime.now(UTC)
    for file, begin, names in (
        ("old.der", today - timedelta(days=9), [UniformResourceIdentifier("urn:test")]),
        ("nameless.der", today + timedelta(days=-1), [DNSName("localhost")]),
    ):
        made = (
            CertificateBuilder(name, name, key.public_key(), 7, begin, begin + timedelta(days=5))
            .add_extension(SubjectAlternativeName(names), critical=False)
            .sign(key, SHA256())
        )
        (folder / file).write_bytes(made.public_bytes(Encoding.DER))
    locked = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, BestAvailableEncryption(b"secret"))
    (folder / "locked.pem").write_bytes(locked)
    return folder


@pytest.mark.parametrize(
    ("shown", "key", "message"),
    [
        ("good.der", None, "--private-key: must be given, too"),
        (None, "good-key.pem", "--certificate: must be given, too"),
        ("none.der", "good-key.pem", "--certificate: must be a file"),
        ("text.pem", "good-key.pem", "--certificate: must be a certificate, PEM or DER, of an RSA key"),
        ("good-key.pem", "good-key.pem", "--certificate: must be a certificate"),
        ("old.der", "good-key.pem", "--certificate: must be valid today; it is from "),
        ("nameless.der", "good-key.pem", "--certificate: must name its application's URI"),
        ("good.der", "other-key.pem", "--private-key: must be the key of --certificate"),
        ("good.der", "good.der", "--private-key: must be an RSA key, PEM or DER, without a password"),
        ("good.der", "locked.pem", "--private-key: must be an RSA key, PEM or DER, without a password"),
    ],
)
def test_a_certificate_that_cannot_be_used_is_refused_by_name(files, shown, key, message):
    with pytest.raises(InputError, match=message):
        certificate_of(shown and files / shown, key and files / key)


def test_a_server_s_certificate_that_is_none_is_refused_by_name(files):
    ours = certificate_of(files / "good.der", files / "good-key.pem")
    assert ours.application_uri == "urn:test"
    endpoint = Endpoint.parse("--from", "opc.tcp://plc.example")
    with pytest.raises(InputError, match="--server-certificate: must be a certificate, PEM or DER, of an RSA key"):
        Peer.of(endpoint, certificate=ours, server_certificate=files / "text.pem")


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
