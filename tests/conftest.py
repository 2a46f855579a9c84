"""What tests of several rooms need, made once for all processes of a test run."""

from __future__ import annotations

import json
import os
import time

import pytest
from hypothesis import settings

settings.register_profile("loaded", deadline=None, derandomize=True)  # the same examples, however long they take
settings.load_profile("loaded")


def pytest_sessionstart(session):
    """Controllers are compiled before anything is tested, once for a version, and not by each process of the run."""
    if not hasattr(session.config, "workerinput") and not session.config.option.collectonly:
        from controllers.registry import compile_all

        for name in compile_all():
            print(f"{name} is compiled", flush=True)


def pytest_collection_modifyitems(config, items):
    """Full samples are tried where they are asked for, not with the slow tests that some of them are too."""
    if "full" in config.option.markexpr:
        return
    full = [item for item in items if item.get_closest_marker("full")]
    if full:
        config.hook.pytest_deselected(items=full)
        items[:] = [item for item in items if not item.get_closest_marker("full")]


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item):
    """No test begins behind TESTS_UNTIL, a Unix time, where that is given."""
    if time.time() > float(os.environ.get("TESTS_UNTIL", "inf")):
        pytest.skip("the time that there is for tests is over (TESTS_UNTIL)")


@pytest.fixture(scope="session")
def once(tmp_path_factory, request):
    """`once(name, make)`: the JSON document that `make()` gives; whichever process asks first makes it."""
    import fcntl

    beside_others = hasattr(request.config, "workerinput")
    folder = tmp_path_factory.getbasetemp().parent if beside_others else tmp_path_factory.getbasetemp()

    def made(name, make):
        with (folder / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            document = folder / f"{name}.json"
            if not document.exists():
                document.write_text(json.dumps(make()))
            return json.loads(document.read_text())

    return made


@pytest.fixture(scope="session")
def proved(once):
    """A certificate of service of reserve at the generous station."""
    from controllers.certified.service import certify
    from tests.generous import generous

    return once("proved", lambda: certify("reserve", generous()))
