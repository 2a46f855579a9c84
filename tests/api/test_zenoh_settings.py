"""What the service refuses before it lets other machines use zenoh, and what its settings never tell."""

from __future__ import annotations

import pytest
import trustme

from api.scopes import Scope
from api.settings import Settings
from api.store.records import Key
from api.telemetry import access
from api.telemetry.session import connect
from api.telemetry.session_manager import SessionManager
from station import InputError
from tests.api.conftest import free_port
from tests.warm import run_hrs


@pytest.mark.parametrize("listen", ["tcp/0.0.0.0:7447", "tcp/192.168.0.1:7447", "tcp/[::]:7447", "udp/10.0.0.1:7447"])
def test_other_machines_get_no_plaintext_unless_that_is_said(listen):
    with pytest.raises(ValueError, match=r"zenoh_listen[\s\S]*must be a loopback endpoint[\s\S]*zenoh_plaintext"):
        Settings(zenoh_listen=listen)
    assert Settings(zenoh_listen=listen, zenoh_plaintext=True).zenoh_keys_required  # keys are asked for all the same


@pytest.mark.parametrize("listen", ["tcp/:7447", "7447", "", "tls/7447"])
def test_an_endpoint_names_protocol_and_place(listen):
    with pytest.raises(ValueError, match="must be an endpoint like"):
        Settings(zenoh_listen=listen)


@pytest.mark.parametrize("given", [{}, {"zenoh_certificate": "a.pem"}, {"zenoh_private_key": "b.pem"}])
def test_tls_needs_a_certificate_and_its_key(given):
    for listen in ("tls/0.0.0.0:7447", "tls/127.0.0.1:7447"):
        with pytest.raises(ValueError, match="needs zenoh_certificate and zenoh_private_key"):
            Settings(zenoh_listen=listen, **given)


def test_loopback_asks_for_no_key_and_other_places_do():
    given = {"zenoh_certificate": "a.pem", "zenoh_private_key": "b.pem"}
    for listen in ("tcp/127.0.0.1:7447", "tcp/[::1]:7447", "tcp/localhost:7447", "tls/127.0.0.1:7447"):
        assert not Settings(zenoh_listen=listen, **given).zenoh_keys_required
    assert Settings(zenoh_listen="tls/0.0.0.0:7447", **given).zenoh_keys_required
    assert not Settings(zenoh_listen="tls/0.0.0.0:7447", zenoh_connect="tcp/router:7447", **given).zenoh_keys_required


@pytest.mark.slow
def test_the_service_does_not_start_for_others_without_a_key(tmp_path):
    started = run_hrs("serve", "--port", 0, "--data", tmp_path, "--zenoh-listen", "tls/0.0.0.0:7447",
                   "--zenoh-certificate", tmp_path / "a.pem", "--zenoh-private-key", tmp_path / "b.pem")  # fmt: skip
    assert started.returncode == 2
    assert "zenoh_listen: tls/0.0.0.0:7447 is reached from other machines: make a key first" in started.stderr


def test_files_that_cannot_be_used_are_named(tmp_path):
    settings = Settings(
        data=tmp_path, zenoh_listen=f"tls/127.0.0.1:{free_port()}", zenoh_certificate=tmp_path / "no.pem",
        zenoh_private_key=tmp_path / "no.pem",
    )  # fmt: skip
    with pytest.raises(InputError, match=r"zenoh_certificate: .*no\.pem cannot be read"):
        SessionManager(settings, list).open()
    with pytest.raises(InputError, match=r"zenoh_ca: .*no\.pem cannot be read"):
        connect(settings.zenoh_listen, Settings(zenoh_ca=tmp_path / "no.pem"))
    (tmp_path / "zenoh.secret").write_text("short")
    with pytest.raises(InputError, match=r"zenoh_secret: .*at least 32 bytes"):
        access.read_secret(Settings(data=tmp_path))
    with pytest.raises(InputError, match=r"zenoh_secret: .*cannot be used"):
        access.read_secret(Settings(zenoh_secret=tmp_path))


