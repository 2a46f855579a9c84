"""docs/examples/telemetry/rebuild.py against a history that has forgotten, repeats and starts again."""

from __future__ import annotations

import json
import queue
import subprocess
import sys
import time
from pathlib import Path

import pytest

from api.settings import Settings
from api.telemetry.session import open_session
from tests.api.conftest import free_port

WORKERS = 0

REBUILD = Path(__file__).parents[2] / "docs" / "examples" / "telemetry" / "rebuild.py"


class ScriptedService:
    """Samples [`kept`, `end`) in history; each holds the epoch it is of."""

    def __init__(self, session, kept, end, epochs):
        self.kept, self.end, self.epochs = kept, end, epochs
        self.asked: queue.SimpleQueue[int] = queue.SimpleQueue()
        self._session = session
        self._history = session.declare_queryable("hrs/v1/demo/history", self._answer)

    def sample(self, seq):
        epoch = max(epoch for epoch, first in self.epochs.items() if first <= seq)
        return {"version": 1, "twin": "demo", "epoch": epoch, "seq": seq, "sent": None, "values": {"time": float(seq)}}

    def close(self):
        """Answer no more: a later service of the same session must be the only one."""
        self._history.undeclare()

    def publish(self, document):
        self._session.put("hrs/v1/demo/sample", json.dumps(document))

    def _answer(self, query):
        with query:
            first, limit = (int(query.parameters.get(name)) for name in ("from", "limit"))
            self.asked.put(first)
            samples = [self.sample(seq) for seq in range(max(first, self.kept), min(first + limit, self.end))]
            document = {
                "version": 1,
                "twin": "demo",
                "epoch": max(self.epochs),
                "first": first,
                "next": samples[-1]["seq"] + 1 if samples else first,
                "end": self.end,
                "epochs": {str(epoch): begin for epoch, begin in self.epochs.items()},
                "samples": samples,
            }
            query.reply(query.key_expr, json.dumps(document))


@pytest.fixture
def rebuilt(tmp_path):
    """Runs the example until a sample; what it wrote, and what it said."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with open_session(Settings(zenoh_listen=endpoint)) as session:

        def run(until, kept, end, epochs, meanwhile=None):
            service = ScriptedService(session, kept, end, epochs)
            command = [sys.executable, REBUILD, "demo", tmp_path / "record.jsonl", "--endpoint", endpoint]
            command += ["--until", str(until)]
            with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
                try:
                    if meanwhile is not None:
                        service.asked.get(timeout=30)  # it listens
                        meanwhile(service)
                    said, _ = process.communicate(timeout=60)
                finally:
                    process.kill()
                    service.close()
            assert process.returncode == 0
            lines = [json.loads(line) for line in (tmp_path / "record.jsonl").read_text().splitlines()]
            return lines, said, service

        yield run


def test_it_goes_on_where_a_history_begins_that_has_forgotten(rebuilt):
    lines, said, _ = rebuilt(999, kept=750, end=1000, epochs={1: 0})
    assert [line["seq"] for line in lines] == list(range(750, 1000))
    assert "samples 0 to 749 are older than what the service keeps" in said


@pytest.mark.slow
def test_it_takes_a_later_epoch_in_place_of_an_earlier_one(rebuilt):
    rebuilt(99, kept=0, end=100, epochs={1: 0})

    def restart(service):
        service.publish({**service.sample(99), "epoch": 1})  # of the past: replaced
        service.publish(service.sample(120))

    lines, _, _ = rebuilt(120, kept=0, end=121, epochs={1: 0, 2: 60, 3: 80}, meanwhile=restart)
    last = {line["seq"]: line["epoch"] for line in lines}
    assert sorted(last) == list(range(121))
    assert [last[seq] for seq in (0, 59, 60, 79, 80, 120)] == [1, 1, 2, 2, 3, 3]


@pytest.mark.slow
def test_what_it_has_already_is_not_asked_for_again(rebuilt):
    def tell_again(service):
        for seq in range(500):
            service.publish(service.sample(seq))
        time.sleep(0.5)
        service.end = 501
        service.publish(service.sample(500))

    lines, _, service = rebuilt(500, kept=0, end=500, epochs={1: 0}, meanwhile=tell_again)
    assert [line["seq"] for line in lines] == list(range(501))
    asked = [service.asked.get_nowait() for _ in range(service.asked.qsize())]
    assert len(asked) < 20  # five hundred, were each old sample a reason to ask
