"""What failed once is tried again: a look, a sweep of connections, a certificate."""

from __future__ import annotations

import asyncio
import signal
from types import SimpleNamespace

import pytest

from api.controllers.certificates import Making, ServiceCertificates
from api.jobs.check import OUT_OF_MEMORY
from api.jobs.checks import Checks
from api.looks import Look
from api.server.connections import Connections, Deadlines
from api.settings import Settings
from api.store.size import StoreRoom
from station import load_station
from tests.waiting import awaited, wait_until


def test_who_looks_after_a_look_that_failed_is_told(caplog):
    answers = iter([OSError("gone"), 7])

    def look():
        answer = next(answers)
        if isinstance(answer, Exception):
            raise answer
        return answer

    looking = Look(look, "disk", 0.0)
    assert looking.found(5) is None
    assert looking.found(5) == 7
    assert [record.getMessage() for record in caplog.records] == ["disk: the look failed"]


def test_a_store_whose_folder_has_gone_is_not_full(database, monkeypatch):
    def gone(_database):
        raise FileNotFoundError(2, "no such file")

    monkeypatch.setattr("api.store.size.measure", gone)
    room = StoreRoom(database, 20_000_000, 0)
    assert room.size() is None
    room.check()


class _Open:
    """A connection that is overdue, and what its end does."""

    waits_for_client = True
    answered = False

    def __init__(self, loop, end):
        self.loop = loop
        self._end = end

    def overdue(self, now):
        return "idle"

    def end(self, reason):
        self._end()


def test_a_connection_that_fails_ends_no_deadline_of_others():
    async def swept():
        told = []
        registry = Connections(Deadlines.of(Settings()), 16, told.append)
        loop = asyncio.get_running_loop()
        broken = _Open(loop, lambda: 1 / 0)
        registry.added(broken)
        with pytest.raises(ZeroDivisionError):
            registry._sweep(loop)
        registry.removed(broken)
        registry.added(late := _Open(loop, lambda: registry.removed(late)))
        while len(registry):
            await asyncio.sleep(0.05)
        return told

    assert awaited(asyncio.wait_for(swept(), 5)) == ["idle", "idle"]


def test_with_room_for_one_the_newest_has_it():
    async def left():
        registry, ended = Connections(Deadlines.of(Settings()), 1, lambda _reason: None), []
        first, second = (_Open(asyncio.get_running_loop(), lambda k=k: ended.append(k)) for k in range(2))
        first.answered = True
        registry.added(first)
        registry.added(second)
        registry.removed(second)
        return ended

    assert awaited(left()) == [0]


def test_a_certificate_that_could_not_be_made_is_made_when_it_is_asked_for_again():
    answers = iter([RuntimeError("too busy"), {"verdict": "certified", "claim": "every vehicle"}])

    def make(_controller, _station):
        answer = next(answers)
        if isinstance(answer, Exception):
            raise answer
        return answer

    certificates = ServiceCertificates(SimpleNamespace(make=make))
    subject = "reserve", load_station("thesis-fit")
    for state in (Making.FAILED, Making.MADE):
        certificates.begin("certificate", *subject)
        wait_until(lambda state=state: certificates.state("certificate", *subject)[0] is state)
    certificates.begin("certificate", *subject)  # there already: nothing is made anew
    assert certificates.get("certificate", *subject)["verdict"] == "certified"
    certificates.close()


@pytest.mark.parametrize(
    ("status", "kind"),
    [(OUT_OF_MEMORY, "too-large"), (-signal.SIGKILL, "too-large"), (-signal.SIGXCPU, "too-large"),
     (-signal.SIGTERM, "busy"), (1, "busy")],
)  # fmt: skip
def test_a_check_that_somebody_ended_says_nothing_of_memory(status, kind):
    order = {"cpu_s": 1, "wall_s": 1, "memory_bytes": 1}
    problem = Checks(Settings())._problem(status, order, late=False).problem
    assert problem.type.endswith(kind)