def test_a_key_that_is_no_key_does_not_open_the_router(tmp_path):
    issued = trustme.CA().issue_cert("127.0.0.1")
    issued.cert_chain_pems[0].write_to_path(tmp_path / "a.pem")
    (tmp_path / "b.pem").write_text("no key")
    settings = Settings(zenoh_listen=f"tls/127.0.0.1:{free_port()}", zenoh_certificate=tmp_path / "a.pem",
                        zenoh_private_key=tmp_path / "b.pem")  # fmt: skip
    with pytest.raises(InputError, match=r"zenoh_listen: .*cannot be listened on"):
        SessionManager(settings, list).open()


def test_settings_never_tell_what_is_secret():
    hidden = {"zenoh_password": "pw-1", "api_key": "hrs_key-2", "database": "postgresql://u:pw-3@host/name",
              "zenoh_private_key": "/keys/pw-4"}  # fmt: skip
    shown = Settings(zenoh_user="ann", **hidden)
    for secret in ("pw-1", "key-2", "pw-3", "pw-4"):
        assert secret not in repr(shown) + str(shown)
    assert "ann" in repr(shown)


def test_the_secret_is_made_once(tmp_path):
    settings = Settings(data=tmp_path / "new")
    first = access.read_secret(settings)
    assert access.read_secret(settings) == first
    assert len(first) == 64
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["zenoh.secret"]


def _key(name, *scopes, revoked=None):
    return Key(name, 0.0, revoked, scopes or (Scope.READ,), name.encode().ljust(32))


def test_passwords_differ_by_key_and_by_secret():
    ann, bob = _key("ann"), _key("bob")
    logins = [access.Login.of(held, secret) for held in (ann, bob) for secret in (b"1" * 32, b"2" * 32)]
    assert len({login.password for login in logins}) == 4
    assert logins[0] == access.Login.of(ann, b"1" * 32)
    assert logins[0].password not in repr(logins)
    assert access.logins([ann, _key("old", revoked=1.0)], b"1" * 32) == [logins[0]]


def test_a_name_cannot_make_a_second_user():
    login = access.Login.of(_key("a:b\nroot:pw"), b"1" * 32)
    lines = access.dictionary([login]).splitlines()
    assert len(lines) == 2  # with the one that keeps zenoh from letting everybody in
    assert lines[0] == f"a%3Ab%0Aroot%3Apw:{login.password}"


@pytest.mark.slow
def test_without_a_valid_key_nobody_comes_in(tmp_path):
    """zenoh lets everybody in whose file of users is empty."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    settings = Settings(data=tmp_path, zenoh_listen=endpoint.replace("127.0.0.1", "0.0.0.0"), zenoh_plaintext=True)  # noqa: S104  # what needs keys
    door = SessionManager(settings, list)
    door.open()
    try:
        assert access.dictionary([]).count("\n") == 1
        with pytest.raises(InputError, match="no router answers"):
            connect(endpoint)
    finally:
        door.close()


@pytest.mark.slow
def test_a_router_that_could_not_be_opened_again_is_tried_again(tmp_path):
    held = [_key("ann")]
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    listen = endpoint.replace("127.0.0.1", "0.0.0.0")  # noqa: S104  # what needs keys
    door = SessionManager(Settings(data=tmp_path, zenoh_listen=listen, zenoh_plaintext=True), lambda: held)
    door.open()
    moved = []

    def fails(reopen):
        door.session.close()
        raise InputError("zenoh", [("", "no")])

    try:
        door.look(lambda reopen: moved.append(reopen()))
        assert moved == []  # nothing has changed
        held.append(_key("bob"))
        with pytest.raises(InputError):
            door.look(fails)
        assert "closed" in door.fails()
        door.look(lambda reopen: moved.append(reopen()))
        assert moved == [door.session]
        assert door.fails() == ""
    finally:
        door.close()


def test_a_router_on_loopback_needs_no_secret(tmp_path):
    door = SessionManager(Settings(data=tmp_path, zenoh_listen=f"tcp/127.0.0.1:{free_port()}"), list)
    door.open()
    door.close()
    assert list(tmp_path.iterdir()) == []
