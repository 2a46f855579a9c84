"""A zenoh client in a process of its own: does what the JSON document on stdin says, and prints what came of it.

{"endpoint", "user", "password", "ca", "mode", "seconds", "ask": [keys], "put": [keys], "answer": [keys]}
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time

PATIENCE_S = 60.0
"""A stranger that has not ended by then has failed [s]."""


def stranger(**document):
    """Start one; `told` waits for what it says."""
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.api.stranger"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        env={**os.environ, "RUST_LOG": "off"},
    )  # fmt: skip
    process.stdin.write(json.dumps(document))
    process.stdin.close()
    process.stdin = None
    return process


def told(process):
    """What a stranger says; `opened` is false where it was refused."""
    try:
        said, _ = process.communicate(timeout=PATIENCE_S)
    finally:
        process.kill()
    assert process.returncode == 0, said
    return json.loads(said)


def _open(wish):
    import zenoh

    transport = {}
    if wish.get("user") is not None:
        transport["auth"] = {"usrpwd": {"user": wish["user"], "password": wish.get("password", "")}}
    if wish.get("ca"):
        transport["link"] = {"tls": {"root_ca_certificate": wish["ca"]}}
    config = {
        "mode": wish.get("mode", "client"), "transport": transport,
        "connect": {"endpoints": [wish["endpoint"]], "timeout_ms": 4000, "exit_on_failure": True},
        "listen": {"endpoints": []}, "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
    }  # fmt: skip
    return zenoh.open(zenoh.Config.from_json5(json.dumps(config)))


def _main() -> None:
    import zenoh

    wish = json.load(sys.stdin)
    try:
        session = _open(wish)
    except zenoh.ZError as error:
        print(json.dumps({"opened": False, "why": str(error)}))
        return
    heard, asked = [], []
    with session:

        def answer(query):
            asked.append(str(query.key_expr))
            query.reply(query.key_expr, b'{"command": [], "forged": true}')

        session.declare_subscriber("hrs/v1/**", lambda sample: heard.append(sample.payload.to_string()))
        for place in wish.get("answer", []):
            session.declare_queryable(place, answer)
        answers = {
            place: [(r.ok or r.err).payload.to_string() for r in session.get(place, timeout=5)]
            for place in wish.get("ask", [])
        }
        alive = [str(r.ok.key_expr) for r in session.liveliness().get("hrs/v1/*/alive", timeout=5) if r.ok]
        until = time.monotonic() + wish.get("seconds", 0)
        while time.monotonic() < until:
            for place in wish.get("put", []):
                session.put(place, b'{"forged": true}')
            time.sleep(0.1)
        routers = [str(each) for each in session.info.routers_zid()]
    mine = [text for text in heard if "forged" in text]
    others = [text for text in heard if "forged" not in text]
    print(json.dumps({"opened": True, "heard": others, "forged": mine, "asked": asked, "answers": answers,
                      "alive": alive, "routers": routers}))  # fmt: skip


if __name__ == "__main__":
    _main()
