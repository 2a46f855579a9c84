"""Addresses of OPC UA servers, ours and others', and the certificates by which each side knows the other."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple
from urllib.parse import urlsplit

from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
from asyncua.crypto.uacrypto import CertProperties
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric.rsa import RSAPrivateKey, RSAPublicKey
from cryptography.hazmat.primitives.serialization import load_der_private_key, load_pem_private_key

from api.settings import is_loopback
from station import InputError, StationError

PORT = 4840
"""The port of OPC UA."""

POLICY = SecurityPolicyBasic256Sha256
"""The security policy of every connection that has one; its messages are signed and encrypted."""


APPLICATION = "urn:hrs-twin:opcua"
"""Our application's URI; with a certificate it is the one named there."""


class OpcUaError(StationError):
    """A server cannot be reached at first, refuses, or cannot be opened."""


class Certificate(NamedTuple):
    """An application's own certificate."""

    certificate: Path  # PEM or DER
    private_key: Path  # PEM or DER
    application_uri: str = APPLICATION  # that it names


class Endpoint(NamedTuple):
    """The address of a server, as `opc.tcp://[user@]host[:4840][/path]`."""

    url: str  # without its user
    host: str
    user: str | None

    @classmethod
    def parse(cls, name: str, url: str) -> Endpoint:
        """The endpoint at an address that the option `name` gives.

        Raises
        ------
        InputError
            if the address has another form, or holds a password.
        """
        parts = urlsplit(url)
        if parts.password is not None:
            raise wrong(name, "must hold no password: others of this machine can see it; set HRS_OPCUA_PASSWORD")
        try:
            port = parts.port or PORT
        except ValueError:
            port = 0
        if parts.scheme != "opc.tcp" or not parts.hostname or not port or parts.query or parts.fragment:
            raise wrong(name, f"must be opc.tcp://[user@]host[:port][/path]; given {url!r:.100}")
        host = f"[{parts.hostname}]" if ":" in parts.hostname else parts.hostname
        return cls(f"opc.tcp://{host}:{port}{parts.path}", parts.hostname, parts.username)

    @property
    def is_loopback(self) -> bool:
        """Whether only programs of this machine reach it."""
        return is_loopback(self.host)


def certificate_of(certificate: Path | None, private_key: Path | None) -> Certificate | None:
    """The certificate in two files; None where neither is given.

    Raises
    ------
    InputError
        if one is given without the other, the certificate is none that works now and names its application's URI, or
        the key is another one's.
    """
    if certificate is None and private_key is None:
        return None
    if certificate is None or private_key is None:
        missing = "--certificate" if certificate is None else "--private-key"
        raise wrong(missing, "must be given, too: a certificate is used with its private key")
    shown = read_certificate("--certificate", certificate)
    now = datetime.now(UTC)
    if not shown.not_valid_before_utc <= now <= shown.not_valid_after_utc:
        span = f"{shown.not_valid_before_utc:%Y-%m-%d} to {shown.not_valid_after_utc:%Y-%m-%d}"
        raise wrong("--certificate", f"must be valid today; it is from {span}")
    uris = _uris(shown)
    if not uris:
        raise wrong("--certificate", f"must name its application's URI as subjectAltName, as {APPLICATION}")
    if _private_key(private_key).public_key() != shown.public_key():
        raise wrong("--private-key", "must be the key of --certificate")
    return Certificate(certificate, private_key, uris[0])


def read_certificate(name: str, path: Path) -> x509.Certificate:
    """The certificate in the file that the option `name` gives.

    Raises
    ------
    InputError
        if that is no file with the certificate of an RSA key.
    """
    content = _content(name, path)
    try:
        found = (x509.load_pem_x509_certificate if _is_pem(content) else x509.load_der_x509_certificate)(content)
    except ValueError:
        found = None
    if found is None or not isinstance(found.public_key(), RSAPublicKey):
        raise wrong(name, f"must be a certificate, PEM or DER, of an RSA key; given {str(path)!r:.200}")
    return found


def properties_of(path: Path) -> CertProperties:
    """The file for asyncua, which takes each for DER that is not called `.pem`."""
    content = path.read_bytes()
    return CertProperties(content, extension="pem" if _is_pem(content) else "der")


def _private_key(path: Path) -> RSAPrivateKey:
    content = _content("--private-key", path)
    try:
        found = (load_pem_private_key if _is_pem(content) else load_der_private_key)(content, None)
    except (ValueError, TypeError):  # the latter of a key with a password
        found = None
    if not isinstance(found, RSAPrivateKey):
        message = f"must be an RSA key, PEM or DER, without a password; given {str(path)!r:.200}"
        raise wrong("--private-key", message)
    return found


def _content(name: str, path: Path) -> bytes:
    if not path.is_file():
        raise wrong(name, f"must be a file; given {str(path)!r:.200}")
    return path.read_bytes()


def _is_pem(content: bytes) -> bool:
    return b"-----BEGIN" in content


def _uris(certificate: x509.Certificate) -> list[str]:
    """The URIs among a certificate's other names."""
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return []
    return names.get_values_for_type(x509.UniformResourceIdentifier)


def wrong(name: str, message: str) -> InputError:
    """The error of an option."""
    return InputError("opcua", [(name, message)])
