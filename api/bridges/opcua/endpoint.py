"""Addresses of OPC UA servers, ours and others', and the certificates by which each side knows the other."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple
from urllib.parse import urlsplit

from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256

from api.settings import is_loopback
from station import InputError, StationError

PORT = 4840
"""The port of OPC UA."""

POLICY = SecurityPolicyBasic256Sha256
"""The security policy of every connection that has one; its messages are signed and encrypted."""


class OpcUaError(StationError):
    """A server cannot be reached at first, refuses, or cannot be opened."""


class Certificate(NamedTuple):
    """An application's own certificate."""

    certificate: Path  # PEM or DER
    private_key: Path  # PEM or DER


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
        if one is given without the other, or is no file.
    """
    if certificate is None and private_key is None:
        return None
    if certificate is None or private_key is None:
        missing = "--certificate" if certificate is None else "--private-key"
        raise wrong(missing, "must be given, too: a certificate is used with its private key")
    for name, path in (("--certificate", certificate), ("--private-key", private_key)):
        check_file(name, path)
    return Certificate(certificate, private_key)


def check_file(name: str, path: Path) -> None:
    """Raise InputError unless the option `name` gives a file."""
    if not path.is_file():
        raise wrong(name, f"must be a file; given {str(path)!r:.200}")


def wrong(name: str, message: str) -> InputError:
    """The error of an option."""
    return InputError("opcua", [(name, message)])
