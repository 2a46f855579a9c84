"""Twins of a server that is opened, killed and opened again, on a store that a test can trouble."""

from __future__ import annotations

from contextlib import contextmanager

from api.settings import Settings
from api.store.database import StoreError
from api.store.twins import TwinRepository
from api.twins.schemas import TwinRequest
from api.twins.service import Twins
from tests.api.ear import Ear
from tests.waiting import wait_until


class Troubled(TwinRepository):
    """A store whose `save` first does what a test wants: wait, or raise."""

    trouble = staticmethod(lambda checkpoint: None)

    def save(self, twin_id, epoch, checkpoint):
        self.trouble(checkpoint)
        super().save(twin_id, epoch, checkpoint)


def away(*_):
    """What a store does that is away."""
    raise StoreError("away")


@contextmanager
def opening(database, **defaults):
    """A function that opens the twins on a database again and again; they are closed behind."""
    made = []

    def make(instance="one", **settings):
        twins = Twins(Troubled(database, instance), Settings(**{**defaults, **settings}))
        twins.observers.append(Ear())
        made.append(twins)
        return twins

    yield make
    for twins in made:
        twins._store.trouble = Troubled.trouble
        twins.close()


def request(**more):
    """A twin `t`, as fast as it can unless more is said."""
    return TwinRequest.model_validate({"id": "t", "scenario": "S1", "controller": "minlp1", "speed": "max", **more})


def kill(twins):
    """As if the process had been killed: nothing is stored any more."""
    for twin in twins._live.values():
        twin._gone = True
        twin.close()
    twins._checkpointer._save = lambda draft: None
    for twin in twins._live.values():
        twin.join(5)
    twins._live.clear()


def run_through_kills(opened, asked, kills, samples):
    """The twins that are left when one has ended that was killed so often, after so many samples more each time."""
    twins = opened()
    twins.start(asked)
    for _ in range(kills):
        wanted = twins._store.get(asked.id).samples + samples
        wait_until(lambda wanted=wanted, twins=twins: twins._store.get(asked.id).samples >= wanted)
        kill(twins)
        twins = opened()
        twins.resume_all()
    wait_until(lambda: twins.state(asked.id).state == "finished")
    return twins
