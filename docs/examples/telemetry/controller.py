"""A controller in a program of its own: it answers a live twin's question every second. Needs eclipse-zenoh alone.

    python controller.py demo [--endpoint tcp/127.0.0.1:7447] [--user NAME --ca FILE]

Then let the twin ask it: `{"command": "controller", "controller": "remote"}` to the twin's key `command`, or
PATCH /v1/twins/demo with {"controller": "remote"}.
"""

import argparse
import json
import os
import time

import zenoh

BUFFERS = ("high", "medium", "low")


def decide(seen):
    """Fill the vehicle from the fullest buffer and refill the emptiest of the others below 800 bar."""
    command = []
    by_pressure = sorted(range(3), key=lambda buffer: seen["pressure"][buffer])
    if seen["vehicle"] >= 0:
        command.append(f"outlet_{BUFFERS[by_pressure[2]]}")
    if seen["pressure"][by_pressure[0]] < 800:
        command.append(f"inlet_{BUFFERS[by_pressure[0]]}")
    return command


def answer(query):
    """Answer one question."""
    with query:
        seen = json.loads(query.payload.to_bytes())
        query.reply(query.key_expr, json.dumps({"command": decide(seen)}))


def open_session(arguments):
    """A client of the service's router; one for other machines asks for a key's user and password."""
    user, password = arguments.user, os.environ.get("HRS_ZENOH_PASSWORD", "")
    config = {
        "mode": "client",
        "connect": {"endpoints": [arguments.endpoint]},
        "scouting": {"multicast": {"enabled": False}},
        "transport": {
            "auth": {"usrpwd": {"user": user, "password": password}} if user else {},
            "link": {"tls": {"root_ca_certificate": arguments.ca} if arguments.ca else {}},
        },
    }
    return zenoh.open(zenoh.Config.from_json5(json.dumps(config)))


def main():
    """Answer until interrupted."""
    parser = argparse.ArgumentParser()
    parser.add_argument("twin")
    parser.add_argument("--endpoint", default="tcp/127.0.0.1:7447")
    parser.add_argument("--user", help="of a key, as `hrs keys zenoh` says; its password in HRS_ZENOH_PASSWORD")
    parser.add_argument("--ca", help="authority that signed the router's certificate: a PEM file")
    arguments = parser.parse_args()
    with open_session(arguments) as session:
        session.declare_queryable(f"hrs/v1/{arguments.twin}/decide", answer)
        print("answering", f"hrs/v1/{arguments.twin}/decide", flush=True)
        while True:
            time.sleep(1)


if __name__ == "__main__":
    main()
