"""Rebuild the record of a live twin, from whenever this starts: pip install eclipse-zenoh is all it needs.

    python rebuild.py demo record.jsonl [--endpoint tcp/127.0.0.1:7447] [--until SEQ] [--user NAME --ca FILE]

Each line of the file is a sample; a later line replaces an earlier one of the same `seq`. Stop it at any time and start
it again: it goes on behind what it has, and asks the history for what it has missed.
"""

import argparse
import json
import os
import queue
import time
from pathlib import Path

import zenoh


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


def read(path):
    """Samples of an earlier start by number; a last line cut short is dropped."""
    known = {}
    for line in path.read_text().splitlines() if path.exists() else []:
        try:
            sample = json.loads(line)
        except json.JSONDecodeError:
            break
        known[sample["seq"]] = sample
    return known


class Rebuilder:
    """Writes samples in order, each epoch's in place of what earlier ones had told from there on."""

    def __init__(self, session, twin, path):
        self.session, self.twin = session, twin
        known = read(path)
        path.write_text("".join(json.dumps(known[seq]) + "\n" for seq in sorted(known)))
        self.out = path.open("a")
        self.epoch = max((sample["epoch"] for sample in known.values()), default=0)
        self.next = next(seq for seq in range(len(known) + 1) if seq not in known)
        self.ahead = {}

    def take(self, sample):
        """A sample as it is published."""
        if (sample["epoch"], sample["seq"]) < (self.epoch, self.next):
            return  # replaced, or written down already
        if sample["epoch"] == self.epoch:
            self.ahead[sample["seq"]] = sample
        if self.next not in self.ahead:
            self.ask()  # the service was started again, or something was missed: the history knows
        self.write()

    def ask(self):
        """Ask the history for the next samples; False where it has none, or nobody answers."""
        selector = f"hrs/v1/{self.twin}/history?from={self.next};limit=1000"
        for reply in self.session.get(selector, timeout=10):
            if reply.ok is None:
                print("refused:", reply.err.payload.to_string())
                return False
            answer = json.loads(reply.ok.payload.to_bytes())
            begun = {int(epoch): first for epoch, first in answer["epochs"].items()}
            newer = [first for epoch, first in begun.items() if epoch > self.epoch]
            if newer:
                self.epoch = max(begun)
                self.ahead = {}
                if min(newer) < self.next:
                    self.next = min(newer)
                    return self.ask()
            if not answer["samples"]:
                return False
            self.ahead.update((sample["seq"], sample) for sample in answer["samples"])
            first = answer["samples"][0]["seq"]
            if first > self.next:
                print(f"samples {self.next} to {first - 1} are older than what the service keeps", flush=True)
                self.next = first
            return True
        return False

    def write(self):
        """Write down what is there without a gap."""
        while self.next in self.ahead:
            self.out.write(json.dumps(self.ahead.pop(self.next)) + "\n")
            self.next += 1
        self.out.flush()


def main():
    """Rebuild until `--until`, or for ever."""
    parser = argparse.ArgumentParser()
    parser.add_argument("twin")
    parser.add_argument("file", type=Path)
    parser.add_argument("--endpoint", default="tcp/127.0.0.1:7447")
    parser.add_argument("--user", help="of a key, as `hrs keys zenoh` says; its password in HRS_ZENOH_PASSWORD")
    parser.add_argument("--ca", help="authority that signed the router's certificate: a PEM file")
    parser.add_argument("--until", type=int, help="stop when every sample up to this number is there")
    arguments = parser.parse_args()

    news = queue.SimpleQueue()
    with open_session(arguments) as session:
        # Subscribe first, ask the history afterwards: nothing can fall between the two.
        subscriber = session.declare_subscriber(f"hrs/v1/{arguments.twin}/sample", news.put)
        rebuilder = Rebuilder(session, arguments.twin, arguments.file)
        while arguments.until is None or rebuilder.next <= arguments.until:
            try:
                rebuilder.take(json.loads(news.get(timeout=1.0).payload.to_bytes()))
            except queue.Empty:  # paused, ended, or the service is away
                if rebuilder.ask():
                    rebuilder.write()
                else:
                    time.sleep(0.5)
        subscriber.undeclare()


if __name__ == "__main__":
    main()
