"""Which requests come from pages of others: every combination of what browsers and programs send."""

from __future__ import annotations

import socket

import httpx
import pytest
from starlette.datastructures import Headers

from api.http.origins import ISOLATION, check_origin, is_foreign
from api.http.problems import ProblemError
from api.server.app import create_app
from api.settings import Settings, load_settings
from station import InputError
from tests.waiting import awaited

HOST = "127.0.0.1:8000"


def _headers(site=None, origin=None, host=HOST, **more):
    given = {"host": host, "sec-fetch-site": site, "origin": origin} | {
        name.replace("_", "-"): value for name, value in more.items()
    }
    return Headers({name: value for name, value in given.items() if value is not None})


@pytest.mark.parametrize(
    ("site", "origin", "host"),
    [
        (None, None, HOST),  # a program
        ("none", None, HOST),  # an address that was typed
        ("same-origin", f"http://{HOST}", HOST),
        ("same-origin", None, HOST),
        ("same-origin", "https://station.example", HOST),  # a proxy has replaced Host
        ("same-origin", "null", HOST),  # a form of the page under a referrer policy
        (None, f"http://{HOST}", HOST),  # a browser without Sec-Fetch-Site
        (None, "https://station.example", "station.example"),  # a proxy ends TLS
        (None, "https://station.example", "Station.Example:443"),
        (None, "http://[::1]:8000", "[::1]:8000"),
    ],
)
def test_the_page_and_programs_go_on(site, origin, host):
    check_origin("POST", _headers(site, origin, host), [])


@pytest.mark.parametrize(
    ("site", "origin"),
    [
        ("cross-site", None), ("same-site", None), ("cross-site", f"http://{HOST}"), ("same-site", f"http://{HOST}"),
        ("nonsense", None), ("", None), ("none", "http://evil.example"), (None, "http://evil.example"), (None, "null"),
        (None, ""), (None, "http://127.0.0.1:3000"), (None, "http://localhost:8000"), (None, "ftp://127.0.0.1:8000"),
        (None, f"http://evil.example://{HOST}"), (None, f"http://{HOST}.evil.example"), (None, f"http://x@{HOST}"),
        (None, f"file://{HOST}"), (None, HOST),
    ],
)  # fmt: skip
@pytest.mark.parametrize("method", ["POST", "PATCH", "DELETE", "PUT", "GET", "HEAD", "OPTIONS", "PROPFIND"])
def test_pages_of_others_are_refused(site, origin, method):
    with pytest.raises(ProblemError) as refused:
        check_origin(method, _headers(site, origin), [])
    assert (refused.value.problem.status, refused.value.problem.type) == (403, "urn:hrs-twin:problem:foreign-origin")


def test_a_link_may_be_followed_and_nothing_else():
    link = {"sec_fetch_mode": "navigate", "sec_fetch_dest": "document"}
    check_origin("GET", _headers("cross-site", **link), [])
    for method, other in (
        ("POST", {}), ("GET", {"sec_fetch_dest": "iframe"}), ("GET", {"sec_fetch_mode": "no-cors"}),
        ("GET", {"sec_purpose": "prefetch;prerender"}), ("GET", {"purpose": "prefetch"}),
    ):  # fmt: skip
        with pytest.raises(ProblemError):
            check_origin(method, _headers("cross-site", **{**link, **other}), [])


def test_an_origin_may_be_allowed():
    allowed = ["https://station.example"]
    assert not is_foreign(_headers(None, "https://station.example"), allowed)
    assert is_foreign(_headers(None, "https://station.example:8443"), allowed)
    assert is_foreign(_headers("cross-site"), allowed)
    assert load_settings(allowed_origins=allowed).allowed_origins == allowed
    for wrong in ("*", "null", "station.example", "https://station.example/", "https://Station.example", ""):
        with pytest.raises(InputError, match="allowed_origins"):
            load_settings(allowed_origins=[wrong])


def test_no_websocket_is_opened(tmp_path):
    app = create_app(Settings(data=tmp_path))
    said = []

    async def ask():
        async def send(message):
            said.append(message)

        scope = {"type": "websocket", "path": "/v1/twins", "headers": [(b"origin", b"http://evil.example")]}
        await app(scope, None, send)

    awaited(ask())
    assert [message["type"] for message in said] == ["websocket.close"]
    app.state.services.database.close()
    app.state.services.twins.close()


def test_an_upgrade_to_a_websocket_is_an_ordinary_request(service):
    upgrade = (
        f"GET /v1/twins HTTP/1.1\r\nHost: {HOST}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\nOrigin: http://evil.example\r\n\r\n"
    )
    with socket.create_connection(("127.0.0.1", service.port), 10) as made:
        made.sendall(upgrade.encode())
        assert made.recv(4096).startswith(b"HTTP/1.1 403 ")


def test_every_answer_keeps_other_pages_out(http):
    for path in ("/", "/docs", "/static/app.js", "/v1/twins", "/v1/nothing", "/livez", "/metrics"):
        answer = http.get(path)
        for name, value in ISOLATION:
            given = answer.headers[name.decode()]
            assert given == value.decode() or (name == b"content-security-policy" and "frame-ancestors 'none'" in given)
            assert "," not in given


@pytest.mark.parametrize(
    "media_type",
    [None, "text/plain", "application/x-www-form-urlencoded", "multipart/form-data; boundary=x", "json", ""],
)
def test_a_body_must_call_itself_json(http, media_type):
    headers = {} if media_type is None else {"content-type": media_type}
    for content in (b'{"scenario": "S1"}', iter([b'{"scenario"', b': "S1"}'])):
        answer = http.post("/v1/runs", content=content, headers=headers)
        assert (answer.status_code, answer.json()["type"]) == (415, "urn:hrs-twin:problem:media-type"), media_type
        assert answer.headers["content-type"] == "application/problem+json"


@pytest.mark.parametrize("media_type", ["application/json", "Application/JSON; charset=utf-8", "application/x+json"])
def test_json_by_its_names_is_taken(http, media_type):
    answer = http.post("/v1/scenarios/resolve", content=b'"S1"', headers={"content-type": media_type})
    assert answer.status_code == 200


def test_a_command_without_a_body_needs_no_type(service):
    assert httpx.post(f"{service.url}/v1/twins/nothing/stop", trust_env=False).status_code == 404
