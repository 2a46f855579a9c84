"""Access control of zenoh: a user and a password for each key, and the rules of its scopes."""

from __future__ import annotations

import hashlib
import hmac
import os
import secrets
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import quote

from api.scopes import Scope, allows
from api.settings import Settings
from api.store.records import Key
from api.telemetry.topics import ALARMS, ALIVE, COMMAND, DECIDE, EVENT, HISTORY, MEASUREMENT, ROOT, SAMPLE, SIGNAL, key
from station import InputError

SECRET_BYTES = 32
"""Of the secret that passwords are made from, at least."""


@dataclass(frozen=True, slots=True)
class Login:
    """The user and password with which the holder of a key logs in to zenoh."""

    user: str
    password: str = field(repr=False)
    scopes: tuple[Scope, ...] = ()

    @classmethod
    def of(cls, held: Key, secret: bytes) -> Login:
        """A key's user is its name, with %XX for what is no letter, digit or one of `_.-~`.

        zenoh checks a password by a challenge, for which it needs the password itself, and of a key only a digest is
        stored: so the password is another text, made from digest and secret whenever it is needed, and stored nowhere.
        """
        return cls(quote(held.name, safe=""), hmac.new(secret, held.digest, hashlib.sha256).hexdigest(), held.scopes)


def read_secret(settings: Settings) -> bytes:
    """The secret that passwords are made from; made at first use, in a file that its owner alone may read.

    Raises
    ------
    InputError
        if the file cannot be read or made, or is too short.
    """
    file = settings.zenoh_secret_file
    try:
        if not file.exists():
            _make_secret(file)
        secret = file.read_bytes().strip()
    except OSError as error:
        raise InputError("settings", [("zenoh_secret", f"{file} cannot be used: {error.strerror}")]) from None
    if len(secret) < SECRET_BYTES:
        raise InputError("settings", [("zenoh_secret", f"{file} must hold at least {SECRET_BYTES} bytes")])
    return secret


def _make_secret(file: Path) -> None:
    """Make the file whole; of two programs that do so at once, the first counts."""
    file.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    mine = file.with_name(f"{file.name}.{secrets.token_hex(4)}")
    try:
        with os.fdopen(os.open(mine, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as out:
            out.write(secrets.token_hex(SECRET_BYTES) + "\n")
        with suppress(FileExistsError):
            file.hardlink_to(mine)
    finally:
        mine.unlink(missing_ok=True)


def logins(held: Sequence[Key], secret: bytes) -> list[Login]:
    """One for each key that is valid."""
    return [Login.of(each, secret) for each in held if each.revoked is None]


def dictionary(admitted: Sequence[Login]) -> str:
    """The file of users for zenoh; never an empty one, with which it would let everybody in."""
    nobody = Login(f"nobody-{secrets.token_hex(8)}", secrets.token_hex(SECRET_BYTES))
    return "".join(f"{login.user}:{login.password}\n" for login in [*admitted, nobody])


_EACH = "*"

_RULES: tuple[tuple[Scope, str, tuple[str, ...], tuple[str, ...]], ...] = (
    (Scope.READ, "ingress", ("declare_subscriber",), (f"{ROOT}/**",)),
    (Scope.READ, "ingress", ("declare_liveliness_subscriber", "liveliness_query"), (key(_EACH, ALIVE),)),
    (
        Scope.READ, "ingress", ("query",),
        tuple(key(_EACH, *each) for each in ((SAMPLE,), (SIGNAL, _EACH), (EVENT,), (ALARMS,), (HISTORY,))),
    ),
    (Scope.READ, "egress", ("put", "reply", "liveliness_token"), (f"{ROOT}/**",)),
    (Scope.OPERATE, "ingress", ("query",), (key(_EACH, COMMAND),)),
    (Scope.OPERATE, "ingress", ("declare_queryable", "reply"), (key(_EACH, DECIDE),)),
    (Scope.OPERATE, "egress", ("query",), (key(_EACH, DECIDE),)),
    (Scope.MEASURE, "ingress", ("query",), (key(_EACH, MEASUREMENT),)),
)  # fmt: skip
"""(scope, direction as the router sees it, messages, keys) of all that is allowed; everything else is not."""


def access_control(admitted: Sequence[Login]) -> dict[str, Any]:
    """The `access_control` of zenoh: each user may do what the scopes of its key say, and nothing else."""
    rules = [
        {"id": f"rule-{number}", "permission": "allow", "flows": [flow], "messages": messages, "key_exprs": keys}
        for number, (_, flow, messages, keys) in enumerate(_RULES)
    ]
    subjects = [{"id": login.user, "usernames": [login.user]} for login in admitted]
    policies = [
        {
            "rules": [f"rule-{number}" for number, (scope, *_) in enumerate(_RULES) if allows(login.scopes, scope)],
            "subjects": [login.user],
        }
        for login in admitted
    ]
    return {
        "enabled": True, "default_permission": "deny", "rules": rules, "subjects": subjects, "policies": policies,
    }  # fmt: skip
