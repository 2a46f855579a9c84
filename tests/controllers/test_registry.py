"""Which controllers there are, and which of them are compiled."""

from __future__ import annotations

from importlib.metadata import EntryPoint

import pytest

from controllers import create, registry
from station import InputError, load_station


@pytest.fixture
def empty(tmp_path, monkeypatch):
    """As if nothing had been compiled, and by this process."""
    monkeypatch.setattr(registry, "_COMPILED", tmp_path / "controllers")
    monkeypatch.setattr(registry, "_at_work", lambda: False)


@pytest.mark.usefixtures("empty")
def test_a_controller_is_compiled_once_for_a_version():
    assert registry.uncompiled(first=["switched", "logic"])[:2] == ["logic", "switched"]
    assert list(registry.compile_all(first=["minlp2"])) == ["minlp2", *sorted({*registry.controllers()} - {"minlp2"})]
    assert list(registry.compile_all()) == registry.uncompiled() == []


@pytest.mark.usefixtures("empty")
def test_while_another_process_compiles_only_what_it_has_done_can_be_used():
    compiling = registry.compile_all(first=["logic"])
    assert next(compiling) == "logic"
    at_work = True
    registry.leave_compiling(lambda: at_work)
    assert create("logic").name == "logic"
    with pytest.raises(registry.UncompiledError, match="controller minlp1 is being compiled"):
        create("minlp1")
    at_work = False  # done, or dead: whoever asks compiles
    assert create("minlp1").name == "minlp1"


def test_a_controller_that_cannot_be_loaded_leaves_the_others(monkeypatch, caplog):
    points = [EntryPoint("broken", "no.such.module:Thing", registry.ENTRY_POINTS), registry.controllers()["logic"]]
    monkeypatch.setattr(registry, "controllers", lambda: {point.name: point for point in points})
    registry.load_all()
    assert "controller broken cannot be loaded" in caplog.text


@pytest.mark.parametrize("table", ["minlp", "minlp1"])
def test_what_is_wrong_is_named_by_the_table_that_holds_it(table):
    """A controller's own table goes over the one that it shares."""
    station = load_station("thesis-fit-a")
    tables = {**station.controllers, table: {**station.controllers[table], "horizon": 0}}
    with pytest.raises(InputError, match=rf"controllers\.{table}:"):
        create("minlp1").settings_for(station.model_copy(update={"controllers": tables}))
